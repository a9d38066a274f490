"""Bare binary .imu records of six sensors, as surveyors exchange them.

The file does not say which sensor it is of. Records of 56 bytes have one scale whichever it is; of those with 32
bytes there are four, so the user names the type: `format="imu:LN200"`.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector
from gmwm._text import counted
from gmwm.errors import GmwmWarning, ReadError
from gmwm.imu_records import TYPES, RecordType
from gmwm.readers.base import HEAD_BYTES, Channel, Layout, Mark, Reader, Rows, register
from gmwm.signals import AXES, axis_quantity
from gmwm.units import STANDARD_GRAVITY

BLOCK = 1 << 18
"""Records in a chunk."""

_SLOWEST, _SHORTEST = 10.0, 1e-6  # s: intervals that the stamps of an inertial sensor can have
_LATEST = 1e10  # s: beyond the seconds of any week, and of any year since 1970


class RecordReader(Reader):
    """One type of .imu file, which the user named; no content tells it."""

    extensions: ClassVar[tuple[str, ...]] = ()
    kind: ClassVar[RecordType]

    def sniff(self, path: Path, head: bytes) -> float:
        """0: a type is never guessed."""
        return 0.0

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Time and six axes, if the records have the size of this type."""
        return (_layout(path, self.kind, self.kind.name),)

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Counts and times as they stand in the file."""
        return record_chunks(path, self.kind.dtype, 0, wanted)

    def marks(self, path: Path, layout: Layout) -> tuple[Mark, ...]:
        """Any record."""
        return record_marks(path, self.kind.dtype)

    def chunks_from(self, path: Path, layout: Layout, wanted: Sequence[int], mark: Mark) -> Iterator[Rows]:
        """Records from one on."""
        return record_chunks(path, self.kind.dtype, offset=0, wanted=wanted, first=mark.row)


@register
class ImuReader(Reader):
    """Bare .imu records of a type that nobody named."""

    name: ClassVar[str] = "imu"
    extensions: ClassVar[tuple[str, ...]] = (".imu",)

    def sniff(self, path: Path, head: bytes) -> float:
        """0.6 if records of either size have plausible times; 0.1 for one record in a file of this extension."""
        fitting = [_times(head, kind) for kind in _fitting(head)]
        if any(times.size > 1 for times in fitting):
            return 0.6
        return 0.1 if fitting and path.suffix.lower() in self.extensions else 0.0

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Time and six axes where the scale is known, or an error that shows what each type would mean."""
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
        fitting = _fitting(head)
        if len({kind.scales for kind in fitting}) == 1:
            return (_layout(path, fitting[0], " or ".join(kind.name for kind in fitting)),)
        if not fitting:
            raise ReadError(
                f"{path} does not begin with .imu records: neither those of 32 nor those of 56 bytes would have times "
                "in order"
            )
        meaning = ", ".join(f"{_gravity(head, kind):.3g} m/s² as {kind.name}" for kind in fitting)
        likely = [kind for kind in fitting if _heavy(head, kind)] or fitting
        raise ReadError(
            f"{path} holds records without a scale, as several sensors have them; by their accelerometers gravity "
            f"would be {meaning}. Name the sensor: {_options(likely)}"
        )

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Counts and times as they stand in the file."""
        kind: RecordType = layout.state
        return record_chunks(path, kind.dtype, 0, wanted)

    def marks(self, path: Path, layout: Layout) -> tuple[Mark, ...]:
        """Any record."""
        return record_marks(path, layout.state.dtype)

    def chunks_from(self, path: Path, layout: Layout, wanted: Sequence[int], mark: Mark) -> Iterator[Rows]:
        """Records from one on."""
        return record_chunks(path, layout.state.dtype, offset=0, wanted=wanted, first=mark.row)


def _register(of: RecordType) -> None:
    @register
    class Named(RecordReader):
        __doc__ = f"Bare .imu records of the type {of.name}."
        name = of.format
        kind = of


for _type in TYPES:
    _register(_type)


def record_channels(
    units: tuple[str, str], scales: tuple[float, float], increments: tuple[bool, bool] = (True, True)
) -> tuple[Channel, ...]:
    """The columns of a record: time in s, gyroscopes and accelerometers in the units given, after their scales."""
    sensors = zip(("gyro", "accel"), units, scales, increments, strict=True)
    found = {name: (unit, flag, scale) for name, unit, scale, flag in sensors}
    axes = (
        Channel(axis, unit, axis=axis, increments=flag, scale=scale)
        for axis in AXES
        for unit, flag, scale in (found[axis_quantity(axis)],)
    )
    return (Channel("time", "s", "time"), *axes)


def whole_records(path: Path, dtype: np.dtype[Any], offset: int = 0) -> int:
    """How many records follow the header, or an error if there are none or the last one is not whole."""
    records, over = divmod(path.stat().st_size - offset, dtype.itemsize)
    if over:
        raise ReadError(
            f"{path} is no whole number of records: {counted(records, 'record')} of {dtype.itemsize} bytes and "
            f"{counted(over, 'byte')} more; was it cut off, or is it of another format?"
        )
    if records < 1:
        raise ReadError(f"{path} holds no records; was the recording interrupted?")
    return int(records)


def require_times(path: Path, dtype: np.dtype[Any], offset: int = 0, way_out: str = "") -> None:
    """An error if the first records have no times: they are of another kind then."""
    with path.open("rb") as file:
        file.seek(offset)
        head = file.read(HEAD_BYTES)
    times = _column(head, dtype, "time")
    if not _plausible(times):
        first = ", ".join(f"{t:.6g}" for t in times[:4])
        raise ReadError(
            f"{path}: as records of {dtype.itemsize} bytes its times would be {first}, which are none{way_out}"
        )


def record_marks(path: Path, dtype: np.dtype[Any], offset: int = 0) -> tuple[Mark, ...]:
    """Where the blocks of records behind a header begin, and their end."""
    records = whole_records(path, dtype, offset)
    return (*(Mark(row) for row in range(0, records, BLOCK)), Mark(records))


def record_chunks(
    path: Path, dtype: np.dtype[Any], offset: int, wanted: Sequence[int], first: int = 0
) -> Iterator[Rows]:
    """Blocks of records from one on, each field as float64."""
    names = dtype.names or ()
    with path.open("rb") as file:
        file.seek(offset + first * dtype.itemsize)
        while (block := np.fromfile(file, dtype, BLOCK)).size:
            yield {k: block[names[k]].astype(np.float64) for k in wanted}


def _layout(path: Path, kind: RecordType, name: str) -> Layout:
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    others = [other for other in _fitting(head) if other.dtype != kind.dtype]
    size = others[0].dtype.itemsize if others else 0
    require_times(path, kind.dtype, 0, f"; records of {size} bytes fit: {_options(others)}" if others else "")
    whole_records(path, kind.dtype)
    if not _heavy(head, kind):
        better = [other for other in TYPES if other.dtype == kind.dtype and _heavy(head, other)]
        hint = f": if it is of another sensor, {_options(better)}" if better else ""
        message = (
            f"{path}: as {name} its accelerometers show {_gravity(head, kind):.3g} m/s² where gravity is 9.81{hint}"
        )
        warnings.warn(message, GmwmWarning, stacklevel=2)
    note = f"{name}: increments of {kind.gyro:.4g} rad and {kind.accel:.4g} m/s a count, times the rate"
    channels = record_channels(("rad/s", "m/s²"), (kind.gyro, kind.accel))
    return Layout(channels, notes=(note,), state=kind)


def _options(kinds: Sequence[RecordType]) -> str:
    return "pass " + " or ".join(f"format='{kind.format}'" for kind in kinds)


def _fitting(head: bytes) -> list[RecordType]:
    """The types whose records would have plausible times."""
    return [kind for kind in TYPES if len(head) >= kind.dtype.itemsize and _plausible(_times(head, kind))]


def _column(head: bytes, dtype: np.dtype[Any], name: str) -> NDArray[Any]:
    return np.frombuffer(head, dtype, len(head) // dtype.itemsize)[name]


def _times(head: bytes, kind: RecordType) -> Vector:
    return np.asarray(_column(head, kind.dtype, "time"), dtype=np.float64)


def _plausible(times: NDArray[Any]) -> bool:
    """Whether numbers can be the stamps of a recording (s): no other bytes look like them by accident."""
    with np.errstate(all="ignore"):
        if not times.size or not np.all(np.abs(times) < _LATEST):
            return False
        steps = np.diff(times)
        possible = np.mean((steps >= 0) & (steps <= _SLOWEST)) if steps.size else 1.0
        return bool(possible >= 0.9 and (not steps.size or np.median(steps) >= _SHORTEST))


def _gravity(head: bytes, kind: RecordType) -> float:
    """The norm of the mean specific force in the first records if they are of this type (m/s²)."""
    times = _times(head, kind)
    rate = 1 / float(np.median(np.diff(times))) if times.size > 1 else np.nan
    means = [float(np.mean(_column(head, kind.dtype, axis))) for axis in AXES[3:]]
    return float(np.linalg.norm(means)) * kind.accel * rate


def _heavy(head: bytes, kind: RecordType) -> bool:
    """Whether the accelerometers feel gravity, within a fifth, if the records are of this type; one tells nothing."""
    return not abs(_gravity(head, kind) / STANDARD_GRAVITY - 1) > 0.2
