"""Read data sets, tables of records and groups from HDF5 files and from MATLAB files of version 7.3.

Links to other files, virtual and external data are ignored. Attributes, or a description, state units and the rate."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gmwm.base import extras
from gmwm.base.errors import GmwmError, ReadError
from gmwm.files.contract import Layout, damage_error, register
from gmwm.files.formats.arrays import (
    MAX_ARRAYS,
    Array,
    ArraysReader,
    fields_of,
    first_line,
    is_rate,
    layouts_of,
    part_of,
    split_path,
    with_stated_units,
)
from gmwm.files.formats.byte_sources import require_ratio

MAGIC = b"\x89HDF\r\n\x1a\n"
_SHORT, _DESCRIPTION = 256, 1 << 14  # bytes of an attribute
_NO_NUMBERS = (b"char", b"logical", b"cell", b"function_handle")


@register
class Hdf5Reader(ArraysReader):
    """Reader of data sets in HDF5 files."""

    name: ClassVar[str] = "hdf5"
    extensions: ClassVar[tuple[str, ...]] = (".h5", ".hdf5", ".hdf")
    signatures: ClassVar[tuple[bytes, ...]] = (MAGIC,)
    random_access: ClassVar[bool] = True

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return the recordings. Data sets of the same length are the columns of one recording."""
        return layouts_of(arrays_in(path), path)


def arrays_in(path: Path) -> list[Array]:
    """Return all arrays of numbers in an HDF5 file, named by their paths without the first slash."""
    library = extras.library("h5py")
    arrays: list[Array] = []
    texts: list[str] = []
    try:
        with library.File(path, "r") as file:
            _collect(library, file, where="", path=path, found=arrays, depth=0)
            texts = [text for key in file.attrs if isinstance(text := _attribute(file, key, _DESCRIPTION), str)]
    except GmwmError:
        raise
    except Exception as error:  # the library raises any type of error for a damaged file
        raise _incomplete(path, error) from error
    return with_stated_units(arrays, texts)


def _collect(library: Any, group: Any, where: str, path: Path, found: list[Array], depth: int) -> None:
    """Append the arrays of a group and of the groups in it to `found`."""
    found += _stated_rates(group, where)
    for key in group:
        if not isinstance(group.get(key, getlink=True), library.HardLink):
            continue
        node = group.get(key)
        name = f"{where}/{key}" if where else key
        if len(found) > MAX_ARRAYS or depth > 8:
            raise ReadError(
                f"{path} holds more than {MAX_ARRAYS} data sets, or groups deeper than 8",
                code="too-many",
                advice="Save only the arrays of the recording.",
            )
        if isinstance(node, library.Group):
            _collect(library, node, where=name, path=path, found=found, depth=depth + 1)
        elif isinstance(node, library.Dataset):
            found += _dataset(node, name, path)


def _dataset(node: Any, name: str, path: Path) -> list[Array]:
    if node.shape is None or node.is_virtual or node.external or node.dtype.hasobject or len(node.shape) > 2:
        return []
    if _attribute(node, "MATLAB_class") in _NO_NUMBERS:
        return []
    packed = min(node.id.get_storage_size(), path.stat().st_size)  # a damaged file may claim more than there is
    require_ratio(int(np.prod(node.shape, dtype=object)) * node.dtype.itemsize, packed, f"{path}:{name}")
    arrays = fields_of(
        name, node.shape, dtype=node.dtype, rows=_DatasetRows(path, node.name, len(node.shape)), unit=_unit(node)
    )
    return arrays + _stated_rates(node, split_path(name)[0])


class _DatasetRows:
    """Rows of a data set. The file is open only while they are read."""

    def __init__(self, path: Path, name: str, dimensions: int) -> None:
        self._path, self._name, self._dimensions = path, name, dimensions

    def __call__(self, start: int, stop: int, axis: int) -> NDArray[Any]:
        library = extras.library("h5py")
        try:
            with library.File(self._path, "r") as file:
                node = file[self._name]
                if self._dimensions == 0:
                    return np.asarray(node[()])
                return np.asarray(node[start:stop] if axis == 0 else node[:, start:stop])
        except Exception as error:
            raise _incomplete(self._path, error) from error


def _unit(node: Any) -> str:
    """Return the unit that an attribute states; "" if there is none."""
    for key in ("units", "unit", "Units", "Unit", "UNITS"):
        text = _attribute(node, key)
        if isinstance(text, bytes):
            return text.decode("latin-1")
        if isinstance(text, str):
            return text
    return ""


def _stated_rates(node: Any, where: str) -> list[Array]:
    """Return the sampling rates that attributes state, each as a scalar array."""
    rates = []
    for key in node.attrs:
        if isinstance(key, str) and is_rate(key):
            value = np.asarray(_attribute(node, key))
            if value.dtype.kind in "iuf" and value.size == 1:
                name = f"{where}/{key}" if where else key
                rates.append(Array(name, (), value.dtype, partial(part_of, value.reshape(()))))
    return rates


def _attribute(node: Any, key: str, most: int = _SHORT) -> Any:
    """Return an attribute; None if it has more than `most` bytes, which could take minutes in a damaged file."""
    if key not in node.attrs:
        return None
    identifier = node.attrs.get_id(key)
    return node.attrs[key] if identifier.shape in ((), (1,)) and identifier.get_storage_size() <= most else None


def _incomplete(path: Path, error: Exception) -> ReadError:
    return damage_error(f"{path} is not a complete HDF5 file ({first_line(error)})", "incomplete")
