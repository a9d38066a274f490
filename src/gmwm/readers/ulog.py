"""PX4's flight logs (.ulg), read with pyulog: each gyroscope and accelerometer of the autopilot is a recording.

Sources: PX4 guide, "ULog file format"; PX4-Autopilot, msg/SensorCombined.msg, SensorGyro.msg, SensorAccel.msg.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from gmwm.errors import MissingDependencyError, ReadError
from gmwm.readers.base import Channel, Layout, Reader, Rows, register
from gmwm.remarks import Remark

_SIGNATURE = b"ULog\x01\x12\x35"
_AXES = ("x", "y", "z")
_GYRO = {"x": "gyro_x", "y": "gyro_y", "z": "gyro_z", "temperature": "temperature"}
_ACCEL = {"x": "accel_x", "y": "accel_y", "z": "accel_z", "temperature": "temperature"}
_COMBINED = {f"gyro_rad[{k}]": f"gyro_{axis}" for k, axis in enumerate(_AXES)} | {
    f"accelerometer_m_s2[{k}]": f"accel_{axis}" for k, axis in enumerate(_AXES)
}
_MESSAGES = {"sensor_combined": _COMBINED, "sensor_gyro": _GYRO, "sensor_accel": _ACCEL}
_STAMPS = ("timestamp_sample", "timestamp")  # µs; the time of the sample is preferred to the time of its publication
_UNITS = {"gyro": "rad/s", "accel": "m/s²", "temperature": "°C"}
_MOST_FIELDS = 2000  # of a message: sensors have some ten; deeply nested types could exhaust the memory


class _Watched(io.BufferedReader):
    """A file that records whether a read returned fewer bytes than requested."""

    cut = False

    def read(self, size: int | None = -1, /) -> bytes:
        data = super().read(size)
        # The file is complete if it ends exactly before the three bytes of the size and type of the next message.
        self.cut |= len(data) < (size or 0) and not (size == 3 and not data)
        return data


@register
class UlogReader(Reader):
    """Reader of PX4 ULog files."""

    name: ClassVar[str] = "ulog"
    extensions: ClassVar[tuple[str, ...]] = (".ulg", ".ulog")

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 1 for the signature of ULog."""
        return 1.0 if head.startswith(_SIGNATURE) else 0.0

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return one recording for each instance of sensor_combined, sensor_gyro and sensor_accel, such as
        sensor_gyro_0.

        The six axes of sensor_combined are preferred. The temperature comes from the selected gyroscope, which logs it
        with the slower message sensor_gyro.
        """
        log = _loaded(path)
        dropouts = (Remark.of("log-dropouts", count=len(log.dropouts)),) if log.dropouts else ()
        messages = [item for item in log.data_list if item.name in _MESSAGES]
        found = [_layout(f"{item.name}_{item.multi_id}", _MESSAGES[item.name], item.data) for item in messages]
        layouts = [layout for layout in found if layout is not None]
        if not layouts:
            raise ReadError(
                f"{path} holds none of the messages {', '.join(_MESSAGES)}",
                code="no-inertial-data",
                advice="Log them with the parameter SDLOG_PROFILE.",
            )
        out = []
        for layout in layouts:
            combined = layout.topic == "sensor_combined_0"
            whole = _with_temperature(layout, log.data_list) if combined else layout
            out.append(replace(whole, preferred=combined, remarks=(*whole.remarks, *dropouts)))
        return tuple(out)

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield all numbers in one chunk, because pyulog holds the log in memory."""
        yield {k: layout.state[k] for k in wanted}


def _layout(topic: str, axes: Mapping[str, str], data: Mapping[str, np.ndarray[Any, Any]]) -> Layout | None:
    """Return the time and the axes of one message, with its temperature if there is one; None if an axis is missing."""
    stamp = next((name for name in _STAMPS if name in data and np.any(data[name])), None)
    names = [
        name for name in axes if name in data and (axes[name] != "temperature" or np.nansum(np.abs(data[name])) > 0)
    ]
    if stamp is None or not {name for name in axes if axes[name] != "temperature"} <= set(names):
        return None
    channels = [Channel(stamp, "us", "time")]
    channels += [Channel(name, _UNITS[axes[name].split("_")[0]], axes[name]) for name in names]
    # int64 holds the microseconds since the start exactly.
    columns = [data[stamp].astype(np.int64), *(data[name].astype(np.float64) for name in names)]
    times = columns[0]
    extent = (times.size, float(times[-1] - times[0]) / 1e6)
    return Layout(tuple(channels), topic=topic, state=dict(enumerate(columns)), extent=extent)


