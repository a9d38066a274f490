"""`stream`: a recording as pieces in SI units, for files larger than memory.

What the first rows say of units and rate holds for all; values, segments and their times are those that `read` gives.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector, as_rate
from gmwm._late import LateMethod
from gmwm.errors import GmwmWarning, InferredUnitWarning, OptionError, TimeBaseWarning
from gmwm.readers.base import Chunk, Layout, existing_file, find_reader
from gmwm.readers.columns import Choice, Columns, choose
from gmwm.readers.factors import checked_increments, checked_scale, multiply
from gmwm.readers.recording import (
    column_words,
    constant,
    one_layout,
    require_finite_rows,
    require_samples,
    require_time,
    timing_of,
)
from gmwm.readers.running import RunningClock, Settled
from gmwm.readers.scales import checked_units, resolve, time_unit
from gmwm.readers.timebase import Timing, as_stamps, troubles_of
from gmwm.signals import TimeBase

HEAD = 1 << 18
"""Rows at least by which units, rate and time stamps are understood, if there are as many."""


@dataclass(frozen=True, eq=False)
class Piece:
    """Consecutive samples of a recording without a gap between them.

    Attributes
    ----------
    values : mapping of axis name to (n,) array, in rad/s or m/s²
    first : int
        Number of the first of them in the recording, from 0.
    segment : int
        Number of the segment that they are of, from 0: another one than that of the piece before where there was a gap.
    start : float
        Time of the first of them (s), on the recording's own clock.
    """

    values: Mapping[str, Vector]
    first: int
    segment: int
    start: float

    def __len__(self) -> int:
        return int(next(iter(self.values.values())).size)

    def __getitem__(self, axis: str) -> Vector:
        return self.values[axis]


@dataclass(frozen=True, eq=False)
class Understood:
    """What the first rows of a recording say of all of it.

    Attributes
    ----------
    choice : Choice
        The columns that are read, temperature not among them.
    words : mapping
        What each column is called in messages.
    factors : mapping of axis to factors
        What the numbers of the file are multiplied by, one after the other.
    timing : Timing
        Rate and segments of the first rows.
    stamps : (n,) array or None
        The stamps of the first rows, as they stand in the file.
    unit : str
        Their unit.
    notes, inferred, doubts : tuple of str
        What was understood, what of it was told from the numbers, and what speaks against it.
    """

    choice: Choice
    words: Mapping[str, str]
    factors: Mapping[str, tuple[float, ...]]
    timing: Timing
    stamps: NDArray[Any] | None
    unit: str
    notes: tuple[str, ...]
    inferred: tuple[str, ...]
    doubts: tuple[str, ...]

    @property
    def rate(self) -> float:
        """Samples per second (Hz)."""
        return self.timing.base.rate


class Stream:
    """A recording in a file, piece by piece; made by `gmwm.stream`. Each iteration reads the file anew.

    Attributes
    ----------
    source : str
        Where it comes from.
    rate : float
        Samples per second (Hz).
    axes : tuple of str
        Names of the axes, gyroscopes first.
    time_base : TimeBase
        What the time stamps say: those of all rows once they were read to the end, of the first ones before.
    notes : tuple of str
        What was understood, in plain words.
    """

    wavelet_variance: ClassVar[LateMethod[..., Any]] = LateMethod(
        "gmwm.streaming.driver:stream_variance",
        "The wavelet variance of each axis in one pass, as wavelet_variance(levels=…, exact=…, confidence=…).",
    )

    def __init__(self, source: str, found: Understood, chunks: Callable[[], Iterator[Chunk]], size: int) -> None:
        self.source, self.rate, self.axes, self.notes = source, found.rate, found.choice.axes, found.notes
        self.time_base = found.timing.base
        self._found, self._chunks, self._size = found, chunks, size

    def __iter__(self) -> Iterator[Piece]:
        return pieces(self._found, self._chunks(), self._size, self.source, self._ended)

    def _ended(self, base: TimeBase) -> None:
        self.time_base = base

    def __repr__(self) -> str:
        return f"Stream({', '.join(self.axes)} at {self.rate:g} Hz, from {self.source})"


def stream(
    path: str | os.PathLike[str],
    rate: float | None = None,
    columns: Columns | None = None,
    units: Mapping[str, str] | None = None,
    *,
    chunk: int = 1_000_000,
    format: str | None = None,
    scale: Mapping[str, float] | None = None,
    increments: bool | Sequence[str] = (),
    topic: str | None = None,
) -> Stream:
    """A static recording from a file, in rad/s and m/s², a piece at a time: for files larger than memory.

    Units, rate and the unit of time stamps are understood from the first rows, 2¹⁸ of them or more; after that memory
    does not grow with the file, if it is text, Parquet, .npy, HDF5 or .imu. What is packed as a whole (.npz, zip,
    MATLAB) is unpacked as a whole. The values are those of `read`, bit for bit; a gap in the time stamps begins a new
    segment, as there. Of a file of more rows `read` knows the rate from all of them: pass `rate` where jitter makes a
    difference. `.wavelet_variance()` measures all axes in one pass.

    Parameters
    ----------
    path, rate, columns, units, format, scale, increments, topic
        As of `read`.
    chunk : int
        Samples in a piece, at the most.

    Returns
    -------
    Stream
        Iterate over it for its pieces, as often as wanted.

    Raises
    ------
    ReadError, UnitError, DataError, OptionError
        As `read`; what is wrong behind the first rows is told when it is reached.

    Warns
    -----
    InferredUnitWarning
        If the accelerometers' unit was told from their norm.
    TimeBaseWarning
        At the end, if time stamps repeat, step backward or jitter, or say another rate than the first ones.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> folder = tempfile.TemporaryDirectory()
    >>> path = pathlib.Path(folder.name, "static.csv")
    >>> rows = "".join(f"{k / 100 + (k > 5):.2f},{(-1) ** k * 0.1}\\n" for k in range(16))
    >>> _ = path.write_text("time,gyro_x [rad/s]\\n" + rows)
    >>> sorted({(piece.segment, piece.values["gyro_x"].size <= 4) for piece in stream(path, chunk=4)})
    [(0, True), (1, True)]
    >>> folder.cleanup()
    """
    if isinstance(chunk, bool) or not isinstance(chunk, int | np.integer) or chunk < 1:
        raise OptionError(f"chunk must be a whole number of samples, 1 or more; got {chunk!r}")
    declared_rate = None if rate is None else as_rate(rate)
    declared_units = checked_units(units)
    factors, integrals = checked_scale(scale), checked_increments(increments)
    file = existing_file(path)
    reader = find_reader(file, format)
    layout = one_layout(reader, file, topic)
    choice = streamed(choose(layout, columns, file))
    require_time(layout, choice, declared_rate, file)
    wanted = list(choice.columns.values())
    head = first_rows(reader.chunks(file, layout, wanted), choice)
    found = understand(layout, choice, head, file, declared_rate, declared_units, factors, integrals)
    tell(found, file)
    return Stream(str(path), found, lambda: reader.chunks(file, layout, wanted), int(chunk))


def streamed(choice: Choice) -> Choice:
    """The columns of which pieces are made: axes and time."""
    return Choice({role: k for role, k in choice.columns.items() if role != "temperature"}, choice.notes)


def first_rows(chunks: Iterable[Chunk], choice: Choice, rows: int = HEAD) -> dict[str, NDArray[Any]]:
    """So many rows of each column or more, or all there are."""
    taken, count = [], 0
    for chunk in chunks:
        taken.append(chunk)
        count += next(iter(chunk.values())).size
        if count >= rows:
            break
    return {role: np.concatenate([part[k] for part in taken] or [np.empty(0)]) for role, k in choice.columns.items()}


def understand(
    layout: Layout,
    choice: Choice,
    head: Mapping[str, NDArray[Any]],
    path: Path,
    rate: float | None,
    units: Mapping[str, str],
    factors: Mapping[str, float],
    integrals: Sequence[str],
) -> Understood:
    """What the first rows of a recording say of all of it, by the arguments of `read`, checked."""
    words = {role: column_words(layout, choice, role, path) for role in choice.columns}
    for role, column in head.items():
        require_samples(column.size, words[role])
        require_finite_rows(column, words[role])
    time, time_notes = timing_of(layout, choice, units, head, rate)
    stamps = head.get("time")
    unit = ""
    if stamps is not None:
        unit = time_unit(layout, choice, units)[0]
        unit = unit or as_stamps(stamps, "", rate)[0].unit
    ones = {axis: np.ones(1) for axis in choice.axes}
    scale_notes = multiply(layout, choice, factors, integrals, ones, time.base.rate)
    numbers = {axis: head[axis].astype(np.float64) * ones[axis] for axis in choice.axes}
    scales = resolve(layout, choice, units, numbers, time.base.rate, integrals)
    found = {
        axis: tuple(f for f in (float(ones[axis][0]), scales.units[axis].factor) if f != 1) for axis in choice.axes
    }
    notes = (
        *layout.notes, *choice.notes, *scale_notes, *scales.notes, *scales.inferred, *time_notes, *time.notes
    )  # fmt: skip
    # Of the stamps themselves the end will tell; a rate that the file states beside them is known now.
    stated = set(time.troubles) - set(troubles_of(time.base, len(next(iter(head.values())))))
    doubts = (*scales.doubts, *sorted(stated))
    return Understood(choice, words, found, time, stamps, unit, notes, scales.inferred, doubts)


def tell(found: Understood, path: object) -> None:
    """Warn of what was only inferred."""
    for category, sentences in ((InferredUnitWarning, found.inferred), (GmwmWarning, found.doubts)):
        for sentence in sentences:
            warnings.warn(f"{path}: {sentence}", category, stacklevel=3)


def pieces(
    found: Understood,
    chunks: Iterable[Chunk],
    size: int,
    path: object,
    ended: Callable[[TimeBase], None] = lambda base: None,
) -> Iterator[Piece]:
    """The pieces that chunks of a file make, of `size` samples at the most; `ended` is told what all stamps say.

    Raises
    ------
    ReadError, DataError
        At what `read` refuses, when it is reached.
    """
    clock = None if found.stamps is None else RunningClock(found.stamps, found.unit, found.timing)
    columns, axes = found.choice.columns, found.choice.axes
    alike = _Alike(found)
    waiting: dict[str, Vector] = {axis: np.empty(0) for axis in axes}  # rows whose segment is not known yet
    came, segment, begun = 0, 0, (0, 0.0)
    for chunk in _and_end(chunks):
        if chunk is not None:
            for role, k in columns.items():
                require_finite_rows(chunk[k], found.words[role], came)
            values = {axis: _in_si(chunk[columns[axis]], found.factors[axis]) for axis in axes}
            came += values[axes[0]].size
            alike.take({axis: chunk[columns[axis]] for axis in axes})
            ready = {axis: _joined(waiting[axis], v) for axis, v in values.items()}
        else:
            ready = waiting
        first = came - ready[axes[0]].size
        if clock is None:
            settled = Settled(came, (0,) if first == 0 else (), (0.0,) if first == 0 else ())
        else:
            settled = clock.end() if chunk is None else clock.take(chunk[columns["time"]])
        stop, times = settled.stop, dict(zip(settled.firsts, settled.starts, strict=True))
        waiting = {axis: v[stop - first :] for axis, v in ready.items()}
        for a, b in pairwise(sorted({first, *times, stop})):
            if a in times:
                segment, begun = segment + (a > 0), (a, times[a])
            for k in range(a, b, size):
                part = slice(k - first, min(k + size, b) - first)
                start = begun[1] + (k - begun[0]) / found.rate
                yield Piece({axis: v[part] for axis, v in ready.items()}, k, segment, start)
    alike.require_different(came)
    if clock is not None:
        ended(clock.base())
    for sentence in clock.troubles() if clock is not None else ():
        warnings.warn(f"{path}: {sentence}", TimeBaseWarning, stacklevel=2)


def _and_end(chunks: Iterable[Chunk]) -> Iterator[Chunk | None]:
    yield from chunks
    yield None


def _joined(before: Vector, after: Vector) -> Vector:
    return np.concatenate([before, after]) if before.size else after


def _in_si(numbers: NDArray[Any], factors: Sequence[float]) -> Vector:
    values: Vector = np.asarray(numbers).astype(np.float64, copy=False)
    for factor in factors:
        values = values * factor
    return values


class _Alike:
    """Whether an axis has ever had another value than its first."""

    def __init__(self, found: Understood) -> None:
        self._words = found.words
        self._constant: dict[str, float | None] = dict.fromkeys(found.choice.axes)

    def take(self, numbers: Mapping[str, NDArray[Any]]) -> None:
        for axis in list(self._constant):
            column, known = numbers[axis], self._constant[axis]
            value = float(column[0]) if known is None and column.size else known
            if column.size and (column[-1] != value or bool(np.any(column != value))):
                del self._constant[axis]
            else:
                self._constant[axis] = value

    def require_different(self, samples: int) -> None:
        for axis, value in self._constant.items():
            if value is not None:
                raise constant(self._words[axis], axis, value, samples)
