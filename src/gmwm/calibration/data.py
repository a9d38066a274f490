"""Check the input of `calibrate`: the recordings by name, and the axes to calibrate."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np

from gmwm.base.errors import DataError, OptionError
from gmwm.base.units import SI_UNIT, find_unit, sensor_of
from gmwm.calibration.options import CalibrationOptions
from gmwm.measuring.axis_results import as_recording
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.batches import Streamed
from gmwm.recording.signals import Imu, Signal

_MAKE_A_SIGNAL = "Make a signal from an array: `gmwm.Signal(x, rate, 'rad/s')`."


Curve = WaveletVariance | tuple[WaveletVariance, WaveletVariance]
"""A curve that a user gives for an axis, or the classical and the robust curve."""
AxisInput = Signal | Curve  # what a user can give for an axis: its samples, or curves
Part = Imu | Streamed  # axes of a recording that were sampled at the same times


@dataclass(frozen=True, kw_only=True, eq=False)
class Recordings:
    """The data to calibrate, in one form whatever the user gave. The name of a single recording is ""."""

    # The samples of each recording. Signals that were not sampled at the same times are in several parts.
    parts: Mapping[str, tuple[Part, ...]]
    curves: Mapping[str, Mapping[str, Curve]]  # the axes of each recording that the user gave as curves
    axes: tuple[str, ...]  # the axes to calibrate, which all recordings have
    missing: Mapping[str, str]  # the reason why each other axis is not calibrated
    comparisons: int  # number of axes and recordings that are tested for outliers together

    @classmethod
    def of(cls, data: Any, options: CalibrationOptions) -> Recordings:
        """Check the data and the options that concern axes; OptionError or DataError say what is wrong."""
        by_name = recordings_by_name(data)
        if len(by_name) > 1 and options.conditions.arrays:
            raise OptionError(
                "against has arrays, which belong to one recording, and there are several", argument="against",
                advice="Use the temperature of the files, {--against=temperature}, or calibrate each recording by "
                "itself.",
            )  # fmt: skip
        inputs = chosen_axes({name: data_of_axes(recording) for name, recording in by_name.items()}, options.wanted)
        axes, missing = common_axes(inputs)
        require_axes(options, axes)
        curves = {
            name: {axis: item for axis, item in of_axes.items() if axis in axes and not isinstance(item, Signal | None)}
            for name, of_axes in inputs.items()
        }
        parts = {
            name: (recording,) if isinstance(recording, Part) else _parts_of(inputs[name], axes)
            for name, recording in by_name.items()
        }
        comparisons = len(axes) * len(by_name)
        return cls(parts=parts, curves=curves, axes=tuple(axes), missing=missing, comparisons=comparisons)

    @property
    def source(self) -> str:
        """File or other origin of a single recording, or the names of several recordings."""
        single = self.parts.get("")
        return ", ".join(self.parts) if single is None else single[0].source if single else ""


def _parts_of(inputs: Mapping[str, AxisInput | None], axes: Sequence[str]) -> tuple[Imu, ...]:
    """Return recordings of the signals that were sampled at the same times."""
    parts: dict[tuple[Any, ...], dict[str, Signal]] = {}
    for axis in axes:
        signal = inputs[axis]
        if isinstance(signal, Signal):
            clock = signal.rate, signal.segments, signal.starts, signal.gaps_known
            parts.setdefault(clock, {})[axis] = signal
    return tuple(Imu(signals) for signals in parts.values())


def recordings_by_name(data: Any) -> dict[str, Any]:
    """Return recordings by name: "" for one, file names in a list, or numbers if these are not unique."""
    if isinstance(data, Mapping) and len(data) > 1 and all(isinstance(item, Imu | Streamed) for item in data.values()):
        return dict(data)
    if not isinstance(data, list | tuple):
        return {"": as_recording(data)}
    items = [Imu({item.axis or "signal": item}) if isinstance(item, Signal) else as_recording(item) for item in data]
    for item in items:
        if not isinstance(item, Imu | Streamed):
            raise OptionError(
                argument="data", expected="recordings in the list, each an Imu, a Signal or a Stream", got=item,
                advice="Read each file: `calibrate([gmwm.read(path) for path in paths])`."
                if isinstance(item, str | os.PathLike) else _MAKE_A_SIGNAL,
            )  # fmt: skip
    if not items:
        raise OptionError(argument="data", expected="at least one recording", got=data)
    if len(items) == 1:
        return {"": items[0]}
    return dict(zip(names_of([item.source for item in items]), items, strict=True))


def names_of(sources: Sequence[str]) -> tuple[str, ...]:
    """Return names of recordings: those of their files if these are unique, or else numbers from 1."""
    stems = tuple(PurePath(source).stem for source in sources)
    return stems if all(stems) and len(set(stems)) == len(stems) else tuple(map(str, range(1, len(stems) + 1)))


def data_of_axes(data: object) -> dict[str, AxisInput | None]:
    """Return the data of each axis of a recording; None for each axis of a stream, which is read later."""
    items: dict[str, AxisInput | None]
    if isinstance(data, Signal):
        items = {data.axis or "signal": data}
    elif isinstance(data, Imu):
        items = dict(data.signals)
    elif isinstance(data, Streamed):
        items = dict.fromkeys(data.axes)
    elif isinstance(data, Mapping) and data:
        items = dict(data)
    else:
        advice = "Read the file first: `calibrate(gmwm.read(path))`." if isinstance(data, str | os.PathLike) else ""
        raise OptionError(
            "data must be an Imu, a Signal, a Stream, or a mapping of axis to Signal or WaveletVariance; got "
            f"{'an empty mapping' if isinstance(data, Mapping) else type(data).__name__}",
            argument="data",
            advice=_MAKE_A_SIGNAL if isinstance(data, np.ndarray) else advice,
        )
    for axis, item in items.items():
        pair = isinstance(item, tuple) and len(item) == 2 and all(isinstance(wv, WaveletVariance) for wv in item)
        if not pair and not isinstance(item, Signal | WaveletVariance | None):
            raise OptionError(
                f"{axis} must be a Signal or a WaveletVariance; got {type(item).__name__}",
                argument="data",
                advice=_MAKE_A_SIGNAL,
            )
    for axis, item in items.items():
        if item is not None:
            unit = item[0].unit if isinstance(item, tuple) else item.unit
            parsed = find_unit(unit)
            quantity = next((quantity for quantity in SI_UNIT if sensor_of(axis) == quantity), None)
            if parsed is not None and quantity is not None and parsed.quantity != quantity:
                raise OptionError(
                    f"{axis} must be in a unit of its sensor, such as {SI_UNIT[quantity]}; got {unit}",
                    argument="data",
                    advice="Correct the unit, or give the axis another name.",
                )
    return items


def chosen_axes(
    inputs: Mapping[str, Mapping[str, AxisInput | None]], wanted: tuple[str, ...] | None
) -> dict[str, dict[str, AxisInput | None]]:
    """Return the data of the wanted axes of each recording. Each wanted axis must be in a recording, but not in all."""
    known = dict.fromkeys(axis for items in inputs.values() for axis in items)
    unknown = [name for name in wanted or () if name not in known and name not in map(sensor_of, known)]
    if unknown:
        raise OptionError(argument="axes", expected=f"some of {', '.join(known)}", got=unknown[0])
    return {
        name: {axis: item for axis, item in items.items() if not wanted or axis in wanted or sensor_of(axis) in wanted}
        for name, items in inputs.items()
    }


def require_axes(options: CalibrationOptions, axes: Sequence[str]) -> None:
    """Raise an OptionError if a model is for an axis or sensor that is not calibrated, or `within` is for no axis."""
    for name in options.models:
        if name not in axes and name not in map(sensor_of, axes):
            raise OptionError(argument="models", expected=f"models of some of {', '.join(axes)}", got=name)
    if not options.searched and options.gives_all(axes):
        raise OptionError(
            "a model is given for every axis, so that no models are compared", argument="within",
            got=str(options.within), advice="Leave {--within} out, or leave an axis out of {--models}.",
        )  # fmt: skip


def common_axes(chosen: Mapping[str, Mapping[str, object]]) -> tuple[list[str], dict[str, str]]:
    """Return the axes that all recordings have, and for each other axis the reason why it is not calibrated."""
    every = list(dict.fromkeys(axis for axes in chosen.values() for axis in axes))
    lacking = {axis: [name for name, axes in chosen.items() if axis not in axes] for axis in every}
    missing = {axis: f"{', '.join(names)} does not have this axis" for axis, names in lacking.items() if names}
    if len(missing) == len(every):
        axes_of = "; ".join(f"{name}: {', '.join(axes) or 'none'}" for name, axes in chosen.items())
        raise DataError(
            f"the recordings have no axis in common: {axes_of}", argument="data",
            advice="Calibrate each by itself. `gmwm export` writes one file of all results.",
        )  # fmt: skip
    return [axis for axis in every if axis not in missing], missing
