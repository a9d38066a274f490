"""Read PX4's flight logs (.ulg). Each gyroscope and accelerometer of the autopilot is a recording.

Sources: PX4 guide, "ULog file format"; PX4-Autopilot, msg/SensorCombined.msg, SensorGyro.msg, SensorAccel.msg.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.errors import ReadError
from gmwm.base.remarks import Remark
from gmwm.files.contract import Channel, Layout, Reader, Rows, register
from gmwm.files.formats.ulog_messages import SIGNATURE, Log, Table, UlogMessage, column

_AXES = ("x", "y", "z")
_GYRO = {"x": "gyro_x", "y": "gyro_y", "z": "gyro_z", "temperature": "temperature"}
_ACCEL = {"x": "accel_x", "y": "accel_y", "z": "accel_z", "temperature": "temperature"}
_COMBINED = {f"gyro_rad[{k}]": f"gyro_{axis}" for k, axis in enumerate(_AXES)} | {
    f"accelerometer_m_s2[{k}]": f"accel_{axis}" for k, axis in enumerate(_AXES)
}
_MESSAGES = {"sensor_combined": _COMBINED, "sensor_gyro": _GYRO, "sensor_accel": _ACCEL}
_SELECTION = "sensor_selection"
_STAMPS = ("timestamp_sample", "timestamp")  # µs; the time of the sample is preferred to the time of its publication
_UNITS = {"gyro": "rad/s", "accel": "m/s²", "temperature": "°C"}
_MOST_TEMPERATURES = 1 << 18
"""Largest number of temperatures of a sensor that are kept. If there are more, every second one is dropped."""


@dataclass
class _SensorSummary:
    """Result of the first pass over the messages of one sensor."""

    count: int = 0  # number of messages
    edges: dict[str, tuple[int, int]] = field(default_factory=dict)  # first and last time (µs) of each kind of stamp
    stamped: set[str] = field(default_factory=set)  # the kinds of stamps that are not always 0
    # Whether the sensor has a temperature. Simulated sensors have a temperature of 0, which does not count
    warm: bool = False
    device: int = 1  # identity of the sensor
    _stamps: list[Vector] = field(default_factory=list)
    _values: list[Vector] = field(default_factory=list)

    def add(self, table: Table) -> None:
        """Add the messages of a block."""
        names = table.dtype.names or ()
        if not self.count and "device_id" in names:
            self.device = int(table["device_id"][0])
        self.count += table.size
        for name in set(_STAMPS) & set(names):
            temperatures = column(table, name)
            self.edges[name] = self.edges.get(name, (int(temperatures[0]), 0))[0], int(temperatures[-1])
            if np.any(temperatures):
                self.stamped.add(name)
        if "temperature" in names and "timestamp" in names:
            values = column(table, "temperature")
            finite = np.isfinite(values)
            self.warm |= bool(np.any(values[finite]))
            self._stamps.append(table["timestamp"][finite].astype(np.float64))
            self._values.append(values[finite])
            while sum(batch.size for batch in self._values) > _MOST_TEMPERATURES:
                self._stamps = [np.concatenate(self._stamps)[::2]]
                self._values = [np.concatenate(self._values)[::2]]

    def temperatures(self) -> tuple[Vector, Vector]:
        """Return times (µs) and temperatures (°C)."""
        return np.concatenate(self._stamps), np.concatenate(self._values)


@dataclass(frozen=True, eq=False)
class _UlogFields:
    """The message and the fields from which the columns of a recording are read."""

    message: UlogMessage  # the message to read
    names: tuple[str, ...]  # Field of each column. A temperature column from another message has no field
    # temperatures of another message, which are interpolated linearly
    temperatures: tuple[Vector, Vector] | None = None


@register
class UlogReader(Reader):
    """Reader of PX4 ULog files."""

    name: ClassVar[str] = "ulog"
    extensions: ClassVar[tuple[str, ...]] = (".ulg", ".ulog")
    signatures: ClassVar[tuple[bytes, ...]] = (SIGNATURE,)

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return one recording for each instance of sensor_combined (preferred), sensor_gyro and sensor_accel. The
        temperature of sensor_combined comes from the slower message sensor_gyro."""
        log, summaries, selected = Log(path), dict[UlogMessage, _SensorSummary](), 0
        for message, table in log.tables((*_MESSAGES, _SELECTION)):
            if message.name != _SELECTION:
                summaries.setdefault(message, _SensorSummary()).add(table)
            elif "gyro_device_id" in (table.dtype.names or ()):
                selected = int(table["gyro_device_id"][-1])
        dropouts = (Remark.of("log-dropouts", case="dropouts", count=log.dropouts),) if log.dropouts else ()
        ordered = sorted(summaries, key=lambda message: (message.name, message.instance))
        layouts = [layout for message in ordered if (layout := _layout(message, summaries[message])) is not None]
        if not layouts:
            raise ReadError(
                f"{path} holds none of the messages {', '.join(_MESSAGES)}",
                code="no-inertial-data",
                advice="Log them with the parameter SDLOG_PROFILE.",
            )
        out = []
        for layout in layouts:
            combined = layout.topic == "sensor_combined_0"
            complete = _with_temperature(layout, summaries, selected) if combined else layout
            out.append(replace(complete, preferred=combined, remarks=(*complete.remarks, *dropouts)))
        return tuple(out)

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield the numbers, one chunk for each block of the file."""
        selection: _UlogFields = layout.state
        for message, table in Log(path).tables((selection.message.name,)):
            if message == selection.message:
                yield {k: _column(table, selection, k) for k in wanted}


def _column(table: Table, selection: _UlogFields, k: int) -> Vector:
    if k < len(selection.names):
        return column(table, selection.names[k])
    assert selection.temperatures is not None
    return np.interp(column(table, selection.names[0]).astype(np.float64), *selection.temperatures)


def _layout(message: UlogMessage, found: _SensorSummary) -> Layout | None:
    """Return the columns of one message, with its temperature if there is one; None if an axis is missing."""
    axes, fields = _MESSAGES[message.name], message.fields.names or ()
    stamp = next((name for name in _STAMPS if name in found.stamped), None)
    names = [name for name in axes if name in fields and (axes[name] != "temperature" or found.warm)]
    if stamp is None or not {name for name in axes if axes[name] != "temperature"} <= set(names):
        return None
    channels = [Channel(stamp, "us", "time")]
    channels += [Channel(name, _UNITS[axes[name].split("_")[0]], axes[name]) for name in names]
    first, last = found.edges[stamp]
    return Layout(
        tuple(channels), topic=message.topic, state=_UlogFields(message, (stamp, *names)),
        extent=(found.count, (last - first) / 1e6),
    )  # fmt: skip


def _with_temperature(layout: Layout, found: Mapping[UlogMessage, _SensorSummary], selected: int) -> Layout:
    """Add the temperature of the selected gyroscope, or of another sensor, to the layout of sensor_combined."""
    sensors = [message for message, summary in found.items() if summary.warm]
    sensors.sort(key=lambda one: (found[one].device != selected, one.name != "sensor_gyro", one.name, one.instance))
    if not sensors:
        return layout
    return replace(
        layout,
        channels=(*layout.channels, Channel("temperature", "°C", "temperature")),
        state=replace(layout.state, temperatures=found[sensors[0]].temperatures()),
        remarks=(*layout.remarks, Remark.of("file-content", case="temperature", topic=sensors[0].topic)),
    )
