"""Estimate the covariance matrices of the wavelet coefficients of several signals at each level."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, TypeVar

import numpy as np

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import DataError
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.variance.api import wavelet_variance
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.signals import Signal

T = TypeVar("T")


class AxisPairs(dict[tuple[str, str], T]):
    """Values of pairs of axes. The order of the two names of a pair does not matter.

    >>> pairs = AxisPairs({("gyro_x", "gyro_y"): 0.1})
    >>> pairs["gyro_y", "gyro_x"]
    0.1
    """

    def __missing__(self, pair: Any) -> T:
        if pair in self:
            return self[pair[::-1]]
        axes = sorted({axis for key in self for axis in key})
        raise DataError(argument="pair", expected=f"two different names of {', '.join(axes)}", got=pair)

    def get(self, pair: tuple[str, str], default: Any = None) -> Any:
        """Return the value of a pair, or `default` if there is none."""
        return super().get(pair, super().get(pair[::-1], default))

    def __contains__(self, pair: object) -> bool:
        return super().__contains__(pair) or (isinstance(pair, tuple) and super().__contains__(pair[::-1]))


def pairs_of(axes: Sequence[str]) -> list[tuple[str, str]]:
    """Return all pairs of different axes, in the order of the axes."""
    return list(combinations(axes, 2))


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
    curves = {name: measure(signal, False, 0.6) for name, signal in signals.items()}
    unit = units_of(curves)
    names = list(signals)
    first = curves[names[0]]
    values = np.empty((len(first), len(names), len(names)))
    for k, name in enumerate(names):
        values[:, k, k] = curves[name].variance
    for a, b in pairs_of(names):
        j, k = names.index(a), names.index(b)
        values[:, j, k] = values[:, k, j] = product_moment(signals, curves, unit, pair=(a, b))
    return WaveletMatrices(names=tuple(names), values=values, design=replace(Design.of(first), excess=None))


def units_of(curves: Mapping[str, WaveletVariance]) -> dict[str, float]:
    """Return factors that scale each wavelet variance to the geometric mean 1, so that differences are accurate."""
    short = next((name for name, wv in curves.items() if not np.all(wv.variance > 0)), None)
    if short is not None:
        raise DataError(
            f"{short} has no noise at some scales: its wavelet variance is 0", argument="x",
            advice=f"Leave {short} out.",
        )  # fmt: skip
    return {name: math.exp(-0.5 * float(np.mean(np.log(wv.variance)))) for name, wv in curves.items()}


def measure(signal: Signal, robust: bool, efficiency: float) -> WaveletVariance:
    """Return the wavelet variance of a signal whose short gaps are already filled."""
    return wavelet_variance(signal, robust=robust, efficiency=efficiency, fill_gaps=False)


def product_moment(
    signals: Mapping[str, Signal], singles: Mapping[str, WaveletVariance], unit: Mapping[str, float], *,
    pair: tuple[str, str],
) -> Vector:  # fmt: skip
    """Return the cross-covariance γ̂_j (J,) of a pair of signals, from the variance of their sum and difference."""
    a, b = pair
    robust = singles[a].robust
    curves = []
    for sign in (1.0, -1.0) if robust else (1.0,):
        values = unit[a] * signals[a].values + sign * unit[b] * signals[b].values
        both = replace(signals[a], values=values)
        curves.append(measure(both, robust, singles[a].efficiency or 0.6).variance)
    return moment_of(curves, singles, unit, pair=pair)


def moment_of(
    curves: Sequence[Vector], singles: Mapping[str, WaveletVariance], unit: Mapping[str, float], *,
    pair: tuple[str, str],
) -> Vector:  # fmt: skip
    """Return γ̂_j (J,) from the variances of the sum of the scaled signals and, if measured, of their difference."""
    a, b = pair
    if len(curves) == 2:
        gamma = (curves[0] - curves[1]) / 4
    else:
        # The variance of the difference follows from the variances of the signals: ν²₊ + ν²₋ = 2 (ν_a² + ν_b²).
        gamma = (curves[0] - unit[a] ** 2 * singles[a].variance - unit[b] ** 2 * singles[b].variance) / 2
    return np.asarray(gamma / (unit[a] * unit[b]))
