"""Read several files that continue one another, such as a file for each hour, as one recording.

The files are given as a sequence of paths, or as a pattern such as logs/hour_*.csv. The files of a pattern are sorted
by the numbers in their names. The time stamps show how many samples are missing between two files. Without time stamps,
this number is unknown, so the recording is split there and nothing is filled.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from gmwm.base.errors import ReadError
from gmwm.base.remarks import Remark
from gmwm.base.text import printable
from gmwm.files.clock.lost_samples import CUT
from gmwm.files.contract import Layout, Reader, Rows, existing_file, find_reader

Source = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]
"""A file, a pattern, or a sequence of files."""


def found_reader(path: Source, format: str | None) -> tuple[Path, Reader]:
    """Return the file and its reader; for several files, the first file and a reader of all of them."""
    files = [existing_file(file) for file in files_of(path)]
    readers = [find_reader(file, format) for file in files]
    return files[0], readers[0] if len(files) == 1 else SeveralFiles(files, readers)


def files_of(path: Any) -> list[Any]:
    """Return the paths of a recording: a single path, the items of a sequence, or the matches of a pattern."""
    if isinstance(path, list | tuple) and path:
        return list(path)
    if not isinstance(path, str | os.PathLike) or not re.search(r"[*?\[]", os.fsdecode(path)) or Path(path).exists():
        return [path]
    pattern = Path(os.fsdecode(path))
    anchor = Path(pattern.anchor) if pattern.anchor else Path()
    matches = anchor.glob(str(pattern.relative_to(pattern.anchor) if pattern.anchor else pattern))
    return sorted(matches, key=_in_order) or [path]


def _in_order(path: Path) -> list[tuple[int, str]]:
    """Return a key that sorts numbers in names by their size: hour_2 before hour_10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", str(path))]


def source_words(path: Source) -> str:
    """Return the name of a recording for titles.

    >>> source_words("a.csv"), source_words(["a.csv", "b.csv", "c.csv"])
    ('a.csv', 'a.csv and 2 more')
    """
    if isinstance(path, str | os.PathLike):
        return printable(os.fsdecode(path))
    return printable(f"{path[0]} and {len(path) - 1} more" if len(path) > 1 else str(path[0]))


class SeveralFiles(Reader):
    """Reads several files one after the other. It is not registered: the number of files chooses it."""

    name: ClassVar[str] = "several files"
    extensions: ClassVar[tuple[str, ...]] = ()

    def __init__(self, files: Sequence[Path], readers: Sequence[Reader]) -> None:
        self._files, self._readers = tuple(files), tuple(readers)

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0, because this reader is chosen by the number of files."""
        return 0.0

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return the recordings of the first file."""
        joined = Remark.of("file-content", case="files", files=tuple(file.name for file in self._files))
        return tuple(
            replace(layout, remarks=(*layout.remarks, joined)) for layout in self._readers[0].layouts(self._files[0])
        )

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield the rows of all files."""
        for k, (file, reader) in enumerate(zip(self._files, self._readers, strict=True)):
            file_layout = layout if k == 0 else self._alike(file, reader, layout, wanted)
            cut = k > 0 and not layout.stamped
            for rows in reader.chunks(file, file_layout, wanted):
                yield _cut_before(rows) if cut else rows
                cut = False

    def _alike(self, file: Path, reader: Reader, layout: Layout, wanted: Sequence[int]) -> Layout:
        """Return the recording of another file that continues the recording of the first file."""
        for candidate in reader.layouts(file):
            names = [channel.name for channel in candidate.channels]
            same = len(names) == len(layout.channels) and all(names[k] == layout.channels[k].name for k in wanted)
            if candidate.topic == layout.topic and same:
                return replace(candidate, skip_bad_lines=layout.skip_bad_lines)
        shown = ", ".join(layout.channels[k].name or f"number {k}" for k in wanted)
        raise ReadError(
            f"{file} does not continue {self._files[0]}: it has no recording with the same columns, {shown}",
            code="not-continued",
            advice="Read the two files one at a time.",
        )


def _cut_before(rows: Rows) -> Rows:
    """Add a mark that splits the recording before the first of the rows."""
    cut = np.zeros(next(iter(rows.values())).size, dtype=bool)
    cut[:1] = True
    return {**rows, CUT: cut}
