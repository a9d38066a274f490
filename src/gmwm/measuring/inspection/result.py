"""Results of an inspection."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from gmwm.base.documents import Documented
from gmwm.base.remarks import Dialect, Remark, Severity, with_groups
from gmwm.base.remarks.rendering import MOST_REMARKS
from gmwm.base.template import render
from gmwm.base.text import Summarised, counted, duration_text, moment, with_minus, wrap_text
from gmwm.base.time_base import TimeBase
from gmwm.base.units import AXES, usual_unit
from gmwm.measuring.inspection.knocks import Knock, Step
from gmwm.measuring.inspection.trends import Swing, Trend
from gmwm.measuring.regression.result import Regression


@dataclass(frozen=True, kw_only=True)
class AxisInspection:
    """Statistics of one axis of a recording.

    Parameters
    ----------
    unit : str
        Unit of all numbers.
    mean, sd, rest : float
        Mean and standard deviation, and mean without knocks and outliers.
    noise : float
        Standard deviation from first differences, which an offset and a slow drift do not affect.
    lsb, before_rounding : float or None
        Quantization step, and standard deviation of the noise before it was rounded; None if no step is visible, or
        for a counter.
    wander : float
        Largest difference between the means of about 64 windows of the recording.
    counter : bool
        Whether the values are differences of a counter, whose rounding errors cancel in sums.
    """

    unit: str
    mean: float
    sd: float
    rest: float
    noise: float
    lsb: float | None
    before_rounding: float | None
    wander: float
    counter: bool = False


@dataclass(frozen=True, kw_only=True)
class Inspection(Documented, Summarised):
    """Statistics of a recording, and remarks on what affects a calibration.

    Parameters
    ----------
    source, rate, duration : str, float, float
        Name of the recording, sampling rate (Hz), and length without gaps (s).
    samples, segments : int
        Number of samples of each axis, and number of segments without a gap.
    time_base : TimeBase
        Jitter, gaps and duplicates of the time stamps, and the length that was left out at the beginning.
    axes : mapping of axis to AxisInspection
        Statistics of each axis.
    gravity, tilt : float or None
        Norm of the mean specific force (m/s²), None without three accelerometers, and largest angle between the
        specific force and its mean direction (degrees).
    static : bool
        Whether no motion was found.
    knocks, steps, trends, swings : tuples of Knock, Step, Trend and Swing
        Bursts of outliers, lasting jumps of the mean, smooth changes of the mean such as a warm-up, and periodic ones.
        Times are measured from the first sample of the file.
    temperature : (lowest, highest) or None
        Range of the temperature (°C); None if it was not recorded.
    regressions : mapping of axis to Regression
        Regressions on the temperature or on other conditions, also of axes that do not depend on them.
    remarks : tuple of Remark
        Remarks on what affects a calibration, and on how the recording was read.
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
    trends: tuple[Trend, ...]
    swings: tuple[Swing, ...]
    temperature: tuple[float, float] | None
    regressions: dict[str, Regression]
    remarks: tuple[Remark, ...]

    @property
    def has_knocks(self) -> bool:
        """Whether there are knocks that change N."""
        return any(remark.code == "knocks" for remark in self.remarks)

    def summary(self, *, every: bool = False) -> str:
        """Describe the result as text, with all remarks (`every`) or the five most severe ones."""
        return text(self, every=every)

    def __repr__(self) -> str:
        state = "static" if self.static else "not static"
        return (
            f"Inspection({'1 axis' if len(self.axes) == 1 else f'{len(self.axes)} axes'}, {self.samples} samples at "
            f"{self.rate:g} Hz, {state}, {counted(len(self.knocks), 'knock')}, "
            f"{counted(sum(remark.severity < Severity.INFO for remark in self.remarks), 'caution')})"
        )


def combined(inspections: Sequence[Inspection]) -> Inspection:
    """Combine the inspections of sensors with different rates; rate and length are those of the first."""
    first, *others = inspections
    if not others:
        return first
    gravity = next((item for item in inspections if item.gravity is not None), first)
    axes = {axis: item for part in inspections for axis, item in part.axes.items()}
    named = [axis for axis in AXES if axis in axes]  # parts with gaps of their own come last, wherever their axis is
    return replace(
        first, axes={axis: axes[axis] for axis in dict.fromkeys([*named, *axes])}, gravity=gravity.gravity,
        tilt=gravity.tilt, static=all(part.static for part in inspections),
        knocks=tuple(knock for part in inspections for knock in part.knocks),
        steps=tuple(step for part in inspections for step in part.steps),
        trends=tuple(trend for part in inspections for trend in part.trends),
        swings=tuple(swing for part in inspections for swing in part.swings),
        regressions={axis: item for part in inspections for axis, item in part.regressions.items()},
        remarks=tuple(dict.fromkeys(remark for part in inspections for remark in part.remarks)),
    )  # fmt: skip


