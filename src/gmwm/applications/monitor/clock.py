"""Convert sample numbers of a recording with gaps to times, and faults to events."""

from __future__ import annotations

from dataclasses import dataclass

from gmwm.applications.monitor.charts import Alarm
from gmwm.applications.monitor.events import Event
from gmwm.applications.monitor.naming import Fault
from gmwm.base.axis_names import AXES, axis_quantity
from gmwm.base.units import SI_UNIT

_PER_SECOND = {"rad/s": "rad/s²", "m/s²": "m/s³"}


@dataclass(frozen=True)
class SampleClock:
    """Conversion of the sample numbers of a monitor to times."""

    rate: float  # Hz
    runs: tuple[tuple[int, float], ...]  # number and time (s) of the first sample after each gap, for the last gaps

    def time(self, sample: int) -> float:
        """Return the time (s) of a sample."""
        first, time = next((run for run in reversed(self.runs) if run[0] <= sample), self.runs[0])
        return time + (sample - first) / self.rate

    def after_gap(self, sample: int, time: float) -> SampleClock:
        """Return the clock after a gap, if sample number `sample` is the next one and has the given time (s)."""
        return SampleClock(self.rate, (*self.runs[-15:], (sample, time)))  # an event may begin before the last gaps

    def event(self, axis: str, fault: Fault, first: Alarm) -> Event:
        """Return the event that reports a fault of an axis, in SI units. `first` is its first alarm."""
        unit = SI_UNIT[axis_quantity(axis)] if axis in AXES else ""
        size = fault.size
        if size is not None and fault.kind == "ramp":
            size, unit = size * self.rate, _PER_SECOND.get(unit, "")
        time = self.time(first.sample)
        return Event(
            kind=fault.kind, time=time, began=min(self.time(max(fault.onset, 0)), time), axis=axis, level=fault.level,
            scale=None if not fault.level or fault.ratio is None else (1 << fault.level) / self.rate, size=size,
            unit=unit if size is not None else "", ratio=fault.ratio,
            frequency=None if fault.cycles is None else fault.cycles * self.rate,
        )  # fmt: skip
