"""Slow twin of the kernels of Haar wavelet variances of autocovariances φ^|k|, φ = ±e^(−λ), in NumPy."""

from __future__ import annotations

from collections.abc import Callable
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WHITE = 700.0


def gm_shape(lam: Array, h: Array) -> Array:
    """Wavelet variance ν² for the autocovariance e^(−λ|k|), at half-scales h: (n,), (J,) → (n, J)."""
    lam, x, y = _arguments(lam, h)
    e1 = _decay(lam)
    return lam * (np.exp(-lam) * h * _f(x, y) + _s(lam) / h) / (2.0 * e1 * e1)


def gm_slope(lam: Array, h: Array) -> Array:
    """Derivative ∂ν²/∂λ for the autocovariance e^(−λ|k|): (n,), (J,) → (n, J)."""
    lam, x, y = _arguments(lam, h)
    z = _z(0.5 * lam)
    curve = 2.0 * h * h * ((y / x) ** 2 - _f(x, y) * (1.0 + 0.25 * lam * lam * z)) + z
    return np.exp(-lam) * curve / (2.0 * h * _decay(lam) ** 2)


def ar1_shape(phi: Array, h: Array) -> Array:
    """Wavelet variance ν² of an AR(1) process with innovation variance 1: (n,), (J,) → (n, J)."""
    result = np.empty((phi.size, h.size))
    negative = phi < 0
    result[~negative] = _positive_shape(phi[~negative], h)
    result[negative] = _negative_shape(phi[negative], h)
    return result


def ar1_slope(phi: Array, h: Array) -> Array:
    """Derivative ∂ν²/∂φ for an AR(1) process with innovation variance 1: (n,), (J,) → (n, J)."""
    result = np.empty((phi.size, h.size))
    negative = phi < 0
    result[~negative] = _positive_slope(phi[~negative], h)
    result[negative] = _negative_slope(phi[negative], h)
    return result


def log_decay(phi: Array) -> Array:
    """Compute λ = −ln|φ|, accurate for |φ| near 1, up to a limit where e^(−λ) is below the rounding error of 1."""
    size = np.maximum(np.abs(phi), np.exp(-WHITE))
    near_one = size > 0.5
    return np.where(near_one, -np.log1p(np.where(near_one, size, 1.0) - 1.0), -np.log(size))


def _arguments(lam: Array, h: Array) -> tuple[Array, Array, Array]:
    """Return λ (n, 1), x = λh (n, J) and y = 1 − e^(−x)."""
    column = np.minimum(lam, WHITE)[:, None]
    x = column * h
    return column, x, -np.expm1(-x)


def _positive_shape(phi: Array, h: Array) -> Array:
    lam, x, y = _arguments(log_decay(phi), h)
    e1, e2 = _decay(lam), _decay(2.0 * lam)
    return (np.exp(-lam) * h * _f(x, y) + _s(lam) / h) / (4.0 * e1 * e1 * e2)


def _positive_slope(phi: Array, h: Array) -> Array:
    lam, x, y = _arguments(log_decay(phi), h)
    e1, e2 = _decay(lam), _decay(2.0 * lam)
    f = _f(x, y)
    curve = h**3 * _g(x, y, f) + h * h * f * (_r(lam) - 1.0) + 2.0 * _t(lam)
    return curve / (4.0 * h * e1 * e1 * e2)


def _negative_shape(phi: Array, h: Array) -> Array:
    lam, x, y = _arguments(log_decay(phi), h)
    e1, above = _decay(lam), 1.0 - phi[:, None]
    smooth = 0.5 / (h * above**2) - phi[:, None] * (y / x) * (2.0 + y) / (2.0 * h * above**3 * e1)
    # φ^h is negative only at h = 1, where ν² = 1/(2(1 + φ)).
    return np.where(h == 1.0, 0.5 / (lam * e1), smooth)


def _negative_slope(phi: Array, h: Array) -> Array:
    lam, x, y = _arguments(log_decay(phi), h)
    e1, above = _decay(lam), 1.0 - phi[:, None]
    w = (1.0 + 2.0 * phi[:, None]) / above - 0.5 + 0.25 * lam * _z(0.5 * lam)
    curve = h * x * _k(x) + (y / x) * (2.0 + y) * w
    smooth = 1.0 / (h * above**3) - curve / (2.0 * h * above**3 * e1)
    return np.where(h == 1.0, -0.5 / (lam * e1) ** 2, smooth)


# --- functions with a series for small arguments ------------------------------------------------------


