"""An input format: the files of a logger."""

import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np
from gmwm.errors import ReadError
from gmwm.readers import Channel, Layout, Reader, Rows, register
from gmwm.remarks import Remark

AXES = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
HEAD = struct.Struct("<4s3f")
ROW = 12  # bytes


@register
class LogReader(Reader):
    """Logs of my own logger, recognized by the signature LOG1."""

    name: ClassVar[str] = "mylog"
    extensions: ClassVar[tuple[str, ...]] = (".log1",)

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 1 for the signature, otherwise 0. The content decides, not the name."""
        return 1.0 if head.startswith(b"LOG1") else 0.0

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Describe the content of the file without reading its samples."""
        with path.open("rb") as file:
            _, rate, gyro, accel = HEAD.unpack(file.read(HEAD.size))
        if (path.stat().st_size - HEAD.size) % ROW:
            raise ReadError(f"{path} ends within a sample", code="cut-off", advice="Copy the file again.")
        channels = [Channel(a, unit="deg/s", axis=a, scale=gyro) for a in AXES[:3]]
        channels += [Channel(a, unit="g", axis=a, scale=accel) for a in AXES[3:]]
        return (
            Layout(
                tuple(channels), rate=rate, remarks=(Remark.of("file-content", case="layout", format="my own logger"),)
            ),
        )

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield the wanted columns, a million rows at a time."""
        with path.open("rb") as file:
            file.seek(HEAD.size)
            while block := file.read(ROW * 1_000_000):
                rows = np.frombuffer(block, "<i2").reshape(-1, 6)
                yield {k: rows[:, k].astype(np.float64) for k in wanted}