def _with_temperature(layout: Layout, messages: Sequence[Any]) -> Layout:
    """Add the temperature of the gyroscope, interpolated linearly, to the layout of sensor_combined."""
    selection: Mapping[str, Any] = next((item.data for item in messages if item.name == "sensor_selection"), {})
    chosen = selection.get("gyro_device_id", np.zeros(1))[-1]
    sensors = [item for item in messages if item.name in ("sensor_gyro", "sensor_accel") and "temperature" in item.data]
    sensors.sort(key=lambda item: (item.data.get("device_id", np.ones(1))[0] != chosen, item.name != "sensor_gyro"))
    for item in sensors:
        stamps, values = item.data["timestamp"].astype(np.float64), item.data["temperature"].astype(np.float64)
        # Simulated sensors have a temperature of zero.
        there = np.isfinite(values)
        if there.any() and np.any(values[there]):
            state = dict(layout.state)
            state[len(state)] = np.interp(layout.state[0].astype(np.float64), stamps[there], values[there])
            channels = (*layout.channels, Channel("temperature", "°C", "temperature"))
            remark = Remark.of("temperature-read", topic=f"{item.name}_{item.multi_id}")
            return replace(layout, channels=channels, state=state, remarks=(*layout.remarks, remark))
    return layout


def _loaded(path: Path) -> Any:
    """Load the sensor messages of a log.

    Raises
    ------
    MissingDependencyError
        If pyulog is not installed.
    ReadError
        If the log is cut off or damaged.
    """
    try:
        from pyulog import ULog  # type: ignore[import-untyped]
    except ImportError as error:
        raise MissingDependencyError(
            f"{path} is a PX4 log, and pyulog is not installed", advice="Install it with `pip install 'gmwm[px4]'`."
        ) from error
    printed = io.StringIO()  # pyulog prints its complaints
    try:
        with redirect_stdout(printed), _Watched(io.FileIO(path)) as file:
            _require_small(path, ULog(file, parse_header_only=True).message_formats)
        with redirect_stdout(printed), _Watched(io.FileIO(path)) as file:
            log = ULog(file, [*_MESSAGES, "sensor_selection"])
    except ReadError:
        raise
    except Exception as error:  # pyulog raises any type of error for a damaged file
        raise ReadError(
            f"pyulog cannot read {path}: {str(error) or type(error).__name__}",
            code="damaged",
            advice="Copy the file again.",
        ) from error
    if log.file_corruption:
        reason = printed.getvalue().strip() or "a message is invalid"
        raise ReadError(f"{path} is damaged: {reason}", code="damaged", advice="Copy it again.")
    if file.cut:
        raise ReadError(
            f"{path} ends within a message",
            code="cut-off",
            advice="Copy it again. If the autopilot lost its power, save the complete messages with "
            "`pyulog.ULog('{name}').write_ulog('complete.ulg')`.",
            name=str(path),
        )
    return log


def _require_small(path: Path, formats: Mapping[str, Any]) -> None:
    """Raise an error if a message, with its nested types, has more than `_MOST_FIELDS` fields.

    Raises
    ------
    ReadError
        If one has more, or a type contains itself.
    """
    sizes: dict[str, int] = {}

    def size(name: str, above: tuple[str, ...] = ()) -> int:
        if name in above:
            raise ReadError(
                f"{path} is damaged: the type {name!r} contains itself",
                code="type-recursive",
                advice="Copy the file again.",
            )
        if name not in sizes:
            inner = (max(1, count) * (size(of, (*above, name)) if of in formats else 1)
                     for of, count, _ in formats[name].fields)  # fmt: skip
            sizes[name] = sum(inner)
        if sizes[name] > _MOST_FIELDS:
            raise ReadError(
                f"{path} is damaged: the message {name!r} has more than {_MOST_FIELDS} fields",
                code="too-many",
                advice="Copy the file again.",
            )
        return sizes[name]

    for name in formats:
        size(name)
