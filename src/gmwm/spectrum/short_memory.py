"""Fit a rational power spectral density, that of an ARMA process, to a measured one by least squares of logarithms."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Matrix, Vector, freeze

ORDERS = (
    (0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (2, 1), (1, 2), (2, 2), (0, 3), (2, 3), (3, 2), (3, 3), (4, 2),
    (2, 4), (4, 4), (6, 4), (4, 6), (6, 6), (8, 8),
)  # fmt: skip
"""Orders (p, q) that are tried: filters up to order 4, with two resonances (tests/spectrum/test_short_memory.py)."""
ACCURACY = 0.005
"""Relative error of a density that is always assumed, so that a few precise frequencies do not decide the shape."""
FLOOR = 1e-4
"""Density, relative to that at low frequencies, below which a stop band does not count: it is far below the noise that
rounding adds to any output (tests/spectrum/test_short_memory.py, an FIR filter)."""
FURTHER = 5
"""Number of orders tried after the best one, before the search ends."""
_STEPS = 40
_NEAR = 1e-4
_RADII = (0.95, 0.6)


@dataclass(frozen=True, kw_only=True, eq=False)
class ShortMemory:
    """An ARMA process whose power spectral density follows the measured one at high frequencies.

    Attributes
    ----------
    phi, theta : (p,), (q,) arrays
        Coefficients: X_t = Σ φ_i X_{t−i} + ε_t + Σ θ_i ε_{t−i}.
    innovation : float
        Variance of ε, in unit².
    covariance : (p + q, p + q) array
        Covariance of the coefficients.
    misfit : float
        Mean squared distance between the logarithms, relative to its expectation; near 1 for a good fit.
    """

    phi: Vector
    theta: Vector
    innovation: float
    covariance: Matrix
    misfit: float

    def __post_init__(self) -> None:
        for array in (self.phi, self.theta, self.covariance):
            freeze(array)

    @property
    def density(self) -> float:
        """Density at the frequency 0, per sample: σ² (1 + Σθ)² / (1 − Σφ)²."""
        return self.innovation * (1 + float(self.theta.sum())) ** 2 / (1 - float(self.phi.sum())) ** 2


def short_memory(
    frequencies: Vector, density: Vector, degrees_of_freedom: Vector, *, rate: float, known: Vector
) -> ShortMemory:
    """Fit the ARMA process of lowest order that describes a power spectral density, in addition to a known part.

    For each order, the sum of squares of log(measured / model) is minimised from several starting points, with weights
    1 / (2/η + 0.005²). The order has the least sum of squares plus log(n) for each coefficient.

    Parameters
    ----------
    frequencies : (n,) array
        Frequencies (Hz), ascending, without those of lines.
    density : (n,) array
        Measured two-sided density per sample, in unit²: σ² for white noise.
    degrees_of_freedom : (n,) array
        Their degrees of freedom η.
    rate : float
        Sampling rate (Hz).
    known : (n,) array
        The part of the density that other processes explain.

    Returns
    -------
    ShortMemory

    References
    ----------
    Brockwell and Davis (1991), Time Series: Theory and Methods, section 10.8, for the likelihood of which these least
    squares are an approximation.
    """
    angles = 2 * math.pi * frequencies / rate
    lags = np.arange(1, max(map(max, ORDERS)) + 1)
    plateau = float(np.median(density[: max(density.size // 8, 3)]))
    data = _Data(
        waves=np.exp(-1j * np.outer(angles, lags)), angles=angles, known=known + FLOOR * plateau,
        logs=np.log(density + FLOOR * plateau), weights=1 / (2 / degrees_of_freedom + ACCURACY**2),
    )  # fmt: skip
    solved: dict[tuple[int, int], _Point] = {}
    least, best, since = math.inf, (0, 0), 0
    for order in ORDERS:
        if sum(order) + 2 > density.size // 2:
            break
        solved[order] = min((_descend(data, *start) for start in _starts(data, order, solved)), key=lambda p: p.loss)
        score = solved[order].loss + sum(order) * math.log(density.size)
        least, best, since = (score, order, 0) if score < least else (least, best, since + 1)
        if since >= FURTHER:
            break
    return _reported(data, solved[best])


@dataclass(frozen=True, eq=False)
class _Data:
    waves: NDArray[np.complex128]
    angles: Vector
    known: Vector
    logs: Vector
    weights: Vector


@dataclass(frozen=True, eq=False)
class _Point:
    """Coefficients of the polynomials a and b of |b|²/|a|², without the leading 1, and the logarithm of the scale."""

    a: Vector
    b: Vector
    scale: float
    loss: float
    left: Vector
    jacobian: Matrix


def _evaluated(data: _Data, a: Vector, b: Vector, scale: float) -> _Point:
    below = 1 + data.waves[:, : a.size] @ a
    above = 1 + data.waves[:, : b.size] @ b
    with np.errstate(all="ignore"):
        own = np.exp(scale) * np.abs(above) ** 2 / np.abs(below) ** 2
        total = own + data.known
        left = data.logs - np.log(total)
        columns = [
            np.ones((data.logs.size, 1)),
            -2 * np.real(data.waves[:, : a.size] / below[:, None]),
            2 * np.real(data.waves[:, : b.size] / above[:, None]),
        ]
        jacobian = np.concatenate(columns, axis=1) * (own / total)[:, None]
    loss = float(np.sum(data.weights * left**2))
    return _Point(a, b, scale, loss if math.isfinite(loss) else math.inf, left, jacobian)


def _descend(data: _Data, a: Vector, b: Vector, scale: float) -> _Point:
    """The local optimum by the Levenberg-Marquardt method, with all roots inside the unit circle."""
    here, damping = _evaluated(data, a, b, scale), 1e-3
    for _ in range(_STEPS):
        root = np.sqrt(data.weights)[:, None] * here.jacobian
        if not np.all(np.isfinite(root)):
            break
        normal, slope = root.T @ root, here.jacobian.T @ (data.weights * here.left)
        size = np.diag(normal) + 1e-12 * np.trace(normal)
        lower = None
        while damping < 1e8:
            step = np.linalg.solve(normal + damping * np.diag(size), slope)
            there = _evaluated(data, here.a + step[1 : 1 + a.size], here.b + step[1 + a.size :], here.scale + step[0])
            if there.loss < here.loss:
                lower = there
                break
            damping *= 4
        if lower is None:
            break
        done = here.loss - lower.loss < _NEAR * max(lower.loss, 1.0)
        here, damping = lower, max(damping / 6, 1e-9)
        if done:
            break
    (inner_a, gain_a), (inner_b, gain_b) = _inside(here.a), _inside(here.b)
    return _evaluated(data, inner_a, inner_b, here.scale - gain_a + gain_b)


def _inside(tail: Vector) -> tuple[Vector, float]:
    """Move the roots of 1 + c₁z⁻¹ + … inside the unit circle; also the logarithm of the factor that |·|² loses."""
    if not tail.size:
        return tail, 0.0
    roots = np.roots(np.concatenate([[1.0], tail]))
    outside = np.abs(roots) > 1
    gain = 2 * float(np.sum(np.log(np.abs(roots[outside]))))
    roots[outside] = 1 / np.conj(roots[outside])
    size = np.abs(roots)
    # A stationary and invertible process has no root on the circle.
    roots = np.where(size > 1 - 1e-6, roots * (1 - 1e-6) / np.maximum(size, 1e-300), roots)
    return np.real(np.poly(roots))[1:], gain


def _starts(
    data: _Data, order: tuple[int, int], solved: dict[tuple[int, int], _Point]
) -> Iterator[tuple[Vector, Vector, float]]:
    """Starting points: the best smaller order, with further roots where their residuals are largest."""
    p, q = order
    smaller = [(at, point) for at, point in solved.items() if at[0] <= p and at[1] <= q]
    if not smaller:
        yield np.zeros(p), np.zeros(q), float(np.average(data.logs, weights=data.weights))
        return
    for at, point in sorted(smaller, key=lambda pair: pair[1].loss)[:1]:
        smooth = np.convolve(np.sqrt(data.weights) * point.left, np.ones(5) / 5, mode="same")
        worst = int(np.argmax(np.abs(smooth)))
        more, less = _RADII if smooth[worst] > 0 else _RADII[::-1]
        places = (
            (data.angles[worst], more, less),
            (data.angles[worst], 0.6, 0.45),
            (math.pi, 0.6, 0.6),
            (0.5, 0.6, 0.5),
        )
        for angle, radius_a, radius_b in places:
            yield (
                _widened(point.a, p - at[0], angle, radius_a),
                _widened(point.b, q - at[1], angle, radius_b),
                point.scale,
            )


def _widened(tail: Vector, count: int, angle: float, radius: float) -> Vector:
    """The polynomial with `count` more roots at a radius and an angle."""
    whole = np.concatenate([[1.0], tail])
    for _ in range(count // 2):
        whole = np.convolve(whole, [1.0, -2 * radius * math.cos(angle), radius**2])
    if count % 2:
        whole = np.convolve(whole, [1.0, -math.copysign(radius, math.cos(angle))])
    return whole[1:]


def _reported(data: _Data, point: _Point) -> ShortMemory:
    root = np.sqrt(data.weights)[:, None] * point.jacobian
    length = np.linalg.norm(root, axis=0)
    # Roots that cancel make the normal equations singular; the pseudo-inverse leaves these directions out.
    inverse = np.linalg.pinv((root / length).T @ (root / length), rcond=1e-10, hermitian=True) / np.outer(
        length, length
    )
    misfit = point.loss / max(data.logs.size - length.size, 1)
    sign = np.concatenate([-np.ones(point.a.size), np.ones(point.b.size)])
    return ShortMemory(
        phi=-point.a, theta=point.b.copy(), innovation=math.exp(point.scale),
        covariance=max(misfit, 1.0) * inverse[1:, 1:] * np.outer(sign, sign), misfit=misfit,
    )  # fmt: skip