REST: Mapping[Dialect, str] = {
    Dialect.PYTHON: "summary(every=True)", Dialect.SHELL: "--all-remarks", Dialect.HTML: "",
}  # fmt: skip
"""The option that shows the remarks that the text does not contain."""


def _segment_words(inspection: Inspection) -> str:
    """Return the number of segments in the file, and the number after short gaps are filled, as text."""
    if inspection.segments < 2:
        return ""
    unbroken = next((remark.facts["segments"] for remark in inspection.remarks if remark.code == "gaps"), 1)
    filled = f", {unbroken} after short gaps are filled" if unbroken != inspection.segments else ""
    return f" in {inspection.segments} segments{filled}"


def text(inspection: Inspection, dialect: Dialect = Dialect.PYTHON, *, every: bool = False) -> str:
    """Describe an inspection as text, with options as in Python or in the shell; see `Inspection.summary`."""
    lines = [
        f"{inspection.source or 'recording'}: {inspection.samples} samples at {inspection.rate:g} Hz, "
        f"{duration_text(inspection.duration)}" + _segment_words(inspection),
        f"{'axis':<8} {'mean':>11} {'sd':>11} {'noise':>11} {'LSB':>11} {'wander':>11}  unit",
    ]
    for name, axis in inspection.axes.items():
        unit, factor = usual_unit(axis.unit)
        values = (axis.mean, axis.sd, axis.noise, axis.lsb, axis.wander)
        numbers = " ".join(f"{'-' if value is None else f'{factor * value:.4g}':>11}" for value in values)
        lines.append(f"{name:<8} {numbers}  {unit}")
    if inspection.gravity is not None:
        turned = "" if inspection.tilt is None else f", turned by at most {inspection.tilt:.3g}°"
        lines.append(f"specific force: {inspection.gravity:.5g} m/s²{turned}")
    if inspection.temperature is not None:
        lines.append(f"temperature: {inspection.temperature[0]:.4g} to {inspection.temperature[1]:.4g} °C")
    if inspection.time_base.stamped:
        gaps = counted(len(inspection.time_base.gaps), "gap")
        lines.append(f"time stamps: jitter {round(inspection.time_base.jitter, 9):.3g} s rms, {gaps}")
    for knock in inspection.knocks[:5]:
        what = f"{', '.join(knock.axes)}, {knock.peak:.0f} sd"
        long = f"for {knock.duration:.3g} s" if knock.duration > 0 else "of one sample"
        lines.append(f"knock at {moment(knock.time)} {long} ({what})")
    if len(inspection.knocks) > 5:
        lines.append(f"and {counted(len(inspection.knocks) - 5, 'more knock')}")
    if inspection.knocks and not inspection.has_knocks:
        lines.append("these knocks change N by less than 0.5 %")
    for step in inspection.steps[:5]:
        change = f"{_size(step.size, inspection.axes[step.axis].unit, '+g')}, {step.times:.0f} sd"
        lines.append(f"jump of {step.axis} at {moment(step.time)} ({change})")
    if len(inspection.steps) > 5:
        lines.append(f"and {counted(len(inspection.steps) - 5, 'more jump')}")
    if (inspection.knocks or inspection.steps) and (inspection.time_base.start or inspection.time_base.left):
        lines.append(render("times are measured from the first sample of the file, as in {--skip}", {}, dialect))
    lines += [_trend_line(trend, inspection.axes[trend.axis].unit) for trend in inspection.trends]
    for swing in inspection.swings:
        size = _size(swing.amplitude, inspection.axes[swing.axis].unit)
        lines.append(f"swing of {swing.axis} with a period of {duration_text(swing.period)} and an amplitude of {size}")
    groups = with_groups(inspection.remarks, dialect, codes=True)
    shown = groups if every or len(groups) <= MOST_REMARKS + 1 else groups[:MOST_REMARKS]
    lines += [f"{group[0].severity.label}: {sentence}" for group, sentence in shown]
    if len(shown) < len(groups):
        lines.append(f"and {len(groups) - len(shown)} more remarks ({REST[dialect]})")
    return with_minus("\n".join(part for line in lines for part in wrap_text(line)))


def _size(size: float, si: str, spec: str = "g") -> str:
    """Format the size of a change in the usual unit."""
    unit, factor = usual_unit(si)
    return f"{float(f'{factor * size:.3g}'):{spec}} {unit}"


def _trend_line(trend: Trend, unit: str) -> str:
    """Return a line of text about a trend."""
    if trend.kind != "exponential" or trend.tau is None:
        return f"{trend.kind} trend of {trend.axis}: {_size(-trend.size, unit, '+g')} from the beginning to the end"
    size = f"{_size(trend.size, unit, '+g')} at first, time constant {duration_text(trend.tau)}"
    if trend.until is None:
        return f"exponential trend of {trend.axis} ({size})"
    return f"settling of {trend.axis} over the first {duration_text(trend.until)} ({size})"
