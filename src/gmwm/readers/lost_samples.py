"""Rows of a file that hold no usable sample: missing values, lines that cannot be read, and rows of other messages.

A reader marks a missing value: NaN in a column of numbers, `MISSING` in a column of integers. Here it is decided what
that means for the recording, in the same way for every format, in memory and in streams:

- A row with a time stamp and no value in any axis belongs to another message, or its sample was not stored. It is left
  out. If a sample is missing there, the time stamps show the gap.
- A row without a time stamp, in a recording that has them, cannot be placed. It is left out, and there is a gap between
  the samples before and after it.
- Any other row without a finite value in each axis is a lost sample. Its place is known, and it is a gap.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector
from gmwm.readers.base import Rows
from gmwm.readers.time_stamps import Timing
from gmwm.remarks import Remark
from gmwm.time_base import TimeBase

MISSING = int(np.iinfo(np.int64).min)
"""A missing integer, which is also the missing time of NumPy (NaT)."""


def is_missing(column: NDArray[np.generic]) -> NDArray[np.bool_] | None:
    """The rows without a finite number; None if there is none.

    >>> is_missing(np.array([1.0, np.nan])), is_missing(np.array([1, 2]))
    (array([False,  True]), None)
    """
    if column.dtype.kind != "f":
        missing = column == MISSING
        return missing if missing.any() else None
    with np.errstate(over="ignore", invalid="ignore"):
        if np.isfinite(np.sum(column)):  # one fast pass decides the usual case
            return None
        missing = ~np.isfinite(column)
    return missing if missing.any() else None


@dataclass(frozen=True)
class Sifted:
    """Rows of a recording that its clock counts, and which of them are lost samples.

    Attributes
    ----------
    rows : mapping of column index to (n,) array
    lost : (n,) array of bool, or None
        Rows without a value in some axis; None if there is none.
    cut : (n + 1,) array of bool, or None
        Rows before which a row that cannot be placed was left out; the last number is that of the row that follows.
    unplaced, other : int
        Number of rows that were left out because they have no time stamp, and because they have no value in any axis.
    """

    rows: Rows
    lost: NDArray[np.bool_] | None = None
    cut: NDArray[np.bool_] | None = None
    unplaced: int = 0
    other: int = 0


def sift(rows: Rows, columns: Mapping[str, int], axes: Iterable[str]) -> Sifted:
    """Leave out the rows that the clock does not count, and mark those that are lost samples.

    Parameters
    ----------
    rows : mapping of column index to (n,) array
        Consecutive rows of a file.
    columns : mapping of role to column index
        Roles such as "gyro_x", "time" and "temperature".
    axes : iterable of str
        The axes among the roles.
    """
    missing = [is_missing(rows[columns[axis]]) for axis in axes]
    unstamped = is_missing(rows[columns["time"]]) if "time" in columns else None
    if unstamped is None and not any(one is not None for one in missing):
        return Sifted(rows)
    size = next(iter(rows.values())).size
    each = [np.zeros(size, dtype=bool) if one is None else one for one in missing]
    lost, empty = np.any(each, axis=0), np.all(each, axis=0)
    if "time" not in columns:
        return Sifted(rows, lost)
    away = np.zeros(size, dtype=bool) if unstamped is None else unstamped
    out = away | empty
    kept = ~out
    cut = None
    if away.any():
        cut = np.zeros(int(np.count_nonzero(kept)) + 1, dtype=bool)
        cut[np.cumsum(kept)[away]] = True
    left = {k: column[kept] for k, column in rows.items()} if out.any() else rows
    lost = lost[kept]
    return Sifted(
        left,
        lost if lost.any() else None,
        cut=cut,
        unplaced=int(np.count_nonzero(away)),
        other=int(np.count_nonzero(out & ~away)),
    )


def dead_axes(rows: Rows, columns: Mapping[str, int], axes: Iterable[str]) -> dict[str, float]:
    """The axes that have the same value in all rows, with that value; NaN for an axis without a finite value."""
    found = {}
    for axis in axes:
        column = np.asarray(rows[columns[axis]])
        missing = is_missing(column)
        there = column if missing is None else column[~missing]
        if not there.size:
            found[axis] = float("nan")
        elif there[0] == there[-1] and bool(np.all(there == there[0])):
            found[axis] = float(there[0])
    return found


def as_floats(column: NDArray[np.generic]) -> Vector:
    """The numbers as float64, missing integers as NaN."""
    floats: Vector = column.astype(np.float64, copy=False)
    if column.dtype.kind != "f" and (missing := is_missing(column)) is not None:
        floats[missing] = np.nan
    return floats


def about_lost(base: TimeBase) -> Iterator[Remark]:
    """A remark if samples are lost."""
    if base.lost:
        yield Remark.of("samples-lost", count=base.lost)


def without_lost(timing: Timing, sifted: Sifted) -> Timing:
    """The timing of the samples that are left, from that of all rows which the clock counts."""
    lost, cut = sifted.lost, sifted.cut
    if lost is None and cut is None:
        return timing
    rate, rows = timing.base.rate, timing.segments[-1][1]
    present = np.flatnonzero(~lost) if lost is not None else np.arange(rows)
    breaks = np.zeros(rows, dtype=bool)
    breaks[[first for first, _ in timing.segments]] = True
    if cut is not None:
        breaks |= cut[:rows]
    # A sample begins a segment if a row between it and the sample before is lost or begins a segment.
    so_far = np.cumsum(breaks)
    begins = np.flatnonzero((np.diff(so_far[present]) > 0) | (np.diff(present) > 1)) + 1
    begins = np.concatenate([[0], begins])
    firsts = np.array([first for first, _ in timing.segments])
    segment = np.searchsorted(firsts, present[begins], side="right") - 1
    times = np.array(timing.starts)[segment] + (present[begins] - firsts[segment]) / rate
    pairs = [(int(present[k - 1]), int(present[k])) for k in begins[1:]]
    gaps = gaps_of(pairs, [int(k) for k in begins[1:]], stamped=timing.base.gaps, rate=rate)
    base = replace(
        timing.base,
        start=float(times[0]),
        gaps=gaps,
        lost=sifted.unplaced + (0 if lost is None else int(np.count_nonzero(lost))),
    )
    edges = [*(int(k) for k in begins), present.size]
    return replace(timing, base=base, segments=tuple(pairwise(edges)), starts=tuple(map(float, times)))


def gaps_of(
    pairs: Sequence[tuple[int, int]], samples: Sequence[int], stamped: Sequence[tuple[int, float]], rate: float
) -> tuple[tuple[int, float], ...]:
    """The gaps of a recording with lost samples: index of the first sample after each, and its duration (s).

    Parameters
    ----------
    pairs : sequence of (row, row)
        The rows of the samples before and after each gap.
    samples : sequence of int
        The index of the sample after each gap.
    stamped : sequence of (row, seconds)
        The gaps in the time stamps: the first row after each, and the time between the two rows.
    rate : float
        Samples per second (Hz).
    """
    found, rest = [], deque(stamped)
    for (before, after), sample in zip(pairs, samples, strict=True):
        inside = []
        while rest and rest[0][0] <= after:
            row, seconds = rest.popleft()
            inside += [seconds] if row > before else []
        # Rows between are one interval apart, except at the gaps of the time stamps.
        found.append((sample, sum(inside) + (after - before - len(inside)) / rate))
    return tuple(found)


def temperature_of(rows: Rows, columns: Mapping[str, int], sifted: Sifted) -> Vector | None:
    """The temperature of each sample that is left, without NaN; None if it is missing everywhere.

    Where it is missing, it is interpolated linearly: by the time stamps if they increase, so that rows of the
    temperature alone are used too, and over the rows otherwise.
    """
    k = columns["temperature"]
    known = is_missing(rows[k])
    column = np.asarray(sifted.rows[k], dtype=np.float64)
    if known is None or is_missing(column) is None:
        return column if sifted.lost is None else column[~sifted.lost]
    there = ~known
    if not there.any():
        return None
    values = np.asarray(rows[k], dtype=np.float64)
    at, places = np.arange(column.size), np.arange(values.size)
    if "time" in columns:
        stamps, left = rows[columns["time"]], sifted.rows[columns["time"]]
        away = is_missing(stamps)
        there = there if away is None else there & ~away
        at, places = ((one - left[0]).astype(np.float64) for one in (left, stamps))
    if not there.any() or np.any(np.diff(places[there]) <= 0):
        finite = np.isfinite(column)
        if not finite.any():
            return None
        at, places, values, there = np.arange(column.size), np.arange(column.size), column, finite
    filled: Vector = np.interp(at, places[there], values[there])
    return filled if sifted.lost is None else filled[~sifted.lost]
