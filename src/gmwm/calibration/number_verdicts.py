"""For each number of each axis: use it, use it as a bound, or do not use it, with the reason."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from gmwm.base.remarks import Remark, Severity, sorted_remarks
from gmwm.base.units import sensor_of
from gmwm.calibration.recording_info import of_recording
from gmwm.calibration.result import Calibration
from gmwm.choosing.datasheets import Entry

MAIN = ("N", "K", "B")  # symbols of the numbers that the verdict of a calibration counts
MEMORIES_OF_FILTER = 30.0
"""Scales over N/K beyond which a filter's K is unaffected: < 1 % of the error from flicker, 13 % from a walk, as its
error falls with the squared frequency (tests/calibration/test_number_verdicts.py)."""
OF_FILTER = ("N", "K")  # symbols of the numbers of a filter
OF_FIT = ("model-misfit", "coarse-misfit")  # remarks on the difference between the model and the data
_ALL = "all"
_SHORT = frozenset({*MAIN, "R", "Q", "T_c", "q_c"})  # symbols that a remark can name
_SIZES = frozenset({*MAIN, "R", "Q", "q_c"})
"""Symbols of numbers that are sizes of noise, so that they can be upper limits."""


class Usability(Enum):
    """Whether a number can be used. The best comes first."""

    USE = "use"
    BOUND = "use as a bound"
    DO_NOT_USE = "do not use"

    @property
    def mark(self) -> str:
        """Mark in tables."""
        return {"use": "✓", "use as a bound": "≤", "do not use": "✗"}[self.value]


@dataclass(frozen=True, kw_only=True)
class NumberVerdict:
    """Whether the number `symbol` can be used, or only as a bound; `reason` is the worst remark against it, or None."""

    symbol: str
    usability: Usability
    reason: Remark | None = None

    @property
    def refused(self) -> bool:
        """Whether a remark says not to use the number."""
        return self.usability is Usability.DO_NOT_USE and self.reason is not None

    def to_dict(self) -> dict[str, Any]:
        """Return the verdict as plain values for JSON, with the code of the reason."""
        return {"use": self.usability.value, "reason": None if self.reason is None else self.reason.code}


Verdicts = Mapping[str, Mapping[str, NumberVerdict]]  # by axis and symbol


def number_verdicts(calibration: Calibration) -> dict[str, dict[str, NumberVerdict]]:
    """Return the verdict of each number by axis and symbol, including N, K and B of axes that were not calibrated."""
    remarks = sorted_remarks(calibration.remarks)
    verdicts: dict[str, dict[str, NumberVerdict]] = {}
    for axis, result in calibration.axes.items():
        subjects = ("", axis, sensor_of(axis))
        about = {*subjects, *(of_recording(subject, name) for subject in subjects for name in calibration.recordings)}
        of_axis = [remark for remark in remarks if remark.subject in about]
        verdicts[axis] = {symbol: verdict_of_number(entry, of_axis) for symbol, entry in result.datasheet.items()}
    for axis in calibration.failed:
        reason = next(remark for remark in remarks if remark.subject == axis)
        verdicts[axis] = {
            symbol: NumberVerdict(symbol=symbol, usability=Usability.DO_NOT_USE, reason=reason) for symbol in MAIN
        }
    return verdicts


def verdict_of_number(entry: Entry, remarks: Iterable[Remark]) -> NumberVerdict:
    """Return the verdict of a number from its interval and the remarks on its axis, the most severe remark first."""
    symbol = _short(entry)
    remarks = tuple(remark for remark in remarks if remark.severity is not Severity.INFO)
    spoiling = next((remark for remark in remarks if _touches(remark, remark.message.spoils, symbol)), None)
    raising = next((r for r in remarks if _touches(r, r.message.raises, symbol) and not is_small(r, entry)), None)
    # If recordings differ, no model fits their mean, and its numbers have wide intervals.
    differ = next((remark for remark in remarks if remark.code == "recordings-differ"), None)
    if spoiling is not None:
        reason = spoiling if differ is None or spoiling.code not in OF_FIT else differ
        return NumberVerdict(symbol=entry.symbol, usability=Usability.DO_NOT_USE, reason=reason)
    if entry.high is not None and not math.isfinite(entry.high):
        return NumberVerdict(symbol=entry.symbol, usability=Usability.DO_NOT_USE, reason=differ)
    if entry.upper_only and raising is None:
        raising = differ
    usability = Usability.BOUND if entry.upper_only or raising is not None else Usability.USE
    return NumberVerdict(symbol=entry.symbol, usability=usability, reason=raising)


def with_verdict_limits(calibration: Calibration) -> Calibration:
    """Return a calibration in whose datasheets every number that a remark makes a bound is an upper limit."""
    axes = dict(calibration.axes)
    for axis, verdicts in calibration.number_verdicts.items():
        bounds = {symbol for symbol, verdict in verdicts.items() if verdict.usability is Usability.BOUND}
        if axis in axes and bounds:
            sheet = axes[axis].datasheet
            entries = tuple(as_limit(entry) if entry.symbol in bounds else entry for entry in sheet.entries)
            axes[axis] = replace(axes[axis], datasheet=replace(sheet, entries=entries))
    return replace(calibration, axes=axes)


def as_limit(entry: Entry) -> Entry:
    """Return a size of noise as an upper limit, which is the upper end of its interval."""
    if entry.upper_only or entry.held or entry.low is None or entry.high is None or _short(entry) not in _SIZES:
        return entry
    high = max(abs(entry.low), abs(entry.high))
    return replace(entry, low=0.0 if entry.value >= 0 and entry.low >= 0 else -high, high=high, upper_only=True)


def counts(verdicts: Verdicts, symbol: str) -> tuple[int, int]:
    """Return the number of axes whose number `symbol` can be used, and of those where it can be used as a bound."""
    states = [of_axis[symbol].usability for of_axis in verdicts.values() if symbol in of_axis]
    return states.count(Usability.USE), states.count(Usability.BOUND)


def _short(entry: Entry) -> str:
    """Return the symbol of a number without its index and the name of its term."""
    return entry.symbol.partition(" of ")[0].partition("[")[0]


def _touches(remark: Remark, symbols: tuple[str, ...], symbol: str) -> bool:
    named = [str(name) for fact in symbols if isinstance(names := remark.facts.get(fact), tuple) for name in names]
    if named:
        # A phrase stands for all numbers of the axis.
        symbols = tuple(named) if _SHORT.intersection(named) else (_ALL,)
    return _ALL in symbols or symbol in symbols


def memory_of_filter(datasheet: Mapping[str, Entry]) -> float:
    """Return the time N/K (s) over which a filter averages; infinite without a random walk."""
    white, walk = datasheet.get("N"), datasheet.get("K")
    return math.inf if white is None or walk is None or not walk.value > 0 else white.value / walk.value


def affected(symbols: Iterable[str], tau: float, datasheet: Mapping[str, Entry]) -> tuple[str, ...]:
    """Return the numbers that a misfit at a scale `tau` (s) affects: not K of a filter if the scale is long."""
    beyond = tau > MEMORIES_OF_FILTER * memory_of_filter(datasheet)
    return tuple(symbol for symbol in symbols if not (beyond and symbol == "K"))


def is_small(remark: Remark, entry: Entry) -> bool:
    """Return whether a trend moves a number by less than half of the way to the lower end of its interval."""
    share = remark.facts.get("left")
    # The interval of an upper limit begins at zero, whatever the trend does.
    if not (isinstance(share, float) and entry.low is not None and entry.value > 0) or entry.upper_only:
        return False
    return (share / 100) ** 2 * entry.value >= entry.low
