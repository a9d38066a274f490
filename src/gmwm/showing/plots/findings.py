"""Samples of a recording that the inspection names, for its plot over time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gmwm.measuring.outliers import find_spikes
from gmwm.recording.batches import batches
from gmwm.recording.repairs.plan import plans_of
from gmwm.recording.signals import Imu
from gmwm.showing.plots.figure import Stroke, Symbol

if TYPE_CHECKING:
    from gmwm.measuring.inspection import Inspection

Samples = Mapping[str, NDArray[np.int64]]
"""Numbers of the samples of each finding of one axis."""

SYMBOLS: dict[str, tuple[str, Symbol]] = {
    "Clipped": ("#b2182b", "triangle"), "Wrong sample": ("#d95f02", "cross"), "Knock": ("#e6ab02", "diamond"),
    "Jump": ("#1b1f24", "square"), "Repeated": ("#6a3d9a", "circle"), "Frozen": ("#1f78b4", "square"),
    "Interpolated": ("#33a02c", "diamond"), "Wrapped": ("#a6761d", "down"), "Rarer level": ("#e7298a", "circle"),
}  # fmt: skip
STROKES = {label: Stroke(colour, 0.0, symbol=symbol) for label, (colour, symbol) in SYMBOLS.items()}
"""Symbols of the findings."""
_MOST, _AVERAGED = 300, 16
"""Largest number of symbols of one finding, and number of samples whose mean is at one of two levels."""


def samples_of_findings(imu: Imu, inspection: Inspection) -> dict[str, Samples]:
    """Return the samples of each finding by axis, evenly thinned."""
    findings: dict[str, dict[str, NDArray[np.int64]]] = {axis: {} for axis in imu}
    clipped = {str(remark.subject) for remark in inspection.remarks if remark.code == "output-clipped"}
    for axis, signal in imu.signals.items():
        values = signal.values
        if axis in clipped:
            findings[axis]["Clipped"] = np.flatnonzero((values == values.max()) | (values == values.min()))
        findings[axis]["Wrong sample"] = find_spikes(signal).indices
        times = [step.time for step in inspection.steps if step.axis == axis]
        findings[axis]["Jump"] = _nearest(imu, axis, times)
        # A knock of one sample is a wrong sample.
        knocks = [
            knock.time + 0.5 * knock.duration
            for knock in inspection.knocks
            if axis in knock.axes and knock.duration > 0
        ]
        findings[axis]["Knock"] = _nearest(imu, axis, knocks)
    base = imu.time_base
    begins = np.array([first for first, _ in imu[next(iter(imu))].segments])
    for plan in plans_of(next(batches(imu)), 0.0 if base is None else base.duplicates / max(len(imu), 1)):
        masks = plan.left_out({axis: imu[axis].values for axis in plan.axes}, begins)
        for axis in plan.axes:
            values = imu[axis].values
            for name, mask in masks.items():
                findings[axis][name.capitalize()] = np.flatnonzero(mask)
            if axis in plan.wraps:
                findings[axis]["Wrapped"] = np.flatnonzero(plan.unwrapped(axis, values) != values)
            if axis in plan.levels:
                means = np.convolve(values - np.median(values), np.full(_AVERAGED, 1 / _AVERAGED), "same")
                findings[axis]["Rarer level"] = np.flatnonzero(np.abs(means) > 0.5 * plan.levels[axis].size)
    return {
        axis: {label: _thinned(samples) for label, samples in of_axis.items() if samples.size}
        for axis, of_axis in findings.items()
    }


def _thinned(samples: NDArray[np.int64]) -> NDArray[np.int64]:
    return samples[np.unique(np.linspace(0, samples.size - 1, min(samples.size, _MOST)).astype(np.int64))]


def _nearest(imu: Imu, axis: str, times: list[float]) -> NDArray[np.int64]:
    """Return the samples nearest to times (s) since the first sample of the file."""
    signal = imu[axis]
    if not times:
        return np.empty(0, dtype=np.int64)
    beginning = imu.time_base.left if imu.time_base else 0.0
    since = signal.times(np.arange(len(signal))) - signal.times(np.array([0]))[0] + beginning
    return np.clip(np.searchsorted(since, times), 0, len(signal) - 1)
