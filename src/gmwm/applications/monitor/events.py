"""Events that a monitor reports: kind of the change, time, axis and size."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args

from gmwm.base.errors import ReadError
from gmwm.base.text import round_text

Kind = Literal[
    "noise-up", "noise-down", "jump", "ramp", "hum", "spike", "frozen", "saturated", "lost", "clock", "moved", "still"
]  # fmt: skip
"""Kinds of events; see `Event`."""
KINDS: tuple[Kind, ...] = get_args(Kind)
_SHOWN = {"rad/s": ("deg/s", 180.0 / math.pi), "rad/s²": ("deg/s²", 180.0 / math.pi)}
"""Displayed unit for each SI unit, with the conversion factor."""


@dataclass(frozen=True, kw_only=True)
class Event:
    """A change of a sensor that a monitor has detected.

    Attributes
    ----------
    kind : str
        Kind of the change. "noise-up" and "noise-down": the noise is larger or smaller at the scale `scale`. "jump" and
        "ramp": the level changed suddenly, or changes steadily. "hum": a sinusoid appeared. "spike": single samples are
        wrong. "frozen": all samples are equal. "saturated": all samples are equal and outside the usual range. "lost":
        samples are missing. "clock": the time stamps went back. "moved": at least three axes changed within a second.
        "still": the unit is at rest again.
    time : float
        Time (s) at which a chart statistic exceeded its threshold.
    began : float
        Estimated time (s) at which the change began.
    axis : str
        Name of the axis; an empty string for the whole unit.
    level : int or None
        Haar level of the chart that raised the alarm.
    scale : float or None
        Scale τ = 2^level samples (s) at which the noise changed.
    size : float or None
        Size of a jump or a spike, slope of a ramp, amplitude of a hum, step of the clock, or number of lost samples, in
        `unit`.
    unit : str
        Unit of `size`: rad/s or m/s², rad/s² or m/s³ for a ramp, "s" for a step of the clock, or "samples".
    ratio : float or None
        Ratio of the standard deviation of the noise at the scale `scale` to the expected one.
    frequency : float or None
        Frequency of a hum (Hz), between 0 and half the sampling rate.
    """

    kind: Kind
    time: float
    began: float
    axis: str = ""
    level: int | None = None
    scale: float | None = None
    size: float | None = None
    unit: str = ""
    ratio: float | None = None
    frequency: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the event as numbers and strings for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Event:
        """Create an event from the `content` that `to_dict` returned. Other content raises a ReadError."""
        try:
            event = cls(**content)
        except TypeError as error:
            raise ReadError(f"not an event: {error}") from error
        if event.kind not in KINDS:
            raise ReadError(f"not an event: kind must be one of {', '.join(KINDS)}; got {event.kind!r}")
        return event

    @property
    def description(self) -> str:
        """Text that describes the change, without time and axis.

        >>> Event(kind="jump", time=3596.2, began=3596.1, axis="gyro_x", size=0.0019, unit="rad/s").description
        'level jumped by 0.11 deg/s'
        """
        unit, factor = _SHOWN.get(self.unit, (self.unit, 1.0))
        amount = "" if self.size is None else round_text(self.size * factor)
        scale = "" if self.scale is None else f" at a scale of {round_text(self.scale)} s"
        texts: dict[Kind, str] = {
            "noise-up": f"noise rose by a factor of {round_text(self.ratio or 1.0)}{scale}",
            "noise-down": f"noise fell to {round_text(100.0 * (self.ratio or 0.0))} %{scale}",
            "jump": f"level jumped by {amount} {unit}", "ramp": f"level drifts by {amount} {unit}",
            "hum": f"periodic disturbance of {amount} {unit} at {round_text(self.frequency or 0.0, 3)} Hz",
            "spike": f"spike of {amount} {unit}", "frozen": "value does not change any more",
            "saturated": "value stays at a limit outside the usual range",
            "lost": f"{int(self.size)} samples lost" if self.size else "samples lost",
            "clock": f"time stamps went back by {amount} {unit}",
            "moved": "the unit was moved: charts rest until it is still", "still": "the unit is still again",
        }  # fmt: skip
        return texts[self.kind]

    def __str__(self) -> str:
        subject = self.axis or "unit"
        return f"{self.time:.1f} s  {subject}  {self.description} (began {self.began:.1f} s)"