def _series(term: Callable[[int], float], first: int, last: int) -> Array:
    """Return the coefficients term(first) … term(last), highest power first."""
    return np.array([term(n) for n in range(last, first - 1, -1)], dtype=np.float64)


def _polynomial(coefficients: Array, x: Array) -> Array:
    return np.polyval(coefficients, x)


def _piecewise(x: Array, series: Callable[[Array], Any], direct: Callable[[Array], Any]) -> Array:
    """Evaluate `series` below 1 and `direct` above, each only at the arguments that need it."""
    small = x < 1.0
    result = np.empty_like(x)
    result[small] = series(x[small])
    result[~small] = direct(x[~small])
    return result


_F = _series(lambda n: (-1) ** n * (4 - 2**n) / factorial(n), 3, 24)
_G = _series(lambda n: (-1) ** (n - 1) * (4 - 2**n) * (n - 3) / factorial(n), 4, 26)
_K = _series(lambda n: (-1) ** n * (2**n - 4) * (1 - n) / factorial(n), 3, 26)
_ODD = _series(lambda k: 1.0 / factorial(2 * k + 1), 0, 10)  # sinh v / v in v²
_EXCESS = _series(lambda k: 1.0 / factorial(2 * k + 1), 1, 10)  # (sinh v − v)/v³ in v²
_COTH = _series(lambda k: 2.0 * k / factorial(2 * k + 1), 1, 10)  # (v cosh v − sinh v)/v³ in v²
_RATIO = _series(lambda k: 2.0 / factorial(2 * k) - 3.0 / factorial(2 * k + 1), 1, 10)
_REST = _series(
    lambda n: (
        -((-2) ** n) / (2 * factorial(n)) + (2 / factorial(n) - 2 / factorial(n - 1) if n % 2 else 1 / factorial(n - 1))
    ),
    4,
    26,
)


def _decay(v: Array) -> Array:
    """Compute (1 − e^(−v))/v."""
    return np.asarray(-np.expm1(-v) / v)


def _f(x: Array, y: Array) -> Array:
    """Compute f(x)/x³, with f(x) = 2(x − y) − y² and y = 1 − e^(−x)."""
    result = (2.0 * (x - y) - y * y) / np.maximum(x, 1.0) ** 3
    small = x < 1.0
    result[small] = _polynomial(_F, x[small])
    return np.asarray(result)


def _g(x: Array, y: Array, f: Array) -> Array:
    """Compute (3f(x)/x − f′(x))/x³, with f = f(x)/x³ given."""
    result = 3.0 * f / x - 2.0 * y * y / np.maximum(x, 1.0) ** 3
    small = x < 1.0
    result[small] = _polynomial(_G, x[small])
    return np.asarray(result)


def _k(x: Array) -> Array:
    """Compute (3 − 4q + q² − 4xq + 2xq²)/x³, q = e^(−x)."""

    def direct(x: Array) -> Array:
        q = np.exp(-x)
        return np.asarray((3.0 - (4.0 + 4.0 * x) * q + (1.0 + 2.0 * x) * q * q) / x**3)

    return _piecewise(x, lambda x: _polynomial(_K, x), direct)


def _s(lam: Array) -> Array:
    """Compute 2e^(−λ)(sinh λ − λ)/λ³."""
    return _piecewise(
        lam,
        lambda v: 2.0 * np.exp(-v) * _polynomial(_EXCESS, v * v),
        lambda v: (-np.expm1(-2.0 * v) - 2.0 * v * np.exp(-v)) / v**3,
    )


def _z(v: Array) -> Array:
    """Compute (v coth v − 1)/v²."""
    return _piecewise(
        v,
        lambda v: _polynomial(_COTH, v * v) / _polynomial(_ODD, v * v),
        lambda v: (v / np.tanh(v) - 1.0) / (v * v),
    )


def _r(lam: Array) -> Array:
    """Compute coth(λ/2) + coth λ − 3/λ."""
    return _piecewise(
        lam,
        lambda v: v * _polynomial(_RATIO, v * v) / _polynomial(_ODD, v * v),
        lambda v: 1.0 / np.tanh(0.5 * v) + 1.0 / np.tanh(v) - 3.0 / v,
    )


def _t(lam: Array) -> Array:
    """Compute [e^(−λ) + λ + 2 − λ(coth λ + coth(λ/2))]/λ³."""
    return _piecewise(
        lam,
        lambda v: _polynomial(_REST, v) / _polynomial(_ODD, v * v),
        lambda v: (np.exp(-v) + v + 2.0 - v * (1.0 / np.tanh(v) + 1.0 / np.tanh(0.5 * v))) / v**3,
    )
