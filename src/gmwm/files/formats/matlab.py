"""Read MATLAB's .mat files of versions 5 to 7, and with h5py those of version 7.3, which are HDF5.

Arrays are recognised by name, or as `data_imu` of time, accelerometers, gyroscopes (kalibr_allan) or `wb`, `fb`, `t`,
`freq` (NaveGo). SciPy crashes the process on 22 % of damaged files; here each length is checked. Source: The MathWorks,
MAT-File Format (Level 5)."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gmwm.base.errors import ReadError
from gmwm.base.remarks import Remark
from gmwm.base.units import AXES
from gmwm.files.contract import Layout, damage_error, register
from gmwm.files.formats.arrays import (
    MAX_ARRAYS,
    Array,
    ArraysReader,
    layouts_of,
    part_of,
    split_path,
    upright,
    with_stated_units,
)
from gmwm.files.formats.byte_sources import require_ratio
from gmwm.files.formats.hdf5 import MAGIC, arrays_in

_MATRIX, _COMPRESSED = 14, 15
_STRUCT, _CHAR = 2, 4
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}


def variables(path: Path) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the name ("structure/field") and the value of each numeric matrix and each string in a file."""
    # The file is not memory-mapped: if a mapped file is truncated while it is read, the process is killed.
    data = memoryview(path.read_bytes())
    head = bytes(data[:128])
    if len(head) < 128 or head[126:128] not in (b"IM", b"MI"):
        raise damage_error(f"{path} is not a complete MATLAB file: its header is truncated or damaged", "incomplete")
    order = "<" if head[126:128] == b"IM" else ">"
    packed = unpacked = 0
    at = len(head)
    while at < len(data):
        element = _element(data, at, order, path)
        at = element.end
        if element.kind == _COMPRESSED:
            content = _unpack(element.data, packed, unpacked, path)
            packed, unpacked = packed + len(element.data), unpacked + len(content)
            element = _element(memoryview(content), 0, order, path)
        if element.kind == _MATRIX:
            yield from _matrix(element.data, order, path=path, where="", depth=0)


@dataclass(frozen=True)
class _Element:
    """An element of a file: its kind, its bytes, and the position of the next element."""

    kind: int
    data: memoryview
    end: int


def _element(data: memoryview, at: int, order: str, path: Path) -> _Element:
    """Read the element at a position. The bytes of a short element are inside its tag of 8 bytes."""
    tag = data[at : at + 8]
    if len(tag) < 8:
        raise _cut_off(path)
    kind, size = (int(word) for word in np.frombuffer(tag, f"{order}u4"))
    if kind >> 16:
        kind, size = kind & 0xFFFF, kind >> 16
        if size > 4:
            raise damage_error(f"{path} is damaged: a short element of {size} bytes")
        return _Element(kind, tag[4 : 4 + size], at + 8)
    begin, end = at + 8, at + 8 + size
    if end > len(data):
        raise _cut_off(path)
    # All elements except compressed ones end at a multiple of eight bytes.
    return _Element(kind, data[begin:end], end if kind == _COMPRESSED else end + -size % 8)


