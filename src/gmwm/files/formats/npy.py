"""Read NumPy's .npy and .npz files without pickled objects; each header must agree with the size of the file."""

from __future__ import annotations

import math
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, ClassVar

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from gmwm.base.errors import GmwmError, ReadError
from gmwm.files.contract import Layout, damage_error, register
from gmwm.files.formats.arrays import Array, ArraysReader, fields_of, first_line, layouts_of, part_of
from gmwm.files.formats.byte_sources import ZIP, FileSource, MemberSource, file_names, open_archive, require_ratio


@register
class NpyReader(ArraysReader):
    """Reader of .npy files, which contain one array: a table, named columns, or a single column."""

    name: ClassVar[str] = "npy"
    extensions: ClassVar[tuple[str, ...]] = (".npy",)
    signatures: ClassVar[tuple[bytes, ...]] = (b"\x93NUMPY",)
    random_access: ClassVar[bool] = True

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return the columns of the array."""
        with path.open("rb") as file:
            shape, order, dtype = _header(file, path)
            offset = file.tell()
        _require_size(shape, dtype, path.stat().st_size - offset, path)
        stored = _Stored(path, offset, shape=shape, fortran=order, dtype=dtype)
        return layouts_of(fields_of("", shape, dtype, stored), path)


@register
class NpzReader(ArraysReader):
    """Reader of .npz files, which contain several named arrays."""

    name: ClassVar[str] = "npz"
    extensions: ClassVar[tuple[str, ...]] = (".npz",)

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 1 if the file is a zip archive whose first member is an array of NumPy."""
        if not head.startswith(ZIP) or len(head) < 30:
            return 0.0
        size = int.from_bytes(head[26:28], "little")
        return 1.0 if head[30 : 30 + size].endswith(b".npy") else 0.0

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return the recordings. Arrays of the same length are the columns of one recording."""
        with open_archive(path) as archive:
            members = [archive.getinfo(name) for name in dict.fromkeys(file_names(archive)) if name.endswith(".npy")]
        require_ratio(sum(m.file_size for m in members), sum(m.compress_size for m in members), path)
        arrays = [array for member in members for array in self._member(path, member)]
        return layouts_of(arrays, path)

    @staticmethod
    def _member(path: Path, member: zipfile.ZipInfo) -> list[Array]:
        source = MemberSource(path, member.filename)
        name = member.filename.removesuffix(".npy")
        with source.open() as file:
            try:
                shape, order, dtype = _header(file, source)
            except PicklesError:
                return []  # strings and settings; nothing is unpickled
            _require_size(shape, dtype, member.file_size - file.tell(), source)
        packed = _Packed(source, shape, order, dtype)
        return fields_of(name, shape, dtype, packed)


@dataclass(frozen=True)
class _Stored:
    """An array in a file, read part by part. Truncation of a memory-mapped file would kill the process."""

    path: Path
    offset: int
    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype[Any]

    def __call__(self, start: int, stop: int, axis: int) -> NDArray[Any]:
        if not self.shape:
            return self._values(0, 1).reshape(())
        # The shape in the order of the numbers in the file.
        shape = self.shape[::-1] if self.fortran else self.shape
        along = len(shape) - 1 - axis if self.fortran else axis
        inner, outer, size = math.prod(shape[along + 1 :]), math.prod(shape[:along]), shape[along]
        start, stop = min(start, size), min(stop, size)
        runs = [self._values((k * size + start) * inner, (k * size + stop) * inner) for k in range(outer)]
        part = np.concatenate([np.empty(0, self.dtype), *runs]) if len(runs) != 1 else runs[0]
        part = part.reshape((*shape[:along], stop - start, *shape[along + 1 :]))
        return part.T if self.fortran else part

    def _values(self, first: int, stop: int) -> NDArray[Any]:
        """Read the numbers from one index to another, in the order of the file."""
        size = self.dtype.itemsize
        with FileSource(self.path).open() as file:
            file.seek(self.offset + first * size)
            data = file.read((stop - first) * size)
        if len(data) < (stop - first) * size:
            raise damage_error(f"{self.path} became shorter while it was read", "changed")
        return np.frombuffer(data, self.dtype)


class PicklesError(ReadError):
    """Raised for an array of Python objects, which only a pickle can restore."""


class _Packed:
    """An array in an archive, unpacked on first use."""

    def __init__(self, source: MemberSource, shape: tuple[int, ...], fortran: bool, dtype: np.dtype[Any]) -> None:
        self._source, self._shape, self._fortran, self._dtype = source, shape, fortran, dtype
        self._kept: NDArray[Any] | None = None

    def __call__(self, start: int, stop: int, axis: int) -> NDArray[Any]:
        if self._kept is None:
            with self._source.open() as file:
                _header(file, self._source)
                size = int(np.prod(self._shape, dtype=object)) * self._dtype.itemsize
                data = file.read(size)
            if len(data) != size:
                raise damage_error(f"{self._source} holds {len(data)} bytes, expected {size}", "cut-off")
            flat = np.frombuffer(data, self._dtype)
            self._kept = flat.reshape(self._shape, order="F" if self._fortran else "C")
        return part_of(self._kept, start, stop, axis)


def _header(file: BinaryIO, name: object) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Read the header of an array. Return its shape, whether it is in Fortran order, and its type."""
    try:
        version = npy_format.read_magic(file)
        # Version 3 differs from version 2 only in the encoding of names.
        read = npy_format.read_array_header_1_0 if version == (1, 0) else npy_format.read_array_header_2_0
        shape, order, dtype = read(file)
    except GmwmError:
        raise
    except Exception as error:  # the header is a Python expression, for which NumPy raises any type of error
        raise damage_error(f"{name} is not a complete NumPy file ({first_line(error)})", "incomplete") from error
    if not all(type(size) is int and 0 <= size < 1 << 62 for size in shape):  # NumPy accepts True
        raise damage_error(f"{name} states the shape {shape}, which no array has", "header-damaged")
    if dtype.itemsize == 0:
        raise ReadError(
            f"{name} holds empty elements instead of numbers", code="no-numbers", advice="Save an array of numbers."
        )
    if dtype.hasobject:
        raise PicklesError(
            f"{name} holds Python objects, which are not read because they can execute code",
            code="python-objects",
            advice="Save only numbers.",
        )
    return shape, order, dtype


def _require_size(shape: tuple[int, ...], dtype: np.dtype[Any], there: int, name: object) -> None:
    expected = int(np.prod(shape, dtype=object)) * dtype.itemsize
    if expected > there:
        raise damage_error(f"{name} is truncated: {there} bytes of numbers, expected {expected}", "cut-off")
