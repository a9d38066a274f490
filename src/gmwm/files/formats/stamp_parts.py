"""Join time stamps that a table holds in two columns: seconds, and the fraction of a second."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm.base.errors import ReadError
from gmwm.base.units import TIME_UNITS
from gmwm.files.clock.lost_samples import MISSING, is_missing
from gmwm.files.columns.column_names import clean, recognise, unit_of
from gmwm.files.contract import Rows

_MOST_ROWS = 4096
"""Number of rows in which seconds and fractions are compared."""


@dataclass(frozen=True)
class StampParts:
    """Indices of the columns of seconds and of their fractions, and the number of units of the fraction in a second."""

    seconds: int
    fraction: int
    per_second: int

    def join(self, rows: Rows, path: object) -> NDArray[np.int64]:
        """Return the time stamps (ns)."""
        parts = [np.asarray(rows[k]) for k in (self.seconds, self.fraction)]
        masks = [is_missing(part) for part in parts]
        away = np.any([np.zeros(parts[0].size, dtype=bool) if mask is None else mask for mask in masks], axis=0)
        seconds, fraction = (np.where(away, 0, part).astype(np.int64) for part in parts)
        if np.any((fraction < 0) | (fraction >= self.per_second)):
            raise ReadError(
                f"{path}: the fractions of a second in column number {self.fraction} reach {fraction.max()}, and "
                f"{self.per_second} are a second",
                code="time-implausible",
                advice="Name the time column with {--columns}, or leave it out with {--columns=time:none} and pass "
                "{--rate}.",
            )
        return np.where(away, MISSING, seconds * 10**9 + fraction * (10**9 // self.per_second))


def find_parts(names: Sequence[str], integers: Sequence[bool], rows: Sequence[Sequence[str]]) -> StampParts | None:
    """Find the columns of time stamps in two parts, by the names of the seconds and by the numbers of the fraction,
    which begins again in each second."""
    seconds = [k for k, name in enumerate(names) if integers[k] and _may_be_seconds(name)]
    others = [
        k for k, name in enumerate(names) if integers[k] and not recognise(name).axis.startswith(("gyro", "accel"))
    ]
    for k in seconds:
        for other in others:
            if other != k and (parts := _fitting(k, other, names[other], rows[:_MOST_ROWS])) is not None:
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
    if len(cells) < 2 or any(len(cell) > 18 for pair in cells for cell in pair):
        return None
    seconds, fraction = np.array([[int(a), int(b)] for a, b in cells]).T
    steps = np.diff(seconds)
    if fraction.min() < 0 or np.any(steps < 0):
        return None
    stated = TIME_UNITS.get(unit_of(_last_word(name), "time"), 0)
    if not np.any(steps):  # all rows are of one second: the name of the fraction decides
        fits = stated > 1 and fraction.max() < stated and np.median(np.diff(fraction)) > 0
        return StampParts(k, other, stated) if fits else None
    within = np.diff(fraction)[steps == 0]
    if not within.size or np.median(within) <= 0 or np.any(np.diff(fraction)[steps == 1] >= 0):
        return None
    for per_second in (stated,) if stated > 1 else (10**3, 10**6, 10**9):
        joined = np.diff(seconds * per_second + fraction)
        # Between two seconds, the interval is that within a second, but for lost samples.
        between = np.median(joined[steps == 1]) if np.any(steps == 1) else 0
        if fraction.max() < per_second and 0.5 * np.median(within) <= between <= 2 * np.median(within):
            return StampParts(k, other, per_second)
    return None


def _last_word(name: str) -> str:
    """Return the last word of a name, which may be a unit of time; the whole bracket if the name has one.

    >>> _last_word("time_nsec"), _last_word("usec"), _last_word("stamp [ns]")
    ('nsec', 'usec', 'ns')
    """
    words = re.split(r"[^a-zµ]+", clean(name).casefold())
    return next((word for word in reversed(words) if word), "")
