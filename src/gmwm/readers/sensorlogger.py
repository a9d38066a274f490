"""Tables of the phone application Sensor Logger: time,seconds_elapsed,z,y,x, one file a sensor.

The columns name no sensor, the file does: Gyroscope.csv in rad/s, TotalAcceleration.csv in m/s² with
gravity, Accelerometer.csv without. The columns run z, y, x; the time is in nanoseconds.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from gmwm.readers.base import Channel, Layout, register
from gmwm.readers.byte_sources import FileSource, MemberSource
from gmwm.readers.text import TextReader

_HEADER = b"time,seconds_elapsed,z,y,x"
_SENSORS = {
    "gyroscope": ("gyro", "rad/s"),
    "gyroscopeuncalibrated": ("gyro", "rad/s"),
    "totalacceleration": ("accel", "m/s²"),
    "accelerometer": ("accel", "m/s²"),
    "accelerometeruncalibrated": ("accel", ""),  # m/s² from some phones, g from others: gravity tells
}
WITHOUT_GRAVITY = "accelerometer"
"""The table whose gravity the phone's own filter has removed."""

REMOVED = "gravity was removed by the phone: this is its filter's noise, not the sensor's"
"""The remark on such a table."""


@register
class SensorLoggerReader(TextReader):
    """One table of Sensor Logger, known by its header and its name."""

    name: ClassVar[str] = "sensorlogger"
    extensions: ClassVar[tuple[str, ...]] = (".csv",)

    def sniff(self, path: Path, head: bytes) -> float:
        """0.9 if the first line is the header and the name is one of an inertial sensor."""
        return 0.9 if head.split(b"\n", 1)[0].strip() == _HEADER and sensor(path) else 0.0

    def layout(self, source: FileSource) -> Layout:
        """The columns, as the name of the table makes them."""
        found = super().layout(source)
        path = Path(source.member) if isinstance(source, MemberSource) else source.path
        known = _SENSORS.get(sensor(path))
        if known is None:  # asked for by format=
            return found
        quantity, unit = known
        channels = [
            Channel(c.name, "ns", "time") if c.name == "time" else Channel(c.name, unit, f"{quantity}_{c.name}")
            if c.name in ("x", "y", "z") else Channel("(elapsed)")
            for c in found.channels
        ]  # fmt: skip
        return replace(
            found,
            channels=tuple(channels),
            topic=path.stem,
            notes=(*found.notes, *((REMOVED,) if sensor(path) == WITHOUT_GRAVITY else ())),
        )


def sensor(path: Path) -> str:
    """Which sensor the name of a table says, in lower case; "" for others.

    >>> sensor(Path("Gyroscope.csv")), sensor(Path("Location.csv"))
    ('gyroscope', '')
    """
    stem = path.name.casefold().partition(".")[0]
    return stem if stem in _SENSORS else ""
