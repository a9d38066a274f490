"""Read KITTI's OXTS folder: timestamps.txt, and 30 numbers per sample in data/ (dataformat.txt of the raw data: ax, ay,
az in m/s² and wx, wy, wz in rad/s in the body frame)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gmwm.base.errors import ReadError
from gmwm.base.lazy import polars as pl
from gmwm.base.remarks import Remark
from gmwm.files.clock.text_stamps import form_remark, is_stamp, times_of
from gmwm.files.contract import CHUNK_ROWS, Channel, Layout, Reader, Rows, register

_FIELDS, _FIRST = 30, {"accel": 11, "gyro": 17}
"""Number of numbers in a file, and the index of the x axis of each sensor."""


@register
class OxtsReader(Reader):
    """Reader of the folder oxts of a drive of KITTI."""

    name: ClassVar[str] = "oxts"
    folder_sign: ClassVar[str] = "timestamps.txt"

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0.9 for timestamps.txt beside files with 30 numbers."""
        first = next(iter(_files(path)), None) if path.name == self.folder_sign else None
        return 0.9 if first is not None and len(first.read_text(encoding="latin-1").split()) == _FIELDS else 0.0

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return one recording with six axes."""
        first = path.read_text(encoding="latin-1").partition("\n")[0].strip()
        if not is_stamp(first):
            raise ReadError(f"{path} begins with {first[:40]!r}, expected a date with a time", code="dates-unreadable")
        axes = [f"{sensor}_{letter}" for sensor in ("gyro", "accel") for letter in "xyz"]
        units = {"gyro": "rad/s", "accel": "m/s²"}
        channels = (Channel("timestamps.txt", "ns", "time"), *(Channel(axis, units[axis[:-2]], axis) for axis in axes))
        remarks = (Remark.of("file-content", case="layout", format="KITTI's oxts"), form_remark(first))
        return (Layout(channels, (first,), remarks=remarks),)

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield the numbers, one file for each sample."""
        lines = [line.strip() for line in path.read_text(encoding="latin-1").splitlines() if line.strip()]
        files = _files(path)
        if len(lines) != len(files):
            raise ReadError(
                f"{path} has {len(lines)} time stamps for {len(files)} files in {path.parent / 'data'}",
                code="files-missing", advice="Copy the folder again.",
            )  # fmt: skip
        for begin in range(0, len(files), CHUNK_ROWS):
            table = np.array([_numbers(file) for file in files[begin : begin + CHUNK_ROWS]])
            times = times_of(pl.Series(lines[begin : begin + CHUNK_ROWS]), layout.first_row[0]).view(np.int64)
            chunk: dict[int, NDArray[Any]] = {}
            for k in wanted:
                axis = layout.channels[k].axis
                chunk[k] = times if axis == "time" else table[:, _FIRST[axis[:-2]] + "xyz".index(axis[-1])].copy()
            yield chunk


def _files(path: Path) -> list[Path]:
    """Return the files beside timestamps.txt in the order of their numbers."""
    return sorted((path.parent / "data").glob("*.txt"))


def _numbers(file: Path) -> list[float]:
    """Return the numbers in a file."""
    cells = file.read_text(encoding="latin-1").split()
    try:
        numbers = [float(cell) for cell in cells]
    except ValueError:
        numbers = []
    if len(numbers) != _FIELDS:
        raise ReadError(f"{file} does not hold {_FIELDS} numbers", code="row-invalid", advice="Copy the file again.")
    return numbers
