"""Find rows of a file without a usable sample, because of missing values, unreadable lines, or other messages.

Rows with a time stamp only are other messages, left out: stamps show gaps. Rows without one are left out too, and split
the recording. Others without a finite value in each axis (`MISSING`, NaN) are lost samples, and gaps."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.base.errors import ReadError
from gmwm.base.remarks import Remark
from gmwm.base.text import counted
from gmwm.base.time_base import TimeBase
from gmwm.base.units import IMPOSSIBLE
from gmwm.files.contract import Rows

CUT = -1  # key of a Boolean column: before a marked row, an unknown number of samples is missing
MISSING = int(np.iinfo(np.int64).min)  # Value of a missing integer. It is also the missing time of NumPy (NaT).


def is_missing(column: NDArray[np.generic]) -> NDArray[np.bool_] | None:
    """Return a mask of the rows without a finite number; None if there is no such row.

    >>> is_missing(np.array([1.0, np.nan])), is_missing(np.array([1, 2]))
    (array([False,  True]), None)
    """
    if column.dtype.kind != "f":
        missing = column == MISSING
        return missing if missing.any() else None
    with np.errstate(over="ignore", invalid="ignore"):
        if np.isfinite(column.sum()):  # one fast pass decides the usual case
            return None
        missing = ~np.isfinite(column)
    return missing if missing.any() else None


@dataclass(frozen=True)
class Sifted:
    """The rows that the clock of a recording counts, and masks of the lost samples and splits among them."""

    rows: Rows  # the rows that the clock counts
    # mask of the rows without a value in at least one axis; None if there is no such row
    lost: NDArray[np.bool_] | None = None
    # mask of rows before which the recording is split, or None; the last entry is for the next row after these
    cut: NDArray[np.bool_] | None = None
    # number of rows that were left out because they have no time stamp, and because they have no value in any axis
    unplaced: int = 0
    other: int = 0
    # number of the lost rows in which each axis has no value; empty if no row is lost
    lacking: Mapping[str, int] = field(default_factory=dict)


def sift(rows: Rows, columns: Mapping[str, int], axes: Iterable[str]) -> Sifted:
    """Leave out the rows that the clock does not count, and mark lost samples."""
    marked = rows.get(CUT)
    if marked is not None:
        sifted = sift({k: column for k, column in rows.items() if k != CUT}, columns, axes)
        assert sifted.cut is None, "rows with time stamps are not marked"
        return replace(sifted, cut=np.append(marked, False))
    missing = {axis: is_missing(rows[columns[axis]]) for axis in axes}
    unstamped = is_missing(rows[columns["time"]]) if "time" in columns else None
    if unstamped is None and not any(mask is not None for mask in missing.values()):
        return Sifted(rows)
    size = next(iter(rows.values())).size
    each = {axis: np.zeros(size, dtype=bool) if mask is None else mask for axis, mask in missing.items()}
    lost, empty = np.any(list(each.values()), axis=0), np.all(list(each.values()), axis=0)
    if "time" not in columns:
        return Sifted(rows, lost, lacking={axis: int(np.count_nonzero(mask)) for axis, mask in each.items()})
    away = np.zeros(size, dtype=bool) if unstamped is None else unstamped
    out = away | empty
    stays = ~out
    cut = None
    if away.any():
        cut = np.zeros(int(np.count_nonzero(stays)) + 1, dtype=bool)
        cut[np.cumsum(stays)[away]] = True
    remaining = {k: column[stays] for k, column in rows.items()} if out.any() else rows
    lost = lost[stays]
    return Sifted(
        remaining, lost if lost.any() else None, cut=cut, unplaced=int(np.count_nonzero(away)),
        other=int(np.count_nonzero(out & ~away)),
        lacking={axis: int(np.count_nonzero(mask[stays])) for axis, mask in each.items()} if lost.any() else {},
    )  # fmt: skip


def drop(rows: Rows, first: int, ranges: Sequence[tuple[int, int]]) -> Rows:
    """Leave `ranges` of row numbers out of rows that begin with row number `first`."""
    size = next(iter(rows.values())).size
    inside = [(max(a - first, 0), b - first) for a, b in ranges if a < first + size and b > first]
    if not inside:
        return rows
    stays = np.ones(size, dtype=bool)
    for a, b in inside:
        stays[a:b] = False
    return {k: column[stays] for k, column in rows.items()}


def values_of_axes(chunks: Iterable[Rows], columns: Mapping[str, int], axes: Sequence[str]) -> dict[str, int]:
    """Return the number of rows in which each axis has a value."""
    counts = dict.fromkeys(axes, 0)
    for rows in chunks:
        for axis in axes:
            missing = is_missing(rows[columns[axis]])
            counts[axis] += rows[columns[axis]].size - (0 if missing is None else int(np.count_nonzero(missing)))
    return counts


def sparse_axes(counts: Mapping[str, int]) -> list[str]:
    """Return the axes with so many values less than another axis that they would cost it too many samples.

    >>> sparse_axes({"gyro_x": 1000, "gyro_y": 990, "gyro_z": 500})
    ['gyro_z']
    """
    # At three quarters, an axis that ends at half of the recording is left out, and one with scattered gaps is not.
    return [axis for axis, count in counts.items() if count < 0.75 * max(counts.values())]


def dead_axes(rows: Rows, columns: Mapping[str, int], axes: Iterable[str]) -> dict[str, float]:
    """Return the axes with the same value in all rows, with this value; NaN for an axis without a finite value."""
    constants = {}
    for axis in axes:
        column = np.asarray(rows[columns[axis]])
        missing = is_missing(column)
        values = column if missing is None else column[~missing]
        if not values.size:
            constants[axis] = float("nan")
        elif values[0] == values[-1] and bool(np.all(values == values[0])):
            constants[axis] = float(values[0])
    return constants


def as_floats(column: NDArray[np.generic]) -> Vector:
    """Convert numbers to float64, and missing integers to NaN."""
    floats: Vector = column.astype(np.float64, copy=False)
    if column.dtype.kind != "f" and (missing := is_missing(column)) is not None:
        floats[missing] = np.nan
    return floats


def about_lost(base: TimeBase, impossible: int, lacking: Mapping[str, int]) -> Iterator[Remark]:
    """Yield remarks on lost samples: `impossible` for any sensor, or without a value of an axis (`lacking`)."""
    if base.lost > impossible:
        count = base.lost - impossible
        axes = tuple(axis for axis, rows in lacking.items() if 2 * rows > count)
        if axes and len(axes) < len(lacking):
            without = ",".join(f"{axis}:none" for axis in axes)
            yield Remark.of("samples-lost", case="axes", count=count, axes=axes, without=without)
        else:
            yield Remark.of("samples-lost", case="lost", count=count)
    if impossible:
        yield Remark.of("samples-lost", case="impossible", count=impossible, limit=IMPOSSIBLE)


_RECURRING = 100
"""Least number of values that recur after two rows, and of gaps; then repeated rows are missing, beyond chance, if they
are hundred times rarer (tests/readers/test_lost_samples.py)."""


def require_repeated_rows(axes: Mapping[str, Vector], base: TimeBase) -> None:
    """Raise a ReadError if only rows with a new value were written: they depend on the noise."""
    if len(base.gaps) < _RECURRING:
        return
    values = np.stack(list(axes.values()))
    gaps = sum(row < values.shape[1] for row, _ in base.gaps)
    repeated, recurring = (
        int(np.count_nonzero(np.all(values[:, apart:] == values[:, :-apart], axis=0))) for apart in (1, 2)
    )
    if min(gaps, recurring) >= _RECURRING and _RECURRING * repeated <= recurring:
        raise ReadError(
            f"the logger wrote a row only when a value had changed: rows are missing in {counted(gaps, 'gap')}, "
            f"and of the rows, {repeated} repeat the one before, but {recurring} the one before that",
            code="changes-only",
            advice="Write every sample, or repeat the last row at each missing time stamp. Without these rows, the "
            "noise is not that of the sensor.",
        )


def whole_numbers(column: NDArray[np.generic]) -> NDArray[np.int64]:
    """Convert numbers to int64, with `MISSING` for those that are not finite or too large.

    >>> whole_numbers(np.array([3.0, np.nan, 1e30])).tolist() == [3, MISSING, MISSING]
    True
    """
    if column.dtype.kind != "f":
        return column.astype(np.int64)
    usable = np.abs(column) < 2.0**62  # False for NaN
    return np.where(usable, np.where(usable, column, 0.0).astype(np.int64), MISSING)


def gaps_of(
    pairs: Sequence[tuple[int, int]], samples: Sequence[int], stamped: Sequence[tuple[int, float]], rate: float
) -> tuple[tuple[int, float], ...]:
    """Return gaps by first sample after them and duration (s), from the `pairs` of rows around them, the `samples`
    after them, and the gaps of time stamps (`stamped`: row after, time between)."""
    gaps, stamp_gaps = [], deque(stamped)
    for (before, after), sample in zip(pairs, samples, strict=True):
        inside = []
        while stamp_gaps and stamp_gaps[0][0] <= after:
            row, seconds = stamp_gaps.popleft()
            inside += [seconds] if row > before else []
        # Rows between are one interval apart, except at the gaps of the time stamps.
        gaps.append((sample, sum(inside) + (after - before - len(inside)) / rate))
    return tuple(gaps)
