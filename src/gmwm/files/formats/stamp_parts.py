"""Join time stamps that a table holds in two columns: seconds, and the fraction of a second."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.base.errors import ReadError
from gmwm.base.units import TIME_UNITS
from gmwm.files.clock.lost_samples import MISSING, is_missing
from gmwm.files.columns.column_names import clean, recognise, unit_of
from gmwm.files.contract import Rows

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_MOST_ROWS = 4096
"""Number of rows in which seconds and fractions are compared."""


@dataclass(frozen=True)
class StampParts:
    """Indices of the columns of seconds and of their fractions, and the number of units of the fraction in a second; 1
    for decimal numbers below 1."""

    seconds: int
    fraction: int
    per_second: int

    def join(self, rows: Rows, path: object) -> NDArray[np.int64]:
        """Return the time stamps (ns)."""
        parts = [np.asarray(rows[k]) for k in (self.seconds, self.fraction)]
        masks = [is_missing(part) for part in parts]
        away = np.any([np.zeros(parts[0].size, dtype=bool) if mask is None else mask for mask in masks], axis=0)
        parts = [np.where(away, 0, part) for part in parts]
        per_second = self.per_second if self.per_second > 1 else 10**9
        if self.per_second == 1:
            parts[1] = np.rint(parts[1] * 1e9)
        seconds, fraction = (part.astype(np.int64) for part in parts)
        if np.any((fraction < 0) | (fraction >= per_second)):
            raise ReadError(
                f"{path}: the fractions of a second in column number {self.fraction} reach {fraction.max()}, and "
                f"{per_second} are a second",
                code="time-implausible",
                advice="Name the time column with {--columns}, or leave it out with {--columns=time:none} and pass "
                "{--rate}.",
            )
        return np.where(away, MISSING, seconds * 10**9 + fraction * (10**9 // per_second))


def find_parts(names: Sequence[str], rows: Sequence[Sequence[str]]) -> StampParts | None:
    """Find the columns of time stamps in two parts, by the name of the seconds or the unit of the fraction, and by the
    numbers of the fraction, which begins again in each second."""
    columns = [k for k, name in enumerate(names) if not recognise(name).axis.startswith(("gyro", "accel"))]
    for k in sorted(columns, key=lambda k: not _may_be_seconds(names[k])):
        for other in columns:
            named = _may_be_seconds(names[k]) or _units(names[other]) > 1
            if other != k and named and (parts := _fitting(k, other, names[other], rows[:_MOST_ROWS])) is not None:
                return parts
    return None


def _may_be_seconds(name: str) -> bool:
    """Return whether a name can be that of whole seconds: a time without a unit or in seconds."""
    words = re.split(r"[^a-z]+", clean(name).casefold())
    column = recognise(name)
    return (column.axis == "time" and column.unit in ("", "s")) or words[-1] in ("sec", "secs", "seconds", "s")


def _fitting(k: int, other: int, name: str, rows: Sequence[Sequence[str]]) -> StampParts | None:
    """Return the parts if the numbers of column `other` are fractions of the seconds in column `k`."""
    cells = [(row[k], row[other]) for row in rows if row[k] and row[other]]
    if len(cells) < 2 or any(len(cell) > 24 or not _NUMBER.fullmatch(cell) for pair in cells for cell in pair):
        return None
    seconds, fraction = np.array(cells, dtype=np.float64).T
    steps = np.diff(seconds)
    if fraction.min() < 0 or np.any(steps < 0) or np.any(seconds % 1) or abs(seconds[-1]) > 1e11:
        return None
    stated = _units(name)
    if fraction.max() < 1 and np.any(fraction > 0):
        parts = _fitting_units(seconds, fraction, 1)
        return StampParts(k, other, 1) if parts else None
    if np.any(fraction % 1):
        return None
    if not np.any(steps):  # all rows are of one second: the name of the fraction decides
        fits = stated > 1 and fraction.max() < stated and np.median(np.diff(fraction)) > 0
        return StampParts(k, other, stated) if fits else None
    units = (stated,) if stated > 1 else (10**3, 10**6, 10**9)
    return next((StampParts(k, other, unit) for unit in units if _fitting_units(seconds, fraction, unit)), None)


def _fitting_units(seconds: Vector, fraction: Vector, per_second: int) -> bool:
    """Return whether a fraction in these units continues from one second to the next."""
    steps = np.diff(seconds)
    within = np.diff(fraction)[steps == 0]
    if not within.size or np.median(within) <= 0 or np.any(np.diff(fraction)[steps == 1] >= 0):
        return False
    joined = steps * per_second + np.diff(fraction)
    # Between two seconds, the interval is that within a second, but for lost samples.
    between = np.median(joined[steps == 1]) if np.any(steps == 1) else 0
    return bool(fraction.max() < per_second and 0.5 * np.median(within) <= between <= 2 * np.median(within))


def _units(name: str) -> int:
    """Return the number of units in a second that the last word of a name states; 0 if it states none."""
    return TIME_UNITS.get(unit_of(_last_word(name), "time"), 0)


def _last_word(name: str) -> str:
    """Return the last word of a name, which may be a unit of time; the whole bracket if the name has one.

    >>> _last_word("time_nsec"), _last_word("usec"), _last_word("stamp [ns]")
    ('nsec', 'usec', 'ns')
    """
    words = re.split(r"[^a-zµ]+", clean(name).casefold())
    return next((word for word in reversed(words) if word), "")
