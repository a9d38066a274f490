"""Haar wavelet variance of processes with the autocovariance φ^|k|, φ = ±e^(−λ), and its derivatives.

The kernels in `cpp/src/exponential.cpp` have relative errors of about 1e-16 for every λ from 1e-300 to white noise.
"""

from __future__ import annotations

from collections.abc import Callable
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base import _core

Array = NDArray[np.float64]

WHITE = 700.0
"""Upper limit for λ: beyond it, e^(−λ) is below the rounding error of 1, and cosh λ would soon overflow."""


def gm_shape(lam: Array, h: Array) -> Array:
    """Compute the wavelet variances (n, J) for the autocovariances e^(−λ|k|) with λ (n,), at half-scales h (J,)."""
    return _rows(_core.exponential_shapes, lam, h)


def gm_slope(lam: Array, h: Array) -> Array:
    """Compute the derivatives with respect to λ (n, J) of the wavelet variances of `gm_shape`."""
    return _rows(_core.exponential_slopes, lam, h)


def ar1_shape(phi: Array, h: Array) -> Array:
    """Compute the wavelet variances (n, J) of AR1 processes with φ (n,) and innovation variance 1, at half-scales h."""
    return _rows(_core.autoregressive_shapes, phi, h)


def ar1_slope(phi: Array, h: Array) -> Array:
    """Compute the derivatives with respect to φ (n, J) of the wavelet variances of `ar1_shape`."""
    return _rows(_core.autoregressive_slopes, phi, h)


def _rows(kernel: Callable[[Array, Array, Array], None], parameters: Array, h: Array) -> Array:
    out = np.empty((parameters.size, h.size))
    kernel(np.ascontiguousarray(parameters), h, out)
    return out


def log_decay(phi: Array) -> Array:
    """Compute λ = −ln|φ|, accurately for |φ| near 1. The result is limited to `WHITE`."""
    size = np.maximum(np.abs(phi), np.exp(-WHITE))
    near_one = size > 0.5
    return np.where(near_one, -np.log1p(np.where(near_one, size, 1.0) - 1.0), -np.log(size))


def _series(term: Callable[[int], float], first: int, last: int) -> Array:
    """Return the coefficients term(first) … term(last), highest power first."""
    return np.array([term(n) for n in range(last, first - 1, -1)], dtype=np.float64)


def _polynomial(coefficients: Array, x: Array) -> Array:
    """Evaluate the polynomial at x (n,), as `numpy.polyval` does but faster for the many small calls of a fit."""
    out = np.empty_like(x)
    _core.polynomial(coefficients, x, out)
    return out


def _piecewise(x: Array, series: Callable[[Array], Any], direct: Callable[[Array], Any]) -> Array:
    """Evaluate `series` at arguments below 1, and `direct` at the other arguments."""
    small = x < 1.0
    result = np.empty_like(x)
    result[small] = series(x[small])
    result[~small] = direct(x[~small])
    return result


_EXCESS = _series(lambda k: 1.0 / factorial(2 * k + 1), 1, 10)  # (sinh v − v)/v³ in v²


def _decay(v: Array) -> Array:
    """Compute (1 − e^(−v))/v."""
    return np.asarray(-np.expm1(-v) / v)


def _s(lam: Array) -> Array:
    """Compute 2e^(−λ)(sinh λ − λ)/λ³."""
    return _piecewise(
        lam,
        lambda v: 2.0 * np.exp(-v) * _polynomial(_EXCESS, v * v),
        lambda v: (-np.expm1(-2.0 * v) - 2.0 * v * np.exp(-v)) / v**3,
    )


def block_variance(lam: float, m: Array) -> Array:
    """Compute [e^(−λm) − 1 + m sinh λ]/(2 sinh²(λ/2)), the variance of a sum of m samples with autocovariance
    e^(−λ|k|)."""
    v = np.array([min(lam, WHITE)])
    # Dividing by e^λ and λ² avoids overflow for large λ and cancellation for small λ.
    x = np.asarray(m, dtype=np.float64) * v
    curve = _piecewise(x, lambda x: _polynomial(_CURVE, x), lambda x: np.asarray((np.expm1(-x) + x) / (x * x)))
    return np.asarray((2.0 * np.exp(-v) * m * m * curve + v * m * _s(v)) / _decay(v) ** 2)


_CURVE = _series(lambda n: (-1) ** n / factorial(n), 2, 20)


def oscillation_shape(damping: Array, turn: Array, h: Array) -> Array:
    """Compute the wavelet variances (n, J) for the autocovariances e^(−a|k|)[cos ωk + (a/ω) sin ω|k|], with the damping
    a and the turn ω (n,) per sample, at half-scales h (J,).

    With λ = a + iω and c = 1 + ia/ω, 4h²ν² = Re c [2h coth(λ/2) − (6 − 8e^(−λh) + 2e^(−2λh))/(4 sinh²(λ/2))].
    """
    # Above half the sampling rate, the turn of an alias has the same exponentials.
    alias = turn - 2.0 * np.pi * np.round(turn / (2.0 * np.pi))
    lam = (np.minimum(damping, WHITE) + 1j * alias)[:, None]
    c = 1.0 + 1j * (damping / turn)[:, None]
    x = lam * h
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        e = np.exp(-x)
        direct = 2.0 * h * c / np.tanh(0.5 * lam) - (6.0 - 8.0 * e + 2.0 * e * e) * c / (4.0 * np.sinh(0.5 * lam) ** 2)
    small = np.abs(x) < 0.5
    if small.any():
        # (λ/2)² / sinh²(λ/2) − 1
        square = np.where(np.abs(lam) < 0.5, 0.25 * lam * lam, 0.0)
        excess = square * np.polyval(_EXCESS, square)
        less = -excess * (2.0 + excess) / (1.0 + excess) ** 2
        # Re cλ is 0 without an alias, so that the series begins with its second term.
        first = (damping * (1.0 - alias / turn))[:, None] + c * lam * less
        later = c * lam * (1.0 + less) * (4.0 * h * 4.0 * square * np.polyval(_EXCESS[:-1], 4.0 * square))
        later -= c * lam * (1.0 + less) * h**3 * np.where(small, x, 0.0) * np.polyval(_FOURTH, np.where(small, x, 0.0))
        direct = np.where(small, (4.0 * h + 8.0 * h**3) / 6.0 * first + later, direct)
    return np.asarray(direct.real / (4.0 * h * h))


_FOURTH = _series(lambda n: (-1) ** n * (2.0 ** (n + 1) - 8.0) / factorial(n), 4, 22)  # of 6 − 8e^(−x) + 2e^(−2x)
