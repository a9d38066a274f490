"""Estimate wavelet variances and cross-covariances of a recording that is read in chunks.

A cross-covariance is γ̂_ab = (ν̂²_{a+b} − ν̂²_{a−b})/4, so accumulators of wavelet variances are sufficient.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gmwm.applications.several.matrices import moment_of, pairs_of, units_of
from gmwm.base.arrays import Vector
from gmwm.base.threads import in_threads
from gmwm.files.readers.streams import Stream
from gmwm.measuring.streaming.passes import AxisCurves, unit_of
from gmwm.measuring.variance.accumulate import WaveletAccumulator
from gmwm.measuring.variance.open_segments import exact_levels, held_samples
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.batches import Batch, Batches
from gmwm.recording.gaps import fill_gaps, filled
from gmwm.recording.signals import Signal

Pair = tuple[str, str]


class Curves(NamedTuple):
    """Wavelet variances and cross-covariances of several axes."""

    own: Mapping[str, WaveletVariance]  # wavelet variance of each axis
    moments: Mapping[Pair, Vector]  # cross-covariances γ̂_j of each pair
    first: Mapping[str, Signal]  # the first batch of samples of each axis, or the whole signals


def streamed_curves(stream: Stream, axes: Sequence[str], *, robust: bool, efficiency: float) -> Curves:
    """Read a recording, and return the wavelet variances of its axes and the cross-covariances of all pairs. The axes
    are scaled to similar size before they are added. Classical estimates do not depend on the scales and need one pass.
    Robust estimates do, so the axes are measured first, and their sums and differences afterwards, in up to four
    passes."""
    pairs, signs = pairs_of(list(axes)), (1.0, -1.0) if robust else (1.0,)
    sums = {f"{a} {sign:+g} {b}": (a, b, sign) for a, b in pairs for sign in signs}
    count, held = exact_levels(len(axes) + len(sums)), held_samples(len(axes) + len(sums))
    curves = {
        name: AxisCurves(
            WaveletAccumulator(
                stream.rate, held=held, exact=count, unit="" if name in sums else unit_of(stream, name), axis=name,
                robust=robust,
            ),
            stream.source,
            efficiency=efficiency,
        )
        for name in (*axes, *sums)
    }  # fmt: skip
    source = _SumReader(stream, axes, sums)
    if not robust:
        source.measure(curves)
        measured = in_threads(lambda _, curve: curve.classical(), curves)
    else:
        measured = _robust(source, {axis: curves[axis] for axis in axes})
        source.scale = units_of(measured)
        measured |= _robust(source, {name: curves[name] for name in sums})
    singles = {axis: measured[axis] for axis in axes}
    moments = {
        (a, b): moment_of(
            [measured[f"{a} {sign:+g} {b}"].variance for sign in signs], singles, source.scale, pair=(a, b)
        )
        for a, b in pairs
    }
    return Curves(singles, moments, fill_gaps(source.first))


def _robust(source: _SumReader, curves: Mapping[str, AxisCurves]) -> dict[str, WaveletVariance]:
    """Return robust wavelet variances, from one or two passes over the recording."""
    source.measure(curves)
    if again := {name: curve for name, curve in curves.items() if curve.begin_again()}:
        source.measure(again)
    return dict(in_threads(lambda _, curve: curve.robust(), curves))


class _SumReader:
    """Reads a recording in batches, and adds its axes and their sums to accumulators of wavelet variances."""

    def __init__(self, stream: Stream, axes: Sequence[str], sums: Mapping[str, tuple[str, str, float]]) -> None:
        self._batches, self._axes, self._sums = Batches(stream), axes, sums
        self.scale: dict[str, float] = {}
        self.first: dict[str, Signal] = {}

    def measure(self, curves: Mapping[str, AxisCurves]) -> None:
        """Add all batches to the accumulators, with short gaps filled."""
        for batch in filled(map(self._chosen, self._batches), together=True):
            self._add(batch, curves)
            del batch  # frees memory before the next batch is read

    def _add(self, batch: Batch, curves: Mapping[str, AxisCurves]) -> None:
        def add(name: str, curve: AxisCurves) -> None:
            a, b, sign = self._sums.get(name, (name, "", 0.0))
            signal = batch.signals[a]
            if b:
                values = self.scale[a] * signal.values + sign * self.scale[b] * batch.signals[b].values
                signal = replace(signal, values=values)
            curve.update(signal, batch.continues_on(a))

        in_threads(add, curves)

    def _chosen(self, batch: Batch) -> Batch:
        """Return the chosen axes of a batch. The first batch determines the scale factors."""
        signals = {axis: batch.signals[axis] for axis in self._axes}
        if not self.first:
            self.first = signals
            self.scale = {axis: _size(signal.values) for axis, signal in signals.items()}
        return Batch(signals, batch.first, batch.continues)


def _size(values: Vector) -> float:
    """Return the reciprocal of the RMS difference between neighbouring samples, or 1 if this is 0."""
    size = float(np.sqrt(np.mean(np.diff(values) ** 2))) if values.size > 1 else 0.0
    return 1 / size if size > 0 else 1.0
