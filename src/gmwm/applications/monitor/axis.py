"""One axis of a monitor: its filter, its charts, and its present fault."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gmwm.applications.monitor.charts import HISTORY_LEVEL, Alarm, Charts, ChartSettings
from gmwm.applications.monitor.events import Fault, History, Kind, name_fault
from gmwm.applications.monitor.whitening import Gain, Whitener, number, numbers, whole
from gmwm.base.arrays import Vector
from gmwm.base.documents import plain_fields


@dataclass(frozen=True)
class Stillness:
    """State of the detection: samples of the present block, and number of blocks without motion before it."""

    calm: int = 0  # number of consecutive blocks without motion
    samples: int = 0  # number of samples since the motion was detected
    held: Mapping[str, Vector] = field(default_factory=dict)  # samples of the present block

    def update(
        self, parts: Mapping[str, Vector], axes: Mapping[str, MonitoredAxis], naming: int
    ) -> tuple[int, Stillness, bool]:
        """Add samples of all axes. Return the number of used samples, the new state, and whether the unit rests."""
        block = max(naming, 32)  # without motion, the ratio below exceeds its limit once in 10¹⁰ blocks
        filled = next(iter(self.held.values())).size if self.held else 0
        used = min(next(iter(parts.values())).size, block - filled)
        held = {
            axis: np.concatenate([self.held[axis], x[:used]]) if self.held else x[:used] for axis, x in parts.items()
        }
        if filled + used < block:
            return used, replace(self, held=held, samples=self.samples + used), False
        for axis, x in held.items():
            errors, usual = Whitener(axes[axis].gain).update(x), float(axes[axis].settings.ratios[0])
            if not float(np.mean(np.square(errors))) < 4.0 * usual:
                return used, Stillness(0, self.samples + used), False
        return used, Stillness(self.calm + 1, self.samples + used), self.calm + 1 >= 3

    def broken(self) -> Stillness:
        """Return the state after a gap."""
        return Stillness(samples=self.samples)

    def to_dict(self) -> dict[str, Any]:
        """Return the state as numbers and lists."""
        return plain_fields(self, "calm samples held")

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Stillness:
        """Create a state from the result of `to_dict`."""
        held = {axis: numbers(x) for axis, x in content["held"].items()}
        return cls(whole(content["calm"]), whole(content["samples"]), held)


_EVERYTHING = frozenset({"noise up", "noise down", "level", "spike", "constant"})
_EXPLAINED: Mapping[str, frozenset[str]] = {
    "noise-up": _EVERYTHING - {"constant"}, "hum": _EVERYTHING - {"constant"}, "noise-down": frozenset({"noise down"}),
    "jump": frozenset({"level", "noise up", "spike"}), "ramp": frozenset({"level", "noise up", "spike"}),
    "spike": frozenset({"spike"}), "frozen": _EVERYTHING, "saturated": _EVERYTHING, "moved": _EVERYTHING - {"constant"},
}  # fmt: skip
"""Families of alarms that a reported fault explains, by kind of the fault."""
_SILENT = ("frozen", "saturated", "moved")
"""Kinds of faults that explain innovations of any size."""
_OWN: Mapping[str, frozenset[str]] = {
    "noise-up": frozenset({"noise up"}), "hum": frozenset({"noise up"}), "noise-down": frozenset({"noise down"}),
    "ramp": frozenset({"level"}), "spike": frozenset({"spike"}),
}  # fmt: skip
"""Families of alarms that show that a fault is still present, by kind of the fault."""


@dataclass(frozen=True)
class Open:
    """A reported fault to which further alarms are attributed."""

    kind: Kind
    until: int  # Last sample at which alarms are attributed to it. Each such alarm moves it to a later sample.
    hold: int  # number of samples after the last alarm for which further alarms are attributed to it


class MonitoredAxis:
    """Filter, charts and faults of one axis of a monitor; see `Charts` for the run length and the pauses."""

    def __init__(self, gain: Gain, settings: ChartSettings, *, run_length: float, rest: int, longest_rest: int) -> None:
        self.gain, self.settings = gain, settings
        self.whitener = Whitener(gain)
        self.charts = Charts(settings, run_length, rest, longest_rest)
        self.fast = self.slow = np.zeros(0)
        self.value: float | None = None
        self.run = 0  # number of equal samples at the end of the data so far
        self.open: Open | None = None
        self.known: dict[str, tuple[int, float]] = {}  # last alarm and magnitude of each reported kind

    def update(self, x: Vector) -> list[Alarm]:
        """Add samples (n,), and return the alarms that no reported fault explains, in order of time."""
        alarms = self._constant(x)
        e = self.whitener.update(x)
        alarms += self.charts.update(e)
        # 4096 innovations, and as many sums, determine the kind of a fault.
        self.fast = np.concatenate([self.fast, e])[-4096:]
        self.slow = np.concatenate([self.slow, self.charts.recent])[-4096:]
        return [alarm for alarm in sorted(alarms) if not self._is_explained(alarm)]

    def _constant(self, x: Vector) -> list[Alarm]:
        """Return an alarm for each run of equal samples whose length reaches the limit."""
        limit, before = self.settings.equal, self.run
        places = np.flatnonzero(x[1:] != x[:-1]) + 1
        if self.value is None or x[0] != self.value:
            begins, before = np.concatenate([[0], places]), 0
        else:
            begins = np.concatenate([[-before], places])
        lengths = np.diff(np.concatenate([begins, [x.size]]))
        self.value, self.run = float(x[-1]), int(lengths[-1])
        if limit == 0 or int(lengths.max()) < limit:
            return []
        alarms = []
        for k in np.flatnonzero(lengths >= limit).tolist():
            sample = int(begins[k]) + limit - 1
            if sample >= 0:
                first = self.charts.count + int(begins[k])
                at = self.charts.count + sample
                alarms.append(Alarm(at, "constant", 0, 1, onset=first - 1, score=float(limit)))
        return alarms

    def _is_explained(self, alarm: Alarm) -> bool:
        fault = self.open
        if fault is None or alarm.sample > fault.until or alarm.family not in _EXPLAINED[fault.kind]:
            return False
        if alarm.score > 0.5 * (20.0 * self.charts.spike) ** 2 and fault.kind not in _SILENT:
            return False  # this is motion, regardless of the reported fault
        hold = max(fault.hold, alarm.sample - alarm.onset)
        self.open = Open(fault.kind, max(fault.until, alarm.sample + hold), fault.hold)
        if alarm.family in _OWN.get(fault.kind, ()):
            name = "noise-up" if fault.kind == "hum" else fault.kind
            _, magnitude = self.known.get(name, (0, 0.0))
            self.known = {**self.known, name: (alarm.sample, magnitude)}
        return True

    def name(self, alarms: Sequence[Alarm]) -> Fault:
        """Determine the fault that caused alarms."""
        stuck = next((alarm for alarm in alarms if alarm.family == "constant"), None)
        if stuck is not None:
            return Fault(kind="saturated" if self._is_outside() else "frozen", onset=stuck.onset + 1)
        done = self.charts.done[HISTORY_LEVEL] if self.charts.depth >= HISTORY_LEVEL else 0
        stop = self.charts.base + (done << HISTORY_LEVEL)
        return name_fault(alarms, History(self.charts.count, self.fast, self.slow, stop), self.gain, self.settings)

    def _is_outside(self) -> bool:
        """Return whether the present sample differs from the first one by more than the limit of a spike."""
        far, origin = self.charts.spike * float(np.sqrt(self.gain.S)), self.whitener.origin
        return self.value is not None and origin is not None and abs(self.value - origin) > far

    def is_loud(self, samples: int) -> bool:
        """Return whether one of the last `samples` innovations is far beyond the limit of a spike."""
        # This is motion, not noise.
        return bool(np.max(np.abs(self.fast[-samples:]), initial=0.0) > 3.0 * self.charts.spike)

    def report(
        self, kind: Kind, alarms: Sequence[Alarm], *, hold: int, remembered: int = 0, magnitude: float = 0.0
    ) -> bool:
        """Register a fault, and return whether it is new or larger than before. A jump or a ramp restarts the level.
        Further alarms belong to the fault for at least `hold` samples, and for `remembered` samples the same fault is
        not new."""
        now = self.charts.count
        longest = max((alarm.sample - alarm.onset for alarm in alarms), default=0)
        self.open = Open(kind, now + max(hold, longest), hold)
        if kind in ("jump", "ramp"):
            self.begin_again()
        name = "noise-up" if kind == "hum" else kind
        last, before = self.known.get(name, (-remembered, 0.0))
        new = kind == "jump" or now - last >= remembered or magnitude > 1.5 * before
        self.known = {**self.known, name: (now, max(magnitude, 0.0 if new else before))}
        return new

    def begin_again(self) -> None:
        """Restart the filter with an unknown level, and all charts at 0."""
        self.whitener.restart()
        self.charts.reset()
        self.fast = self.slow = np.zeros(0)

    def gap(self, samples: int | None) -> None:
        """Continue after missing samples; `samples` is None if their number is unknown."""
        self.whitener.gap(samples)
        self.charts.break_blocks()
        self.fast = self.slow = np.zeros(0)
        self.value, self.run = None, 0

    def save(self) -> dict[str, Any]:
        """Return the state. Its arrays are never modified in place."""
        state = {name: getattr(self, name) for name in ("fast", "slow", "value", "run", "known")}
        fault = None if self.open is None else [self.open.kind, self.open.until, self.open.hold]
        return {"whitener": self.whitener.save(), "charts": self.charts.save(), **state, "open": fault}

    def load(self, state: Mapping[str, Any]) -> None:
        """Restore a state from `save`."""
        self.whitener.load(state["whitener"])
        self.charts.load(state["charts"])
        self.fast, self.slow = numbers(state["fast"]), numbers(state["slow"])
        self.value = None if state["value"] is None else number(state["value"])
        self.run = whole(state["run"])
        fault = state["open"]
        self.open = None if fault is None else Open(fault[0], whole(fault[1]), whole(fault[2]))
        self.known = {kind: (whole(last), number(magnitude)) for kind, (last, magnitude) in state["known"].items()}
