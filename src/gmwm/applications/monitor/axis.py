"""One axis of a monitor: its filter, its charts, and its present fault."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gmwm.applications.monitor.charts import HISTORY_LEVEL, Alarm, Charts, ChartSettings
from gmwm.applications.monitor.events import Kind
from gmwm.applications.monitor.naming import History, Named, named
from gmwm.applications.monitor.stored import number, numbers, whole
from gmwm.applications.monitor.whitening import Gain, Whitener
from gmwm.base.arrays import Vector

LOUD = 3.0
"""An innovation that exceeds the limit of a spike by this factor counts as motion, not as noise."""
VERY_LOUD = 20.0
"""An innovation that exceeds the limit of a spike by this factor is not attributed to a fault reported before."""
LARGER = 1.5
"""A recurring fault is reported again if it is larger than before by this factor."""
KEPT = 4096
"""Number of innovations, and of their sums over 2^HISTORY_LEVEL samples, that are kept to determine the kind of a
fault."""

_EVERYTHING = frozenset({"noise up", "noise down", "level", "spike", "constant"})
_EXPLAINED: Mapping[str, frozenset[str]] = {
    "noise-up": _EVERYTHING - {"constant"},
    "hum": _EVERYTHING - {"constant"},
    "noise-down": frozenset({"noise down"}),
    "jump": frozenset({"level", "noise up", "spike"}),
    "ramp": frozenset({"level", "noise up", "spike"}),
    "spike": frozenset({"spike"}),
    "frozen": _EVERYTHING,
    "saturated": _EVERYTHING,
    "moved": _EVERYTHING - {"constant"},
}
"""Families of alarms that a reported fault explains, by kind of the fault."""
_SILENT = ("frozen", "saturated", "moved")
"""Kinds of faults that explain innovations of any size."""
_OWN: Mapping[str, frozenset[str]] = {
    "noise-up": frozenset({"noise up"}),
    "hum": frozenset({"noise up"}),
    "noise-down": frozenset({"noise down"}),
    "ramp": frozenset({"level"}),
    "spike": frozenset({"spike"}),
}
"""Families of alarms that show that a fault is still present, by kind of the fault."""


@dataclass(frozen=True)
class Open:
    """A reported fault to which further alarms are attributed."""

    kind: Kind
    until: int  # Last sample at which alarms are attributed to it. Each such alarm moves it to a later sample.
    hold: int  # number of samples after the last alarm for which further alarms are attributed to it


class Axis:
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

    # --- samples --------------------------------------------------------------------------------------

    def update(self, x: Vector) -> list[Alarm]:
        """Add samples (n,), and return the alarms that no reported fault explains, in order of time."""
        alarms = self._constant(x)
        e = self.whitener.update(x)
        alarms += self.charts.update(e)
        self.fast = np.concatenate([self.fast, e])[-KEPT:]
        self.slow = np.concatenate([self.slow, self.charts.recent])[-KEPT:]
        return [alarm for alarm in sorted(alarms) if not self._explained(alarm)]

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

    def _explained(self, alarm: Alarm) -> bool:
        known = self.open
        if known is None or alarm.sample > known.until or alarm.family not in _EXPLAINED[known.kind]:
            return False
        if alarm.score > 0.5 * (VERY_LOUD * self.charts.spike) ** 2 and known.kind not in _SILENT:
            return False  # this is motion, regardless of the reported fault
        hold = max(known.hold, alarm.sample - alarm.onset)
        self.open = Open(known.kind, max(known.until, alarm.sample + hold), known.hold)
        if alarm.family in _OWN.get(known.kind, ()):
            name = "noise-up" if known.kind == "hum" else known.kind
            _, magnitude = self.known.get(name, (0, 0.0))
            self.known = {**self.known, name: (alarm.sample, magnitude)}
        return True

    # --- faults ---------------------------------------------------------------------------------------

    def name(self, alarms: Sequence[Alarm]) -> Named:
        """Determine the fault that caused alarms."""
        stuck = next((alarm for alarm in alarms if alarm.family == "constant"), None)
        if stuck is not None:
            return Named(kind="saturated" if self._is_outside() else "frozen", onset=stuck.onset + 1)
        done = self.charts.done[HISTORY_LEVEL] if self.charts.depth >= HISTORY_LEVEL else 0
        stop = self.charts.base + (done << HISTORY_LEVEL)
        return named(alarms, History(self.charts.count, self.fast, self.slow, stop), self.gain, self.settings)

    def _is_outside(self) -> bool:
        """Return whether the present sample differs from the first one by more than the limit of a spike."""
        far = self.charts.spike * float(np.sqrt(self.gain.S))
        origin = self.whitener.origin
        return self.value is not None and origin is not None and abs(self.value - origin) > far

    def is_loud(self, samples: int) -> bool:
        """Return whether one of the last `samples` innovations is far beyond the limit of a spike."""
        return bool(np.max(np.abs(self.fast[-samples:]), initial=0.0) > LOUD * self.charts.spike)

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
        new = kind == "jump" or now - last >= remembered or magnitude > LARGER * before
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

    def skip(self, samples: int) -> None:
        """Advance the sample number over samples that are not monitored."""
        self.charts.skip(samples)

    # --- state ----------------------------------------------------------------------------------------

    def save(self) -> dict[str, Any]:
        """Return the state. Its arrays are never modified in place."""
        known = self.open
        return {
            "whitener": self.whitener.save(),
            "charts": self.charts.save(),
            "fast": self.fast,
            "slow": self.slow,
            "value": self.value,
            "run": self.run,
            "open": None if known is None else [known.kind, known.until, known.hold],
            "known": self.known,
        }

    def load(self, state: Mapping[str, Any]) -> None:
        """Restore a state from `save`."""
        self.whitener.load(state["whitener"])
        self.charts.load(state["charts"])
        self.fast, self.slow = numbers(state["fast"]), numbers(state["slow"])
        self.value = None if state["value"] is None else number(state["value"])
        self.run = whole(state["run"])
        self.open = None
        if state["open"] is not None:
            kind, until, hold = state["open"]
            self.open = Open(kind, whole(until), whole(hold))
        self.known = {kind: (whole(last), number(magnitude)) for kind, (last, magnitude) in state["known"].items()}
