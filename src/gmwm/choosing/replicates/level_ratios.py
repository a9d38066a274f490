"""Ratios of the wavelet deviations of several recordings at each scale, with their tests."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.errors import DataError
from gmwm.measuring.covariance.api import variances
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.covariance.mixture import mixture
from gmwm.measuring.variance.result import WaveletVariance

LEAST = 2.0
"""A level is tested only if both estimates have more degrees of freedom than this."""


@dataclass(frozen=True, kw_only=True)
class LevelRatio:
    """Ratio of the wavelet deviations of two recordings at one scale, or of one recording to the mean of the others.

    Attributes
    ----------
    axis : str
        Name of the axis.
    recording : str
        Name of the recording in the numerator.
    level : int
        Level j.
    tau : float
        Scale (s).
    ratio : float
        ν_1 / ν_2, the ratio of the wavelet deviations.
    lower, upper : float or None
        Confidence limits of the ratio; None if the level has too few degrees of freedom for a test.
    pvalue : float or None
        p-value of equal noise, adjusted for the number of tests; None if the level is not tested.
    differs : bool
        Whether the test finds a difference.
    """

    ratio: float
    axis: str = ""
    recording: str = ""
    level: int = 0
    tau: float = 0.0
    lower: float | None = None
    upper: float | None = None
    pvalue: float | None = None
    differs: bool = False


class _Curve(NamedTuple):
    """Wavelet variance (J,) of a recording, and its degrees of freedom (J,)."""

    variance: Vector
    freedom: Vector


def level_ratios(
    curves: Mapping[str, WaveletVariance], axis: str = "", *, confidence: float = 0.95, tolerance: float = 0.0
) -> list[LevelRatio]:
    """Return the ratios of wavelet variances at each common level, with unadjusted p-values; see `same`."""
    measured = list(curves.values())
    levels = min(map(len, measured))
    if not all(np.all(wv.variance[:levels] > 0) for wv in measured):
        raise DataError(f"{axis} has no noise at some scales: its wavelet variance is 0", argument="recordings")
    eta = np.array([wv.degrees_of_freedom[:levels] for wv in measured])
    pooled = np.average([wv.variance[:levels] for wv in measured], axis=0, weights=eta)
    known = {name: _Curve(wv.variance[:levels], _freedom(pooled, eta.sum(axis=0), wv)) for name, wv in curves.items()}
    # With two recordings, the comparison of the second with the first would repeat the comparison of the first with it.
    compared = list(known)[: 1 if len(known) == 2 else None]
    rows = []
    for name in compared:
        others = _mean([curve for other, curve in known.items() if other != name])
        for k in range(levels):
            row = _row(known[name], others, k, confidence=confidence, tolerance=tolerance)
            rows.append(replace(row, axis=axis, recording=name, level=k + 1, tau=float(measured[0].tau[k])))
    return rows


def _mean(curves: Sequence[_Curve]) -> _Curve:
    """Return the mean of independent wavelet variances of the same noise, weighted by their degrees of freedom."""
    freedom = np.sum([curve.freedom for curve in curves], axis=0)
    total = np.sum([curve.freedom * curve.variance for curve in curves], axis=0)
    return _Curve(total / freedom, freedom)


def _row(one: _Curve, other: _Curve, k: int, *, confidence: float, tolerance: float) -> LevelRatio:
    """Return the ratio of two wavelet deviations at the level with index k, and its test."""
    from scipy.special import fdtr, fdtrc, fdtri

    ratio = float(one.variance[k] / other.variance[k])
    degrees = float(one.freedom[k]), float(other.freedom[k])
    if min(degrees) <= LEAST:
        return LevelRatio(ratio=math.sqrt(ratio))
    above = float(fdtrc(*degrees, ratio * math.exp(-2 * tolerance)))
    below = float(fdtr(*degrees, ratio * math.exp(2 * tolerance)))
    lower, upper = (math.sqrt(ratio / float(fdtri(*degrees, (1 + s * confidence) / 2))) for s in (1, -1))
    return LevelRatio(ratio=math.sqrt(ratio), lower=lower, upper=upper, pvalue=min(1.0, 2 * min(above, below)))


def _freedom(pooled: Vector, eta: Vector, wv: WaveletVariance) -> Vector:
    """Return the degrees of freedom η_j (J,) of one wavelet variance under the model for the mean of all recordings."""
    design = Design.of(wv).only(np.arange(len(wv)) < pooled.size)
    curve, model = mixture(pooled, eta, design, random=True)
    return np.asarray(2 * curve**2 / variances(model, design))
