"""Test whether two signals have the same noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gmwm._arrays import Vector, as_rate, as_vector
from gmwm.covariance.api import variances
from gmwm.covariance.design import Design
from gmwm.covariance.mixture import mixture
from gmwm.covariance.tails import excess_covariance
from gmwm.errors import DataError, OptionError
from gmwm.joint.same_result import LevelRatio, SameNoise
from gmwm.multiple_tests import holm
from gmwm.options import as_confidence, as_size
from gmwm.signals import Imu, Signal
from gmwm.variance.api import signal_wavelet_variance
from gmwm.variance.result import WaveletVariance

LEAST = 2.0
"""Degrees of freedom that both estimates of a level need for a test."""


def same(
    x: Imu | Signal | ArrayLike,
    y: Imu | Signal | ArrayLike,
    rate: float | None = None,
    *,
    tolerance: float = 0.0,
    size: float = 0.05,
    confidence: float = 0.95,
) -> SameNoise:
    """Test whether two recordings have the same noise at each scale, without a model.

    If they have, the ratio of their wavelet variances at level j has an F distribution with η_1j and η_2j degrees of
    freedom, η_j = 2 ν_j⁴ / V_jj. V is that of the most likely mixture of processes under the mean of both curves, and
    the covariance from heavy tails or a varying variance is added to it. The p-values of all levels and axes are
    adjusted by Holm's method.

    With millions of samples, differences of a thousandth are found. `tolerance` asks whether they matter.

    Parameters
    ----------
    x, y : Imu, Signal, or (N,) array
        Two recordings of one rate, of any lengths, that were not made at the same time. Of two Imu, the axes that both
        have are compared.
    rate : float
        Sampling rate (Hz); only for plain arrays.
    tolerance : float
        Largest |ln(ν_1/ν_2)| that counts as the same, from 0: 0.1 asks whether deviations differ by more than 10 %.
    size : float
        Significance level of all tests together.
    confidence : float
        Confidence level of the intervals of the ratios.

    Returns
    -------
    SameNoise

    Raises
    ------
    DataError
        If the recordings differ in rate or unit, or have no axis in common.
    OptionError
        If an option has a value that is not allowed.

    References
    ----------
    Holm (1979), A simple sequentially rejective multiple test procedure, Scandinavian Journal of Statistics 6, 65-70.
    Sizes: validation/study_same.py.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> monday, tuesday, later = rng.normal(size=(3, 20_000)) * [[1.0], [1.0], [1.1]]
    >>> same(monday, tuesday, rate=100.0).differs, same(monday, later, rate=100.0).differs
    (False, True)
    >>> same(monday, later, rate=100.0, tolerance=0.2).differs
    False
    """
    size = as_size(size)
    as_confidence(confidence)
    known = isinstance(tolerance, int | float) and not isinstance(tolerance, bool)
    if not known or not 0 <= tolerance < math.inf:
        raise OptionError(argument="tolerance", expected="a number of at least 0, such as 0.1", got=tolerance)
    pairs = _pairs(x, y, rate)
    rows = [
        row
        for axis, (one, other) in pairs.items()
        for row in _rows(axis, one, other, confidence=confidence, tolerance=tolerance)
    ]
    tested = [k for k, row in enumerate(rows) if row.pvalue is not None]
    adjusted = holm([rows[k].pvalue or 0.0 for k in tested]).tolist()
    for k, p in zip(tested, adjusted, strict=True):
        rows[k] = replace(rows[k], pvalue=p, differs=p <= size)
    return SameNoise(
        axes=tuple(pairs), levels=tuple(rows), tolerance=float(tolerance), size=size, confidence=confidence
    )


def _pairs(x: Any, y: Any, rate: float | None) -> dict[str, tuple[Signal, Signal]]:
    """The signals to compare, by axis."""
    given = [_axes(item, rate, name) for item, name in ((x, "x"), (y, "y"))]
    if all(len(one) == 1 for one in given) and not (isinstance(x, Imu) or isinstance(y, Imu)):
        ((name, one),), (other,) = given[0].items(), given[1].values()
        found = {name: (one, other)}
    else:
        found = {axis: (given[0][axis], given[1][axis]) for axis in given[0] if axis in given[1]}
    if not found:
        raise DataError(
            f"the recordings have no axis in common: {', '.join(given[0])}, and {', '.join(given[1])}", argument="y"
        )
    for axis, (one, other) in found.items():
        for what, a, b in (("rate", one.rate, other.rate), ("unit", one.unit, other.unit)):
            if a != b:
                raise DataError(f"the recordings of {axis} differ in their {what}: {a} and {b}", argument="y")
    return found


def _axes(item: Any, rate: float | None, name: str) -> Mapping[str, Signal]:
    if isinstance(item, Imu):
        return item.signals
    signal = item if isinstance(item, Signal) else Signal(as_vector(item, name), as_rate(rate))
    return {signal.axis or "signal": signal}


def _rows(axis: str, one: Signal, other: Signal, *, confidence: float, tolerance: float) -> list[LevelRatio]:
    """The ratio of each level that both recordings have, with the p-value of its test alone."""
    from scipy.special import fdtr, fdtrc, fdtri

    curves = [signal_wavelet_variance(signal) for signal in (one, other)]
    levels = min(map(len, curves))
    if not all(np.all(wv.variance[:levels] > 0) for wv in curves):
        raise DataError(f"{axis} has no noise at some scales: its wavelet variance is 0", argument="x")
    eta = np.array([wv.degrees_of_freedom[:levels] for wv in curves])
    pooled = np.average([wv.variance[:levels] for wv in curves], axis=0, weights=eta)
    freedom = [_freedom(pooled, eta.sum(axis=0), wv, signal) for wv, signal in zip(curves, (one, other), strict=True)]
    rows = []
    for k in range(levels):
        ratio = float(curves[0].variance[k] / curves[1].variance[k])
        degrees = float(freedom[0][k]), float(freedom[1][k])
        tested = min(degrees) > LEAST
        above = float(fdtrc(*degrees, ratio * math.exp(-2 * tolerance)))
        below = float(fdtr(*degrees, ratio * math.exp(2 * tolerance)))
        rows.append(
            LevelRatio(
                axis=axis,
                level=int(curves[0].levels[k]),
                tau=float(curves[0].tau[k]),
                ratio=math.sqrt(ratio),
                lower=math.sqrt(ratio / float(fdtri(*degrees, (1 + confidence) / 2))) if tested else None,
                upper=math.sqrt(ratio / float(fdtri(*degrees, (1 - confidence) / 2))) if tested else None,
                pvalue=min(1.0, 2 * min(above, below)) if tested else None,
            )
        )
    return rows


def _freedom(pooled: Vector, eta: Vector, wv: WaveletVariance, signal: Signal) -> Vector:
    """Degrees of freedom η_j (J,) of one curve under the model of both."""
    levels = pooled.size
    design = Design.of(replace(wv, excess=excess_covariance(signal, wv))).only(np.arange(len(wv)) < levels)
    curve, model = mixture(pooled, eta, design, random=True)
    return np.asarray(2 * curve**2 / variances(model, design))
