"""Read MATLAB's .mat files. `gmwm.files.formats.mat5` reads versions 5 to 7; h5py reads version 7.3, which is HDF5.

Arrays are recognised by their names. Two layouts of other programs are known: `data_imu`, a table of time,
accelerometers and gyroscopes (kalibr_allan), and a structure with `wb`, `fb`, `t` and `freq` (NaveGo).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import ClassVar

from gmwm.base.axis_names import AXES
from gmwm.base.errors import ReadError
from gmwm.base.remarks import Remark
from gmwm.files.contract import Layout, register
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
from gmwm.files.formats.hdf5 import MAGIC, arrays_in
from gmwm.files.formats.mat5 import variables

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
