"""Read CSV files of Epson's M-G IMUs: scaled (Gx[dps], Ax[mG]) or raw (Gx[dec]) with SF_GYRO=… and SF_ACCL=…

Increments are named DAx, DVx and so on. There are no time stamps; a comment states the output rate."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from gmwm.base.remarks import Remark
from gmwm.files.contract import HEAD_BYTES, Channel, Layout, register
from gmwm.files.formats.byte_sources import FileSource
from gmwm.files.formats.text import TextReader

_COLUMN = re.compile(r"(G|A|DA|DV)([xyz])\[(dps|mG|deg|m/s|dec)\]")
_FACTOR = re.compile(
    r"SF_(GYRO|ACCL|DLTA|DLTV)\s*=\s*([+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)\s*(?:/\s*2\^(\d\d))?\s*"
    r"\(?(dps|deg/s|mg|mG|deg|m/s)\)?\s*/\s*(?:bit|lsb)"
)
_KINDS = {"G": ("gyro", "GYRO"), "A": ("accel", "ACCL"), "DA": ("gyro", "DLTA"), "DV": ("accel", "DLTV")}
_UNITS = {"dps": "deg/s", "deg/s": "deg/s", "mG": "mg", "mg": "mg", "deg": "deg/s", "m/s": "m/s²"}


@register
class EpsonReader(TextReader):
    """Reader of the CSV files of Epson's IMU loggers, with scaled or raw values."""

    name: ClassVar[str] = "epson"
    extensions: ClassVar[tuple[str, ...]] = (".csv",)

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0.9 if there are scale factors and columns with Epson's names."""
        return 0.9 if b"SF_" in head and re.search(rb"\b(Gx|Ax|DAx|DVx)\[(dps|mG|deg|m/s|dec)\]", head) else 0.0

    def layout(self, source: FileSource) -> Layout:
        """Return the columns with Epson's names. The size of a count is the scale of a raw column."""
        layout = super().layout(source)
        with source.open() as file:
            head = file.read(HEAD_BYTES).decode("latin-1")
        factors = {kind: (float(f) / 2 ** int(p or 0), _UNITS[u]) for kind, f, p, u in _FACTOR.findall(head)}
        matches = [_COLUMN.fullmatch(channel.name) for channel in layout.channels]
        directly = {_axis(match) for match in matches if match and not match[1].startswith("D")}
        channels, counts = [], {}
        for channel, match in zip(layout.channels, matches, strict=True):
            if match is None or (match[1].startswith("D") and _axis(match) in directly):
                channels.append(channel)
                continue
            kind, scale, unit = _KINDS[match[1]][1], 1.0, _UNITS.get(match[3], "")
            if match[3] == "dec" and kind in factors:
                scale, unit = counts[kind] = factors[kind]
            channels.append(
                Channel(channel.name, unit, axis=_axis(match), increments=match[1].startswith("D"), scale=scale)
            )
        scaled = (
            Remark.of("unit-named", kind, case="factor", factor=scale, unit=unit, source="file")
            for kind, (scale, unit) in counts.items()
        )
        # `units` is emptied, because the line of factors looks like a comment that states units.
        return replace(layout, channels=tuple(channels), remarks=(*layout.remarks, *scaled), units={})


def _axis(match: re.Match[str]) -> str:
    return f"{_KINDS[match[1]][0]}_{match[2]}"
