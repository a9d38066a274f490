"""Read CSV files of kalibr_bagcreater. Their seven columns have fixed names and units, those of the ROS messages."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from gmwm.base.remarks import Remark
from gmwm.files.contract import Channel, Layout, register
from gmwm.files.formats.byte_sources import FileSource
from gmwm.files.formats.text import TextReader

_HEADER = b"timestamp,omega_x,omega_y,omega_z,alpha_x,alpha_y,alpha_z"
_UNITS = {"timestamp": "ns", "omega": "rad/s", "alpha": "m/s²"}


@register
class KalibrReader(TextReader):
    """Reader of Kalibr's imu0.csv, with times in ns and values in rad/s and m/s²."""

    name: ClassVar[str] = "kalibr"
    extensions: ClassVar[tuple[str, ...]] = (".csv",)

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0.9 if the first line is Kalibr's header."""
        first = head.removeprefix(b"\xef\xbb\xbf").lstrip(b"# ").split(b"\n", 1)[0]
        return 0.9 if first.strip().replace(b" ", b"") == _HEADER else 0.0

    def layout(self, source: FileSource) -> Layout:
        """Return the columns with Kalibr's units."""
        layout = super().layout(source)
        channels = tuple(Channel(c.name, _UNITS.get(c.name.partition("_")[0], ""), c.axis) for c in layout.channels)
        remark = Remark.of("file-content", case="layout", format="Kalibr's imu0.csv")
        return replace(layout, channels=channels, remarks=(*layout.remarks, remark))
