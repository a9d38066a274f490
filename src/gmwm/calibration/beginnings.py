"""Compute the additions to each calibrated axis from the first samples of its recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from gmwm.base.threads import in_threads
from gmwm.calibration.additions import axis_additions
from gmwm.calibration.measurement import AxisMeasurement, beginning, clean
from gmwm.calibration.result import AxisCalibration
from gmwm.calibration.several import Part
from gmwm.files.readers.streams import Stream
from gmwm.recording.batches import Batch, batches, cut, joined
from gmwm.recording.signals import Imu, Signal


def kept_samples(axis: str, parts: Mapping[str, Part]) -> list[Signal]:
    """Return the first samples of an axis in each recording if its measurements have kept all of them, otherwise an
    empty list."""
    items = [part.item for part in parts.values() if part.conditions.applied(axis) is None]
    kept = [item.beginning for item in items if isinstance(item, AxisMeasurement) and item.beginning is not None]
    return kept if len(kept) == len(parts) else []


def with_additions(found: AxisCalibration, signals: Sequence[Signal]) -> AxisCalibration:
    """Return the calibration of an axis with its additions, which are computed from these samples."""
    if not signals:
        return found
    values = {addition.name: addition.of_axis(found.fit, signals) for addition in axis_additions()}
    return replace(found, additions={name: value for name, value in values.items() if value is not None})


def with_missing_additions(
    done: Mapping[str, AxisCalibration],
    parts: Mapping[str, Mapping[str, Part]],
    recordings: Mapping[str, Any],
    threads: int | None,
) -> dict[str, AxisCalibration]:
    """Return the calibrations with the additions to the axes whose first samples were not kept.

    As in the calibration, isolated wrong samples and knocks are replaced, because they are not part of the normal noise
    and a monitor must report them. The effect of conditions is not removed, because a monitor does not remove it
    either.

    Parameters
    ----------
    done : mapping of axis to AxisCalibration
    parts : mapping of axis to mapping of recording to Part
        The measurements, which contain the first samples.
    recordings : mapping of name to Imu, Signal, Stream, or mapping of axis to Signal
        The recordings that were calibrated. If there are several, an addition is computed from all of them together.
    threads : int or None
        Number of axes that are processed at the same time.
    """
    missing = {axis: found for axis, found in done.items() if not kept_samples(axis, parts[axis])}

    def kept(axis: str, name: str) -> list[Signal]:
        return kept_samples(axis, {name: parts[axis][name]}) if name in parts[axis] else []

    firsts = {
        name: _first_samples(recording)
        for name, recording in recordings.items()
        if any(not kept(axis, name) for axis in missing)
    }

    def first_samples(axis: str, name: str) -> Signal | None:
        if own := kept(axis, name):
            return own[0]
        signal = firsts[name].get(axis)
        return None if signal is None else clean(cut(signal, 0, beginning()))

    def work(axis: str, found: AxisCalibration) -> AxisCalibration:
        return with_additions(found, [one for name in recordings if (one := first_samples(axis, name)) is not None])

    return {**done, **in_threads(work, missing, threads=threads)}


def _first_samples(data: Any) -> Mapping[str, Signal]:
    """Return the signals of a recording by axis, at least up to the last sample that an addition needs."""
    if isinstance(data, Imu | Stream):
        parts: list[Batch] = []
        for batch in batches(data):
            parts.append(batch)
            if batch.stop >= beginning():
                break
        return joined(parts).signals
    items = {data.axis or "signal": data} if isinstance(data, Signal) else data
    return {axis: item for axis, item in items.items() if isinstance(item, Signal)}
