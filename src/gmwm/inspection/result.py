"""The result of an inspection."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from gmwm._text import Summarised, counted, moment
from gmwm.cautions import span
from gmwm.inspection.knocks import Knock, Step
from gmwm.inspection.warm_up import WarmUp
from gmwm.time_base import TimeBase


@dataclass(frozen=True, kw_only=True)
class AxisInspection:
    """One axis of a recording, in `unit`.

    Parameters
    ----------
    unit : str
        Unit of the numbers here.
    mean, sd : float
        Mean and standard deviation.
    noise : float
        Standard deviation from first differences, blind to offset and slow drift.
    lsb : float or None
        Quantisation step; None where none shows.
    wander : float
        Largest difference between the means of equal windows of the recording, a 64th each.
    """

    unit: str
    mean: float
    sd: float
    noise: float
    lsb: float | None
    wander: float


@dataclass(frozen=True, kw_only=True)
class Inspection(Summarised):
    """What a recording looks like; `warnings` says in plain words what should be known before it is used.

    Parameters
    ----------
    source : str
        Where the recording came from.
    rate : float
        Samples per second (Hz).
    duration : float
        Length without gaps (s).
    samples, segments : int
        Number of samples, and of segments without a gap.
    time_base : TimeBase
        Jitter, gaps, duplicates of the time stamps, and how much was cut off before the first sample.
    axes : mapping of axis to AxisInspection
        The axes.
    gravity : float or None
        Norm of the mean specific force (m/s²); None without three accelerometers.
    tilt : float or None
        Largest turn of the specific force from its mean direction (degrees).
    static : bool
        Whether nothing was found that says the sensor moved.
    knocks : tuple of Knock
        Bursts of outliers in the order of time; times count from the first sample before anything was cut off.
    steps : tuple of Step
        Lasting changes of level in the order of time.
    warm_ups : tuple of WarmUp
        Axes whose level settles in the beginning, as it does nowhere later.
    temperature : (lowest, highest) or None
        Range of the temperature (°C).
    notes : tuple of str
        What was understood on reading.
    warnings : tuple of str
        What should be known before the recording is used.
    """

    source: str
    rate: float
    duration: float
    samples: int
    segments: int
    time_base: TimeBase
    axes: dict[str, AxisInspection]
    gravity: float | None
    tilt: float | None
    static: bool
    knocks: tuple[Knock, ...]
    steps: tuple[Step, ...]
    warm_ups: tuple[WarmUp, ...]
    temperature: tuple[float, float] | None
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain dicts, lists and numbers, ready for JSON."""
        return dict(_plain(asdict(self)))

    def summary(self) -> str:
        """The inspection as a text."""
        lines = [
            f"{self.source or 'recording'}: {self.samples} samples at {self.rate:.10g} Hz, {span(self.duration)}"
            + (f" in {self.segments} segments" if self.segments > 1 else ""),
            f"{'axis':<8} {'mean':>11} {'sd':>11} {'noise':>11} {'LSB':>11} {'wander':>11}  unit",
        ]
        for name, axis in self.axes.items():
            lsb = "-" if axis.lsb is None else f"{axis.lsb:.4g}"
            numbers = f"{axis.mean:>11.4g} {axis.sd:>11.4g} {axis.noise:>11.4g} {lsb:>11} {axis.wander:>11.4g}"
            lines.append(f"{name:<8} {numbers}  {axis.unit}")
        if self.gravity is not None:
            lines.append(f"specific force: {self.gravity:.5g} m/s², turned by at most {self.tilt:.3g}°")
        if self.temperature is not None:
            lines.append(f"temperature: {self.temperature[0]:.4g} to {self.temperature[1]:.4g} °C")
        if self.time_base.stamped:
            gaps = counted(len(self.time_base.gaps), "gap")
            lines.append(f"time stamps: jitter {self.time_base.jitter:.3g} s rms, {gaps}")
        for knock in self.knocks[:5]:
            what = f"{', '.join(knock.axes)}, {knock.peak:.0f} sd"
            long = f"for {knock.duration:.3g} s" if knock.duration > 0 else "of one sample"
            lines.append(f"knock at {moment(knock.time)} {long} ({what})")
        if len(self.knocks) > 5:
            lines.append(f"and {counted(len(self.knocks) - 5, 'more knock')}")
        for step in self.steps[:5]:
            change = f"{step.size:+.3g} {self.axes[step.axis].unit}, {step.times:.0f} times the usual"
            lines.append(f"step of {step.axis} at {moment(step.time)} ({change})")
        if len(self.steps) > 5:
            lines.append(f"and {counted(len(self.steps) - 5, 'more step')}")
        if (self.knocks or self.steps) and (self.time_base.start or self.time_base.left):
            lines.append("these times count from the first sample of the recording, as those of skip= do")
        for found in self.warm_ups:
            change = f"{found.size:+.3g} {self.axes[found.axis].unit} at first, {found.times:.0f} times the usual"
            lines.append(f"warm-up of {found.axis} over the first {span(found.duration)} ({change})")
        lines += [f"note: {note}" for note in self.notes]
        lines += [f"warning: {warning}" for warning in self.warnings]
        return "\n".join(lines)

    def __repr__(self) -> str:
        state = "static" if self.static else "not static"
        return (
            f"Inspection({'1 axis' if len(self.axes) == 1 else f'{len(self.axes)} axes'}, {self.samples} samples at "
            f"{self.rate:g} Hz, {state}, {counted(len(self.knocks), 'knock')}, "
            f"{counted(len(self.warnings), 'warning')})"
        )


def _plain(value: Any) -> Any:
    """Tuples as lists, all the way down."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value
