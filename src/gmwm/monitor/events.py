"""Events of a monitor: what changed, when, on which axis, and by how much."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args

from gmwm._text import rounded
from gmwm.errors import ReadError

Kind = Literal[
    "noise-up",
    "noise-down",
    "jump",
    "ramp",
    "hum",
    "spike",
    "frozen",
    "saturated",
    "lost",
    "clock",
    "moved",
    "still",
]
"""What an event can be."""
KINDS: tuple[Kind, ...] = get_args(Kind)
_SHOWN = {"rad/s": ("deg/s", 180.0 / math.pi), "rad/s²": ("deg/s²", 180.0 / math.pi)}
"""Units in texts, with the factor from SI."""


@dataclass(frozen=True, kw_only=True)
class Event:
    """A change of a sensor.

    Attributes
    ----------
    kind : str
        "noise-up", "noise-down": the noise is larger or smaller at the scale `scale`; "jump", "ramp": the level changed
        at once, or changes steadily; "hum": a sinusoid appeared; "spike": single wrong samples; "frozen": equal values;
        "saturated": equal values outside the usual range; "lost": samples are missing; "clock": the time stamps went
        back; "moved": at least three axes changed within a second; "still": the unit no longer moves.
    time : float
        When a chart exceeded its threshold (s).
    began : float
        Estimated beginning (s).
    axis : str
        The axis; "" for the whole unit.
    level : int or None
        Haar level of the chart.
    scale : float or None
        Scale τ = 2^level samples (s) at which the noise changed.
    size : float or None
        Size in `unit`: of a jump, of a spike, the slope of a ramp, the amplitude of a hum; the number of lost samples.
    unit : str
        Unit of `size`: rad/s or m/s², per s for a ramp; "samples".
    ratio : float or None
        Ratio of the standard deviation of the noise to the expected one.
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
        """The event as numbers and strings, ready for JSON."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Event:
        """Make an event from the result of `to_dict`.

        Parameters
        ----------
        content : mapping
            The result of `to_dict`.

        Raises
        ------
        ReadError
            If it is not an event.
        """
        try:
            found = cls(**content)
        except TypeError as error:
            raise ReadError(f"not an event: {error}") from error
        if found.kind not in KINDS:
            raise ReadError(f"not an event: kind must be one of {', '.join(KINDS)}; got {found.kind!r}")
        return found

    @property
    def description(self) -> str:
        """What happened, without time and axis.

        >>> Event(kind="jump", time=3596.2, began=3596.1, axis="gyro_x", size=0.0019, unit="rad/s").description
        'level jumped by 0.11 deg/s'
        """
        amount, unit = self._shown()
        texts: dict[Kind, str] = {
            "noise-up": f"noise rose by a factor of {rounded(self.ratio or 1.0)}{self._at_scale()}",
            "noise-down": f"noise fell to {rounded(100.0 * (self.ratio or 0.0))} %{self._at_scale()}",
            "jump": f"level jumped by {amount} {unit}",
            "ramp": f"level drifts by {amount} {unit}",
            "hum": f"periodic disturbance of {amount} {unit} at {rounded(self.frequency or 0.0, 3)} Hz",
            "spike": f"spike of {amount} {unit}",
            "frozen": "value does not change any more",
            "saturated": "value stays at a limit outside the usual range",
            "lost": f"{amount} samples lost" if self.size else "samples lost",
            "clock": f"time stamps went back by {amount} {unit}",
            "moved": "the unit was moved: charts rest until it is still",
            "still": "the unit is still again",
        }
        return texts[self.kind]

    def _at_scale(self) -> str:
        return "" if self.scale is None else f" at a scale of {rounded(self.scale)} s"

    def _shown(self) -> tuple[str, str]:
        if self.size is None:
            return "", ""
        if self.unit == "samples":
            return str(int(self.size)), ""
        unit, factor = _SHOWN.get(self.unit, (self.unit, 1.0))
        return rounded(self.size * factor), unit

    def __str__(self) -> str:
        subject = self.axis or "unit"
        return f"{self.time:.1f} s  {subject}  {self.description} (began {self.began:.1f} s)"
