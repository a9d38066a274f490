"""Read text exported by Xsens MT Manager, with // comments and columns such as PacketCounter and Acc_X (m/s², rad/s).

Increments are VelInc (m/s) and OriInc, a quaternion whose vector part is half the angle. Time is SampleTimeFine (0.1
ms), or PacketCounter (modulo 2¹⁶) with the update rate in comments."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from gmwm.base.remarks import Quantity, Remark
from gmwm.files.clock.missing_values import MISSING, whole_numbers
from gmwm.files.contract import Channel, Layout, Mark, Rows, register
from gmwm.files.formats.byte_sources import FileSource
from gmwm.files.formats.dialect import TextDialect
from gmwm.files.formats.text import Place, TextReader

_SIGNALS = {
    **{f"Acc_{axis}": ("m/s²", f"accel_{axis.lower()}") for axis in "XYZ"},
    **{f"Gyr_{axis}": ("rad/s", f"gyro_{axis.lower()}") for axis in "XYZ"},
}
_INCREMENTS = {
    **{f"VelInc_{axis}": ("m/s²", f"accel_{axis.lower()}") for axis in "XYZ"},
    **{f"OriInc_q{k}": ("rad/s", f"gyro_{axis}") for k, axis in enumerate("xyz", 1)},
}


@register
class XsensReader(TextReader):
    """Reader of text of Xsens MT Manager. Increments are used for a sensor without rates."""

    name: ClassVar[str] = "xsens"
    extensions: ClassVar[tuple[str, ...]] = (".txt", ".csv")

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0.9 for comments with // above a header with PacketCounter and an inertial column."""
        header = re.search(rb"(?m)^PacketCounter\b.*\b(Acc_X|Gyr_X|VelInc_X|OriInc_q1)\b", head)
        return 0.9 if header and head.removeprefix(b"\xef\xbb\xbf").startswith(b"//") else 0.0

    def layout(self, source: FileSource) -> Layout:
        """Return the layout, with the axes and units that the names of the columns determine."""
        layout = super().layout(source)
        dialect: TextDialect = layout.state
        names = {channel.name for channel in layout.channels}
        time = self._time(layout, dialect)
        channels, remarks = [], [*layout.remarks]
        for channel in layout.channels:
            unit, axis = _SIGNALS.get(channel.name) or _INCREMENTS.get(channel.name, ("", ""))
            increments = channel.name in _INCREMENTS
            if channel.name == time:
                channels.append(Channel(channel.name, "us" if time == "SampleTimeFine" else "s", "time"))
            elif axis and not (increments and any(a == axis and n in names for n, (_, a) in _SIGNALS.items())):
                half_angle = channel.name.startswith("OriInc")
                channels.append(
                    Channel(channel.name, unit, axis=axis, increments=increments, scale=2.0 if half_angle else 1.0)
                )
            else:
                channels.append(Channel(channel.name))
        used = [c.name for c in channels if c.increments]
        if used:
            remarks += [Remark.of("unit-named", name, case="increments", source="file") for name in used]
        if time == "PacketCounter" and dialect.rate is not None:
            remarks.append(Remark.of("time-read", case="read", form="packets", rate=Quantity(dialect.rate, "Hz")))
        return replace(layout, channels=tuple(channels), remarks=tuple(remarks))

    def marks(self, path: Path, layout: Layout) -> tuple[Mark, ...]:
        """Return marks for the blocks; none for PacketCounter, whose wraps are counted from the first row."""
        counted = any(c.name == "PacketCounter" and c.axis == "time" for c in layout.channels)
        return () if counted else super().marks(path, layout)

    def rows(
        self, source: FileSource, layout: Layout, wanted: Sequence[int], place: Place | None = None
    ) -> Iterator[Rows]:
        """Yield the numbers, with SampleTimeFine in microseconds and PacketCounter in seconds."""
        names = {k: layout.channels[k].name for k in wanted}
        last = packets = None
        for chunk in super().rows(source, layout, wanted, place):
            out = dict(chunk)
            for k, name in names.items():
                if name == "SampleTimeFine":
                    ticks = whole_numbers(chunk[k])
                    out[k] = np.where(ticks == MISSING, MISSING, ticks * 100)  # a tick is 100 µs
                elif name == "PacketCounter" and layout.channels[k].axis == "time":
                    counter = whole_numbers(chunk[k])
                    present = counter != MISSING
                    out[k] = np.full(counter.size, np.nan)
                    if not present.any():
                        continue
                    counter = counter[present]
                    steps = np.diff(counter, prepend=counter[0] if last is None else last) % (1 << 16)
                    # A reset of the counter appears as a gap of minutes. Samples were lost there.
                    packets = (packets[-1] if packets is not None else 0) + np.cumsum(steps)
                    last = counter[-1]
                    out[k][present] = packets / layout.state.rate
            yield out

    @staticmethod
    def _time(found: Layout, dialect: TextDialect) -> str:
        """Return the time column: SampleTimeFine, or PacketCounter if SampleTimeFine is empty; else ""."""
        names = [channel.name for channel in found.channels]
        if "SampleTimeFine" in names and dialect.integers[names.index("SampleTimeFine")]:
            return "SampleTimeFine"
        return "PacketCounter" if dialect.rate is not None and "PacketCounter" in names else ""
