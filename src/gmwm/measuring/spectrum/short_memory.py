"""Fit of the power spectral density of an ARMA process to a measured density, by least squares of logarithms."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gmwm.base import _core
from gmwm.base.arrays import FrozenArrays, Matrix, Vector
from gmwm.base.lazy import scipy

STEPS = ((1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (2, 2))
"""Roots (p, q) to add, for filters to order 4, averages and resonances (tests/spectrum/test_short_memory.py)."""
HIGHEST_ORDER = 10  # largest order p or q
LARGEST_ERROR_AT_ZERO = 0.05
"""Largest accepted standard error of the logarithm of the density at the frequency 0: 2.5 % of N, its square root."""
POLE, ZERO = 0.987, 1 - 1e-6
"""Largest moduli of poles (width 0.4 % of the rate, memory 2000 samples, as the covariance supports) and zeros."""
LARGEST_BEND = 0.25
"""Largest |log| of the density at 0 over that at the lowest frequency; a resonance at 4 times it has 0.13."""
STOP_BAND = 1e-4
"""Density, relative to low frequencies, below which a stop band is ignored, far below the noise of rounded outputs."""
FACTOR_PRIOR = 2.0
"""Prior standard deviation of the logarithm of the factor on the known part. Its slow terms come from a fit without
this shape, and may be wrong by a factor of several (docs/validation/sensors.md)."""
LEAST_ORDER_WEIGHT = 0.01
"""Smallest weight for which a process of another order is reported in addition to the best process."""
_ITERATIONS, _FIRST, _KEPT = 40, 6, 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Alternative:
    """Another order that describes the density nearly as well (see `SpectralShape`): density at 0 (unit² per cycle per
    sample), and posterior `weight` among all orders by the BIC."""

    phi: Vector
    theta: Vector
    density: float
    weight: float


@dataclass(frozen=True, kw_only=True, eq=False)
class SpectralShape(FrozenArrays):
    """ARMA process of the measured density at high frequencies: X_t = Σ φ_i X_{t−i} + ε_t + Σ θ_i ε_{t−i}.

    `innovation` is Var ε, and `covariance` that of the coefficients. `misfit` is the mean squared log error over its
    expectation. `alternatives` have weights ≥ 1 %; `simpler` have fewer coefficients, the fewest first."""

    phi: Vector
    theta: Vector
    innovation: float
    covariance: Matrix
    misfit: float
    alternatives: tuple[Alternative, ...] = ()
    simpler: tuple[SpectralShape, ...] = ()

    @property
    def density(self) -> float:
        """Density at the frequency 0 (unit² per cycle per sample), σ² (1 + Σθ)² / (1 − Σφ)²."""
        return self.innovation * (1 + float(self.theta.sum())) ** 2 / (1 - float(self.phi.sum())) ** 2


def short_memory(
    frequencies: Vector, density: Vector, degrees_of_freedom: Vector, *, rate: float, known: Vector,
    order: int = HIGHEST_ORDER,
) -> SpectralShape:  # fmt: skip
    """Fit an ARMA process to the two-sided density (unit² per cycle per sample) beyond that of `known` processes.

    Weights 1 / (2/η + 0.005²) of log(measured / model)² approximate the likelihood (Brockwell and Davis 1991, Time
    Series: Theory and Methods, section 10.8). From white noise on, one to four roots near the largest residuals are
    added, until the gain per coefficient is below log(n); then the factor on `known` is fitted for all good orders. An
    uncertain density at frequency 0 is excluded. `frequencies` (Hz) exclude lines; `order` limits p and q."""
    angles = 2 * math.pi * frequencies / rate
    plateau = float(np.median(density[: max(density.size // 8, 3)]))
    # Smallest known part, relative to the density at low frequencies. It decreases with frequency as for a random walk.
    least = 1e-3 * plateau * (np.sin(angles[0] / 2) / np.sin(angles / 2)) ** 2
    # Relative error that is added to every density, so that a few precise frequencies do not determine the shape.
    data = _Data.of(
        angles, known=np.maximum(known, least), floor=STOP_BAND * plateau,
        logs=np.log(density + STOP_BAND * plateau) - _log_bias(degrees_of_freedom),
        weights=1 / (2 / degrees_of_freedom + 0.005**2),
    )  # fmt: skip
    white = _descend(data, np.zeros(0), np.zeros(0), float(np.average(data.logs, weights=data.weights)))
    price = math.log(density.size)
    # At first the known part is fixed, because it could replace the shape of the filter. Then its factor is fitted too.
    tried = _grown(data, white, price, free=False, order=order)
    each, before = _best_of_each_order(tried), min(tried, key=lambda point: _score(point, price))
    best = _free(data, before)
    moved = _score(before, price) - _score(best, price) > price
    near = _score(before, price) - 2 * math.log(LEAST_ORDER_WEIGHT)
    others = [p for p in each if p is not before and (moved or _score(p, price) <= near)]
    tried = _supportable(data, (best, *(_free(data, point) for point in others)))
    if moved:
        tried += _grown(
            data, min(tried, key=lambda point: _score(point, price), default=white), price, free=True, order=order
        )
    sure = [point for point in tried if _error_at_zero(point, data) <= LARGEST_ERROR_AT_ZERO]
    if not sure:
        # The best orders do not determine the density at 0; smaller orders do.
        tried = _supportable(data, (_free(data, point) for point in each))
        sure = [point for point in tried if _error_at_zero(point, data) <= LARGEST_ERROR_AT_ZERO]
    chosen = min(sure, key=lambda point: _score(point, price), default=white)
    simpler = _supportable(data, (_free(data, point) for point in _best_of_each_size(each, chosen.order)))
    simpler = [point for point in simpler if _error_at_zero(point, data) <= LARGEST_ERROR_AT_ZERO]
    reports = tuple(_report(data, point, ()) for point in _best_of_each_size(simpler, chosen.order))
    return replace(_report(data, chosen, _alternatives(data, chosen, sure, price)), simpler=reports)


def _best_of_each_size(points: Iterable[_ArmaPoint], size: int) -> list[_ArmaPoint]:
    """Return the best point of each number of coefficients from 1 to below `size`, if it is better than with fewer."""
    best: list[_ArmaPoint] = []
    for point in sorted(points, key=lambda point: (point.order, point.loss)):
        if 0 < point.order < size and (not best or (point.order > best[-1].order and point.loss < best[-1].loss)):
            best.append(point)
    return best


def _supportable(data: _Data, points: Iterable[_ArmaPoint]) -> list[_ArmaPoint]:
    """Return the points whose density does not change much between the lowest frequency of the data and 0."""
    return [point for point in points if abs(_bend(data, point)) <= LARGEST_BEND]


def _free(data: _Data, point: _ArmaPoint) -> _ArmaPoint:
    """Return the optimum from this point if the factor on the known part is also fitted."""
    return _descend(data, point.a, point.b, point.scale, free=True)


def _grown(data: _Data, best: _ArmaPoint, price: float, *, free: bool, order: int) -> list[_ArmaPoint]:
    """Add roots to the best process repeatedly; return all processes that were tried."""
    tried = [best]
    while True:
        orders = [m for m in STEPS if best.a.size + m[0] <= order and best.b.size + m[1] <= order]
        candidates = [_best_start(data, best, more, free=free) for more in orders]
        candidates = _supportable(data, candidates)
        tried += candidates
        next_best = min(candidates, key=lambda point: _score(point, price), default=best)
        if _score(next_best, price) >= _score(best, price):
            return tried
        best = next_best


def _best_start(data: _Data, best: _ArmaPoint, more: tuple[int, int], *, free: bool) -> _ArmaPoint:
    """Return the optimum with more roots: a few steps from all starts, then all steps from the best."""
    # Starts can be equal: a real root has no angle, and both residuals can be largest at one frequency.
    distinct = {(a.tobytes(), b.tobytes()): (a, b) for a, b in _starts(data, best, more)}.values()
    short = [_descend(data, a, b, best.scale, slow=best.slow, free=free, steps=_FIRST) for a, b in distinct]
    first = sorted(short, key=lambda point: point.loss)[:_KEPT]
    return min((_descend(data, p.a, p.b, p.scale, slow=p.slow, free=free) for p in first), key=lambda point: point.loss)


def _best_of_each_order(tried: Sequence[_ArmaPoint]) -> list[_ArmaPoint]:
    best: dict[tuple[int, int], _ArmaPoint] = {}
    for point in tried:
        orders = (point.a.size, point.b.size)
        if orders not in best or point.loss < best[orders].loss:
            best[orders] = point
    return list(best.values())


def _log_bias(degrees_of_freedom: Vector) -> Vector:
    """Return the mean (n,) of the logarithm of an estimate divided by its expectation, about −1/η."""
    half = degrees_of_freedom / 2
    return np.asarray(scipy.special.digamma(half) - np.log(half))


@dataclass(frozen=True, eq=False)
class _Data:
    """Measured density: `waves` (2, HIGHEST, n) are exp(−i ω k), `rows` known part, log densities and weights."""

    waves: NDArray[np.float64]
    angles: Vector
    rows: Matrix
    floor: float

    @classmethod
    def of(cls, angles: Vector, *, known: Vector, logs: Vector, weights: Vector, floor: float) -> _Data:
        """Return the data at frequencies `angles`, in radians per sample."""
        phases = np.outer(np.arange(1, HIGHEST_ORDER + 1), angles)
        return cls(np.array([np.cos(phases), -np.sin(phases)]), angles, np.array([known, logs, weights]), floor)

    @property
    def known_part(self) -> Vector:
        """The known part."""
        return np.asarray(self.rows[0])

    @property
    def logs(self) -> Vector:
        """Logarithms of the density."""
        return np.asarray(self.rows[1])

    @property
    def weights(self) -> Vector:
        """Weights of the logarithms."""
        return np.asarray(self.rows[2])

    def polynomial(self, tail: Vector) -> NDArray[np.complex128]:
        """Return the polynomial 1 + c₁z⁻¹ + … at each frequency."""
        real, imaginary = tail @ self.waves[:, : tail.size]
        return np.asarray(1 + real + 1j * imaginary)


@dataclass(frozen=True, kw_only=True, eq=False)
class _ArmaPoint:
    """Process with density e^scale |b|²/|a|² (`a`, `b` without the leading 1); `slow`: log factor on the known part."""

    data: _Data
    a: Vector
    b: Vector
    scale: float
    slow: float

    @property
    def order(self) -> int:
        """Number of coefficients."""
        return self.a.size + self.b.size

    @property
    def density(self) -> float:
        """Density at the frequency 0."""
        return math.exp(self.scale) * (1 + float(self.b.sum())) ** 2 / (1 + float(self.a.sum())) ** 2

    @cached_property
    def parts(self) -> tuple[Vector, Vector, Vector]:
        """The own density, the known part with its factor, and the total, at each frequency."""
        below, above = self.data.polynomial(self.a), self.data.polynomial(self.b)
        with np.errstate(all="ignore"):
            shape = np.exp(self.scale) * (above.real**2 + above.imag**2) / (below.real**2 + below.imag**2)
            slow_part = np.exp(self.slow) * self.data.known_part
            return shape, slow_part, shape + slow_part + self.data.floor

    @cached_property
    def residuals(self) -> Vector:
        """Logarithms of the measured density divided by the total."""
        with np.errstate(all="ignore"):
            return np.asarray(self.data.logs - np.log(self.parts[2]))

    @cached_property
    def loss(self) -> float:
        """Weighted sum of squares, with the prior of `slow`."""
        loss = float(self.data.weights @ self.residuals**2) + (self.slow / FACTOR_PRIOR) ** 2
        return loss if math.isfinite(loss) else math.inf

    @cached_property
    def jacobian(self) -> Matrix:
        """Derivatives (n, 2 + p + q) of the logarithm of the density with respect to `scale`, `a`, `b` and `slow`."""
        shape, slow_part, total = self.parts
        rows = [shape / total]
        for tail, sign in ((self.a, -2), (self.b, 2)):
            factor = sign * rows[0] / self.data.polynomial(tail)
            real, imaginary = self.data.waves[:, : tail.size]
            rows += list(real * factor.real - imaginary * factor.imag)
        return np.array([*rows, slow_part / total]).T


def _descend(
    data: _Data, a: Vector, b: Vector, scale: float, *, slow: float = 0.0, free: bool = False, steps: int = _ITERATIONS
) -> _ArmaPoint:
    """Find the local Levenberg-Marquardt optimum with roots inside the unit circle; `free`: also the known factor."""
    parameters = np.concatenate([[scale], a, b, [slow]])
    _core.spectral_descent(
        data.waves, data.rows, floor=data.floor, prior=FACTOR_PRIOR, p=a.size, free=free, steps=steps, near=1e-4,
        parameters=parameters,
    )  # fmt: skip
    (inner_a, gain_a), (inner_b, gain_b) = (
        _inside(parameters[1 : 1 + a.size], POLE),
        _inside(parameters[1 + a.size : -1], ZERO),
    )
    scale, slow = float(parameters[0]) - gain_a + gain_b, float(parameters[-1])
    return _ArmaPoint(data=data, a=inner_a, b=inner_b, scale=scale, slow=slow)


def _score(point: _ArmaPoint, price: float, spread: float = 1.0) -> float:
    return point.loss / spread + price * point.order


def _error_at_zero(point: _ArmaPoint, data: _Data) -> float:
    """Return the standard error of the logarithm of the density at frequency 0."""
    slopes = np.concatenate([
        [1.0], -2 / (1 + point.a.sum()) * np.ones(point.a.size), 2 / (1 + point.b.sum()) * np.ones(point.b.size), [0.0]
    ])  # fmt: skip
    return math.sqrt(max(float(slopes @ _scatter(point, data) @ slopes), 0.0))


def _scatter(point: _ArmaPoint, data: _Data) -> Matrix:
    """Return the covariance (2 + p + q, 2 + p + q) of the errors of `scale`, `a`, `b` and `slow`."""
    root = np.sqrt(data.weights)[:, None] * point.jacobian
    root = np.vstack([root, np.append(np.zeros(root.shape[1] - 1), 1 / FACTOR_PRIOR)])
    length = np.linalg.norm(root, axis=0)
    length[length == 0] = 1.0
    # Roots that cancel make the normal equations singular; the pseudo-inverse leaves these directions out.
    inverse = np.linalg.pinv((root / length).T @ (root / length), rcond=1e-10, hermitian=True) / np.outer(
        length, length
    )
    return np.asarray(max(point.loss / max(data.logs.size - length.size, 1), 1.0) * inverse)


def _bend(data: _Data, point: _ArmaPoint) -> float:
    """Return the log of the density at frequency 0 over that at the lowest frequency of the data."""
    below, above = (abs(data.polynomial(tail)[0]) / max(abs(1 + tail.sum()), 1e-12) for tail in (point.a, point.b))
    return 2 * math.log(below / above)


def _inside(tail: Vector, most: float) -> tuple[Vector, float]:
    """Return 1 + c₁z⁻¹ + … with roots moved inside the unit circle, and the log factor on its squared modulus there."""
    if _core.roots_inside(tail, most):
        return tail, 0.0
    roots = np.roots(np.concatenate([[1.0], tail]))
    outside = np.abs(roots) > 1
    gain = 2 * float(np.sum(np.log(np.abs(roots[outside]))))
    roots[outside] = 1 / np.conj(roots[outside])
    size = np.abs(roots)
    roots = np.where(size > most, roots * most / np.maximum(size, 1e-300), roots)
    return np.real(np.poly(roots))[1:], gain


def _starts(data: _Data, best: _ArmaPoint, more: tuple[int, int]) -> Iterator[tuple[Vector, Vector]]:
    """Yield starts: the best process, with roots at the largest residuals, and at high and low frequencies."""
    scaled = np.sqrt(data.weights) * best.residuals
    smooth = np.convolve(scaled, np.ones(5) / 5, mode="same")
    for residual in (smooth, scaled):
        worst = int(np.argmax(np.abs(residual)))
        for radii in ((0.97, 0.9), (0.8, 0.6)):
            above, below = radii if residual[worst] > 0 else radii[::-1]
            yield (
                _add_roots(best.a, more[0], data.angles[worst], above),
                _add_roots(best.b, more[1], data.angles[worst], below),
            )
    yield _add_roots(best.a, more[0], math.pi, 0.6), _add_roots(best.b, more[1], math.pi, 0.6)
    if sum(more) <= 2:
        yield _add_roots(best.a, more[0], 0.5, 0.6), _add_roots(best.b, more[1], 0.5, 0.5)


def _add_roots(tail: Vector, count: int, angle: float, radius: float) -> Vector:
    """Return the coefficients of the polynomial with `count` additional roots at a radius and an angle."""
    polynomial = np.concatenate([[1.0], tail])
    for _ in range(count // 2):
        polynomial = np.convolve(polynomial, [1.0, -2 * radius * math.cos(angle), radius**2])
    if count % 2:
        polynomial = np.convolve(polynomial, [1.0, -math.copysign(radius, math.cos(angle))])
    return polynomial[1:]


def _alternatives(
    data: _Data, chosen: _ArmaPoint, tried: Sequence[_ArmaPoint], price: float
) -> tuple[Alternative, ...]:
    """Return the best process of other orders with exp(−d/2) weights ≥ `LEAST_ORDER_WEIGHT` (d: excess criterion)."""
    best = {(point.a.size, point.b.size): point for point in (*_best_of_each_order(tried), chosen)}
    spread = max(chosen.loss / max(data.logs.size - chosen.order - 1, 1), 1.0)
    score = _score(chosen, price, spread)
    weights = {at: math.exp(min(score - _score(point, price, spread), 0.0) / 2) for at, point in best.items()}
    total = sum(weights.values())
    return tuple(
        Alternative(phi=-point.a, theta=point.b.copy(), density=point.density, weight=weights[at] / total)
        for at, point in best.items()
        if point is not chosen and weights[at] >= LEAST_ORDER_WEIGHT * total
    )


def _report(data: _Data, point: _ArmaPoint, alternatives: tuple[Alternative, ...]) -> SpectralShape:
    sign = np.concatenate([-np.ones(point.a.size), np.ones(point.b.size)])
    return SpectralShape(
        phi=-point.a, theta=point.b.copy(), innovation=math.exp(point.scale),
        covariance=_scatter(point, data)[1:-1, 1:-1] * np.outer(sign, sign),
        misfit=point.loss / max(data.logs.size - point.jacobian.shape[1], 1), alternatives=alternatives,
    )  # fmt: skip
