"""Read tables of Sensor Logger (phones), one per sensor, with time (ns),seconds_elapsed,z,y,x: Gyroscope.csv in rad/s,
TotalAcceleration.csv in m/s² with gravity, Accelerometer.csv without."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from gmwm.base.remarks import Remark
from gmwm.files.contract import Channel, Layout, register
from gmwm.files.formats.byte_sources import FileSource, MemberSource
from gmwm.files.formats.text import TextReader

_HEADER = b"time,seconds_elapsed,z,y,x"
_SENSORS = {
    "gyroscope": ("gyro", "rad/s"),
    "gyroscopeuncalibrated": ("gyro", "rad/s"),
    "totalacceleration": ("accel", "m/s²"),
    "accelerometer": ("accel", "m/s²"),
    "accelerometeruncalibrated": ("accel", ""),  # m/s² from some phones, g from others: inferred from gravity
}
WITHOUT_GRAVITY = "accelerometer"  # name of the table from which the filter of the phone has removed gravity


@register
class SensorLoggerReader(TextReader):
    """Reader of a table of Sensor Logger, recognised by its header and its name."""

    name: ClassVar[str] = "sensorlogger"
    extensions: ClassVar[tuple[str, ...]] = (".csv",)

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0.9 if the first line is the header and the file has the name of an inertial sensor."""
        return 0.9 if head.split(b"\n", 1)[0].strip() == _HEADER and sensor(path) else 0.0

    def layout(self, source: FileSource) -> Layout:
        """Return the columns, with the sensor and unit that the name of the table states."""
        layout = super().layout(source)
        path = Path(source.member) if isinstance(source, MemberSource) else source.path
        columns = _SENSORS.get(sensor(path))
        if columns is None:  # chosen by the `format` option
            return layout
        quantity, unit = columns
        channels = [
            Channel(c.name, "ns", "time") if c.name == "time" else Channel(c.name, unit, f"{quantity}_{c.name}")
            if c.name in ("x", "y", "z") else Channel("(elapsed)")
            for c in layout.channels
        ]  # fmt: skip
        removed = (Remark.of("gravity-removed", path.stem),) if sensor(path) == WITHOUT_GRAVITY else ()
        return replace(layout, channels=tuple(channels), topic=path.stem, remarks=(*layout.remarks, *removed))


def sensor(path: Path) -> str:
    """Return the sensor that the name of a table states, in lower case; "" for another name.

    >>> sensor(Path("Gyroscope.csv")), sensor(Path("Location.csv"))
    ('gyroscope', '')
    """
    stem = path.name.casefold().partition(".")[0]
    return stem if stem in _SENSORS else ""
