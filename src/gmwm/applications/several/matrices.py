"""Estimate the covariance matrices of the wavelet coefficients of several signals at each level."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gmwm.applications.several.pairs import pairs_of
from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import DataError
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.variance.api import signal_wavelet_variance
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.signals import Signal


@dataclass(frozen=True, kw_only=True, eq=False)
class WaveletMatrices:
    """Estimated covariance matrices Γ̂_j of the wavelet coefficients of d signals."""

    names: tuple[str, ...]  # names of the d signals
    values: Matrix  # (J, d, d) Γ̂_j, in the squared unit of the signals
    design: Design  # levels, sampling rate and length, which are the same for all signals

    @property
    def tau(self) -> Vector:
        """Scales τ_j (J,), in seconds."""
        return np.asarray(np.exp2(self.design.levels.astype(np.float64)) / self.design.rate)


def wavelet_matrices(signals: Mapping[str, Signal]) -> WaveletMatrices:
    """Estimate the covariance matrices of synchronous signals, in one pass over each signal and pair."""
    own = {name: measured(signal, False, 0.6) for name, signal in signals.items()}
    unit = units_of(own)
    names = list(signals)
    first = own[names[0]]
    values = np.empty((len(first), len(names), len(names)))
    for k, name in enumerate(names):
        values[:, k, k] = own[name].variance
    for a, b in pairs_of(names):
        j, k = names.index(a), names.index(b)
        values[:, j, k] = values[:, k, j] = product_moment(signals, own, unit, pair=(a, b))
    return WaveletMatrices(names=tuple(names), values=values, design=replace(Design.of(first), excess=None))


def units_of(own: Mapping[str, WaveletVariance]) -> dict[str, float]:
    """Return factors that scale each wavelet variance to the geometric mean 1, so that differences are accurate."""
    short = next((name for name, wv in own.items() if not np.all(wv.variance > 0)), None)
    if short is not None:
        raise DataError(
            f"{short} has no noise at some scales: its wavelet variance is 0", argument="x",
            advice=f"Leave {short} out.",
        )  # fmt: skip
    return {name: math.exp(-0.5 * float(np.mean(np.log(wv.variance)))) for name, wv in own.items()}


def measured(signal: Signal, robust: bool, efficiency: float) -> WaveletVariance:
    """Return the wavelet variance of a signal whose short gaps are already filled."""
    return signal_wavelet_variance(signal, robust=robust, efficiency=efficiency, fill_gaps=False)


def product_moment(
    signals: Mapping[str, Signal],
    own: Mapping[str, WaveletVariance],
    unit: Mapping[str, float],
    *,
    pair: tuple[str, str],
) -> Vector:
    """Return the cross-covariance γ̂_j (J,) of a pair of signals, from the variance of their sum and difference."""
    a, b = pair
    robust = own[a].robust
    curves = []
    for sign in (1.0, -1.0) if robust else (1.0,):
        values = unit[a] * signals[a].values + sign * unit[b] * signals[b].values
        both = replace(signals[a], values=values)
        curves.append(measured(both, robust, own[a].efficiency or 0.6).variance)
    return moment_of(curves, own, unit, pair=pair)


def moment_of(
    curves: Sequence[Vector], own: Mapping[str, WaveletVariance], unit: Mapping[str, float], *, pair: tuple[str, str]
) -> Vector:
    """Return γ̂_j (J,) from the variances of the sum of the scaled signals and, if measured, of their difference."""
    a, b = pair
    if len(curves) == 2:
        gamma = (curves[0] - curves[1]) / 4
    else:
        # The variance of the difference follows from the variances of the signals: ν²₊ + ν²₋ = 2 (ν_a² + ν_b²).
        gamma = (curves[0] - unit[a] ** 2 * own[a].variance - unit[b] ** 2 * own[b].variance) / 2
    return np.asarray(gamma / (unit[a] * unit[b]))