def _matrix(data: memoryview, order: str, path: Path, where: str, depth: int) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the numbers of a matrix, or the matrices in the fields of a structure."""
    if not len(data):
        return  # an empty field
    parts = []
    at = 0
    for _ in range(3):
        parts.append(_element(data, at, order, path))
        at = parts[-1].end
    flags = _integers(parts[0], order, path)
    shape = tuple(_integers(parts[1], order, path))
    if not flags or any(size < 0 for size in shape):
        raise damage_error(f"{path} is damaged: a matrix without a class, or of negative size")
    name = f"{where}/{_text(parts[2].data)}" if where and len(parts[2].data) else where or _text(parts[2].data)
    kind = flags[0] & 0xFF
    if kind in _CLASSES and not (flags[0] >> 8) & 0x0A:  # neither logical nor complex
        yield (
            name,
            _numbers(_element(data, at, order, path), _CLASSES[kind], shape=shape, order=order, path=path, name=name),
        )
    elif kind == _CHAR:
        element = _element(data, at, order, path)
        wide = len(element.data) == 2 * int(np.prod(shape, dtype=object))
        encoding = ("utf-16-le" if order == "<" else "utf-16-be") if wide else "utf-8"
        yield name, np.array(bytes(element.data).decode(encoding, errors="replace"))
    elif kind == _STRUCT and shape and int(np.prod(shape, dtype=object)) == 1 and depth < 4:
        length = _integers(_element(data, at, order, path), order, path)
        names = _element(data, _element(data, at, order, path).end, order, path)
        if not length or not 0 < length[0] <= 64 or len(names.data) > 1000 * length[0]:
            raise damage_error(f"{path} is damaged: the names of the fields of {name}")
        at = names.end
        for first in range(0, len(names.data), length[0]):
            field = _element(data, at, order, path)
            at = field.end
            yield from _matrix(
                field.data, order, path=path, where=f"{name}/{_text(names.data[first:][: length[0]])}", depth=depth + 1
            )


def _numbers(element: _Element, kind: str, shape: tuple[int, ...], order: str, path: Path, name: str) -> NDArray[Any]:
    """Read the numbers of a matrix. They may be stored in a smaller type than the type of the matrix."""
    values = _read_numbers(element, order, path)
    if values.size != int(np.prod(shape, dtype=object)):
        raise damage_error(f"{path} is damaged: {name} has {values.size} numbers, expected {'×'.join(map(str, shape))}")
    with np.errstate(invalid="ignore", over="ignore"):  # a number that the type cannot hold is an error below
        numbers = values.astype(f"{order}{kind}", copy=False)
    if numbers.dtype.kind in "iu" and not np.array_equal(numbers, values):
        raise damage_error(f"{path} is damaged: {name} has numbers that its type cannot hold")
    return numbers.reshape(shape, order="F")


def _read_numbers(element: _Element, order: str, path: Path) -> NDArray[Any]:
    if element.kind not in _STORED:
        raise damage_error(f"{path} is damaged: numbers of the unknown type {element.kind}")
    kind = np.dtype(f"{order}{_STORED[element.kind]}")
    if len(element.data) % kind.itemsize:
        raise damage_error(f"{path} is damaged: {len(element.data)} bytes for numbers of {kind.itemsize} bytes each")
    return np.frombuffer(element.data, kind)


def _integers(element: _Element, order: str, path: Path) -> list[int]:
    values = _read_numbers(element, order, path)
    if values.dtype.kind not in "iu":
        raise damage_error(f"{path} is damaged: sizes that are not whole numbers")
    return [int(value) for value in values]


def _text(data: memoryview) -> str:
    return bytes(data).split(b"\0", 1)[0].decode("latin-1")


def _unpack(data: memoryview, packed: int, unpacked: int, path: Path) -> bytes:
    """Decompress an element, and check the total size of all elements so far."""
    unpacker = zlib.decompressobj()
    out, piece = bytearray(), 1 << 14  # compressed bytes at a time: they decompress to at most 16 MB
    try:
        for start in range(0, len(data), piece):
            out += unpacker.decompress(data[start : start + piece])
            require_ratio(unpacked + len(out), packed + len(data), path)
    except zlib.error as error:
        raise damage_error(f"{path} is damaged ({error})") from error
    if not unpacker.eof:
        raise _cut_off(path)
    return bytes(out)


def _cut_off(path: Path) -> ReadError:
    return damage_error(f"{path} is not a complete MATLAB file: a part of it ends behind its end", "incomplete")


_NAVEGO = {"t": (("time",), ("s",)), "wb": (AXES[:3], ("rad/s",) * 3), "fb": (AXES[3:], ("m/s²",) * 3)}
_KALIBR_ALLAN = (("time", *AXES[3:], *AXES[:3]), ("", *("m/s²",) * 3, *("rad/s",) * 3))


@register
class MatlabReader(ArraysReader):
    """Reader of arrays and structures in .mat files."""

    name: ClassVar[str] = "matlab"
    extensions: ClassVar[tuple[str, ...]] = (".mat",)
    signatures: ClassVar[tuple[bytes, ...]] = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return the recordings. Arrays of the same length are the columns of one recording."""
        with path.open("rb") as file:
            head = file.read(512 + len(MAGIC))
        texts: list[str] = []
        newer = head[512:] == MAGIC or head.startswith(b"MATLAB 7.3")
        stored = arrays_in(path) if newer else _older(path, texts)
        remarks: tuple[Remark, ...] = ()
        arrays = [_with_layout(array, stored) for array in stored if not array.name.startswith("#")]
        arrays = with_stated_units(arrays, texts)
        if any(array.axes for array in arrays):
            navego = any(array.axes in {axes for axes, _ in _NAVEGO.values()} for array in arrays)
            remarks = (Remark.of("file-content", case="layout", format="NaveGo" if navego else "kalibr_allan"),)
        return layouts_of(arrays, path, remarks)


def _with_layout(array: Array, others: Sequence[Array]) -> Array:
    """Add roles and units to the columns of an array that belongs to one of the known layouts."""
    where, label = split_path(array.name)
    turned = upright(array)
    if label == "data_imu" and turned.columns == 7:
        return replace(turned, axes=_KALIBR_ALLAN[0], units=_KALIBR_ALLAN[1])
    siblings = {split_path(other.name)[1] for other in others if split_path(other.name)[0] == where}
    if label in _NAVEGO and {"wb", "fb"} <= siblings and turned.columns == len(_NAVEGO[label][0]):
        return replace(turned, axes=_NAVEGO[label][0], units=_NAVEGO[label][1])
    return array


def _older(path: Path, texts: list[str]) -> list[Array]:
    """Return the arrays of a file of versions 5 to 7; append its strings to `texts`."""
    arrays: list[Array] = []
    for name, value in variables(path):
        if value.dtype.kind == "U":
            texts.append(str(value))
            continue
        if len(arrays) == MAX_ARRAYS:
            raise ReadError(
                f"{path} holds more than {MAX_ARRAYS} arrays",
                code="too-many",
                advice="Save only the arrays of the recording.",
            )
        arrays.append(Array(name, value.shape, value.dtype, partial(part_of, value)))
    return arrays
