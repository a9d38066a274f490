"""Divide a long recording into consecutive parts that other processes or machines can read independently.

A part has a range of rows and the recording's properties; rows before it show whether the last one there is lost."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from gmwm.base.errors import OptionError, ReadError
from gmwm.files.clock.missing_values import Sifted, sift
from gmwm.files.contract import Layout, Mark, Reader, existing_file
from gmwm.files.readers.builder import RowSummary, SampleBuilder
from gmwm.files.readers.interpretation import Interpretation
from gmwm.files.readers.streams import FileRows, Stream
from gmwm.files.readers.topics import SeveralFiles, reopen
from gmwm.recording.chunks import Chunk, Samples

SHORTEST_PART = 4096  # smallest number of rows of a part. Reading fewer rows takes less time than opening the file


@dataclass(frozen=True, eq=False)
class Part:
    """Consecutive rows of a recording in a file, small enough to be sent to other processes. Iteration yields chunks.

    Segment 0 is that in which the previous part ends, so a part after a gap begins with segment 1. `bytes` shows
    changes of the file; `back`, `begin` and `end` are marks before the part, at its start and at its end."""

    path: Path
    bytes: int
    format: str
    topic: str | None
    found: Interpretation
    size: int
    back: Mark
    begin: Mark
    end: Mark
    whole: bool = False
    skip_bad_lines: bool = False

    @property
    def first(self) -> int:
        """Index in the recording of the first row of the part, from 0."""
        return self.begin.row

    @property
    def stop(self) -> int | None:
        """Index of the row after the last one; None for a whole recording whose rows were not counted."""
        return None if self.whole else self.end.row

    def __iter__(self) -> Iterator[Chunk]:
        for samples in PartReader(self).samples():
            yield from samples.chunks(self.size)

    def __repr__(self) -> str:
        rows = "all rows" if self.whole else f"rows {self.first} to {self.end.row}"
        return f"Part({rows} of {self.path})"


class PartReader:
    """Reads a part once. `summary` is available after the last chunk."""

    summary: RowSummary

    def __init__(self, part: Part) -> None:
        self._part = part

    def samples(self) -> Iterator[Samples]:
        """Iterate over the samples of the part."""
        part = self._part
        self._reader, self._layout = _open(part)
        columns = list(part.found.choice.columns.values())
        builder = SampleBuilder(part.found, part.first, self._lost_before())
        if part.whole:
            chunks = self._reader.chunks(part.path, self._layout, columns)
        else:
            chunks = self._reader.chunks_from(part.path, self._layout, columns, part.begin)
        row = part.first
        for rows in chunks:
            row += next(iter(rows.values())).size
            yield from builder.add(rows)
            if part.stop is not None and row >= part.stop:
                break
        if part.stop is not None and row != part.stop:
            raise ReadError(
                f"{part.path} has other rows than when it was divided",
                code="changed",
                advice="Read a file that no program is writing, with the same version of gmwm on all machines.",
            )
        yield from builder.end()
        self.summary = builder.summary()

    def _lost_before(self) -> bool:
        """Return whether the row before the part is lost."""
        part = self._part
        if part.first == 0:
            return False
        rows = self._rows(part.back, part.first)
        lost = rows.lost is not None and bool(rows.lost[-1:].any())
        return lost or (rows.cut is not None and bool(rows.cut[-1]))

    def _rows(self, mark: Mark, stop: int) -> Sifted:
        """Return the rows from a mark up to row `stop`."""
        choice, row, taken = self._part.found.choice, mark.row, []
        columns = list(choice.columns.values())
        for chunk in self._reader.chunks_from(self._part.path, self._layout, columns, mark):
            taken.append({k: column[: stop - row] for k, column in chunk.items()})
            row += next(iter(chunk.values())).size
            if row >= stop:
                break
        rows = {k: np.concatenate([rows_of[k] for rows_of in taken]) if taken else np.empty(0) for k in columns}
        return sift(rows, choice.columns, choice.axes)


def parts_of(stream: Stream, count: int) -> tuple[Part, ...]:
    """Split a recording into consecutive parts; see `Stream.parts`."""
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
        raise OptionError(argument="count", expected="a whole number of parts from 1", got=count)
    origin = stream._rows
    if not isinstance(origin, FileRows):
        raise OptionError(
            "a growing recording cannot be divided into parts", advice="Save it to a file and pass the file."
        )
    if isinstance(origin.reader, SeveralFiles):
        raise OptionError(
            "a recording in several files cannot be divided into parts",
            advice="Leave {--scheduler} and {--workers} out, or write the recording to one file with `gmwm convert`.",
        )
    if stream._kept is not None:
        raise OptionError(
            "a recording from which time ranges are left out cannot be divided into parts",
            advice="Write the time ranges to keep to a file of their own instead of {--start}, {--stop} or {--skip}.",
        )
    # If rows are left out, the row numbers of the clock differ from those of the file. The recording is then one part.
    marks = () if stream._found.sparse else origin.reader.marks(origin.path, origin.layout)
    cuts = _cuts(marks, int(count))
    recording = Part(
        path=origin.path, bytes=origin.path.stat().st_size, format=origin.reader.name, topic=origin.topic,
        found=stream._found.without_temperature(), size=stream._size, back=Mark(0), begin=Mark(0), end=Mark(0),
        whole=True, skip_bad_lines=origin.layout.skip_bad_lines,
    )  # fmt: skip
    if not cuts:
        return (recording,)
    edges = [0, *cuts, len(marks) - 1]
    return tuple(
        replace(recording, back=marks[max(a - 1, 0)], begin=marks[a], end=marks[b], whole=False)
        for a, b in pairwise(edges)
    )


def _cuts(marks: Sequence[Mark], count: int) -> list[int]:
    """Return the indices of the marks at which the second and the later parts begin."""
    rows = [mark.row for mark in marks]
    cuts, last = list[int](), 0
    for k in range(1, count) if rows else ():
        target = rows[-1] * k / count
        nearest = min(range(len(rows)), key=lambda m: abs(rows[m] - target))
        if rows[nearest] - rows[last] >= SHORTEST_PART and rows[-1] - rows[nearest] >= SHORTEST_PART:
            cuts.append(nearest)
            last = nearest
    return cuts


def _open(part: Part) -> tuple[Reader, Layout]:
    """Return the reader and the layout of the file, after a check that the file has not changed."""
    try:
        path = existing_file(part.path)
    except ReadError as error:
        raise ReadError(
            error.reason,
            code="not-found",
            advice="Make the file available at this path on every machine that reads a part.",
        ) from None
    if path.stat().st_size != part.bytes:
        raise ReadError(
            f"{path} has {path.stat().st_size} bytes, and had {part.bytes} when it was divided into parts: "
            "the file was replaced or changed", code="changed", advice="Divide the recording again.",
        )  # fmt: skip
    return reopen(path, part.format, part.topic, skip_bad_lines=part.skip_bad_lines)
