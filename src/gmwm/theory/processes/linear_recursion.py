"""Theory of linear recursions driven by white noise, φ(B) Φ(B^s) X_t = θ(B) Θ(B^s) ε_t, for any orders.

Covariances are sums over the recursion, as polynomials modulo φ(B)Φ(B^s) in double-double arithmetic, for any root and
level. Double-precision coefficients limit a root's distance δ from the unit circle to a relative error of 1e-16/δ."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache, lru_cache, partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base import _core
from gmwm.base.arrays import Matrix, Vector, as_levels, as_rate
from gmwm.base.errors import ModelError
from gmwm.base.remarks import Remark
from gmwm.theory.filters import HAAR, WaveletFilter
from gmwm.theory.processes import rational
from gmwm.theory.processes.exponential_sum import ExponentialSum
from gmwm.theory.processes.haar_covariance import LagGrid
from gmwm.theory.processes.matern import LONGEST_LAGS, NEGLIGIBLE_CORRELATION, ShortMemory, trim
from gmwm.theory.processes.ordered import Ordered, Polynomial
from gmwm.theory.processes.parameter import Parameter, Physical
from gmwm.theory.processes.rational import DIFFERENCE_STEP, WHITE_TIME_S, Density, band_numbers
from gmwm.theory.processes.validation import as_frequencies, as_lags, as_paths, as_rng, shape_of_paths
from gmwm.theory.statespace import StateSpace

PHI = Polynomial("phi", "φ", "p", "autoregressive coefficient")
THETA = Polynomial("theta", "θ", "q", "moving average coefficient")
SEASONAL_PHI = Polynomial("sphi", "Φ", "P", "seasonal autoregressive coefficient")
SEASONAL_THETA = Polynomial("stheta", "Θ", "Q", "seasonal moving average coefficient")

_PLACES = (PHI.name, THETA.name, SEASONAL_PHI.name, SEASONAL_THETA.name)
CANCELLING = 0.05
"""Distance of a root of φ from a root of θ that nearly cancel (tests/processes/test_arma.py)."""
_FARTHEST, _FARTHEST_AVERAGE = 2.5, 2.0
"""Largest coordinates of starting values, which are artanh of partial autocorrelations: tanh 2.5 = 0.987 for φ and Φ,
and tanh 2 = 0.964 for θ and Θ. The estimates are not limited. Pinned by tests/processes/test_arma.py."""
_BRIEF, _SMALL = 0.3, 1e-4  # moduli below which a root is part of a table, and for the power that divides its amplitude


class Lagged(Ordered, abstract=True, listed=False):
    """Theory shared by processes with any of the polynomials φ, θ, Φ and Θ."""

    scale_of = Parameter("sigma2", "σ²", "innovation variance", signal_power=2, scale_power=1)

    @classmethod
    @cache
    def full_orders(cls) -> tuple[int, int, int, int, int]:
        """Return p, q, P, Q and the period s, which is 1 for a class without a period."""
        by_name = dict(zip((p.name for p in cls.polynomials), cls.orders, strict=False))
        p, q, seasonal_p, seasonal_q = (by_name.get(name, 0) for name in _PLACES)
        return p, q, seasonal_p, seasonal_q, cls.orders[-1] if cls.period_name is not None else 1

    @classmethod
    def lags(cls, orders: tuple[int, ...]) -> int:
        """Return the larger of the degrees of φ(B)Φ(B^s) and θ(B)Θ(B^s)."""
        if cls.period_name is None:
            return max(orders)
        p, q, seasonal_p, seasonal_q, period = orders
        return max(p + period * seasonal_p, q + period * seasonal_q)

    def check_values(self) -> None:
        """Raise ModelError if a polynomial whose coefficients all have values is not stationary or not invertible."""
        for polynomial in self.polynomials:
            values = self.coefficients(polynomial.name)
            if not values or None in values:
                continue
            back = np.array(values, dtype=np.float64) * _sign(polynomial)
            if np.all(np.isfinite(rational.coordinates(back[None]))):
                continue
            what = "stationary" if _sign(polynomial) > 0 else "invertible"
            size = float(1.0 / np.abs(rational.roots(back)).max())
            shown = ", ".join(f"{v:g}" for v in values if v is not None)
            raise ModelError(
                f"{self.name} must be {what}: all zeros of its polynomial must lie outside the unit circle, but for "
                f"{polynomial.name} = ({shown}) one has the modulus {size:.7g}",
                argument=polynomial.name,
                got=values,
                advice=_advice(polynomial),
            )

    def remarks(self, term: str, samples: int, rate: float) -> tuple[Remark, ...]:
        """Return remarks on roots of estimated polynomials that nearly cancel or are close to the unit circle."""
        if self.shape_is_fixed:
            return ()
        *_, period = self.full_orders()
        roots_by_sign: dict[tuple[float, int], NDArray[np.complex128]] = {}
        for part, span in self._factors():
            lag = period if part in (SEASONAL_PHI, SEASONAL_THETA) else 1
            roots_by_sign[_sign(part), lag] = rational.roots(_sign(part) * self.nonlinear[span])
        remarks = []
        for lag in (1, period) if period > 1 else (1,):
            autoregressive, averaging = (roots_by_sign.get((sign, lag), np.empty(0)) for sign in (1.0, -1.0))
            near = np.abs(np.subtract.outer(autoregressive, averaging))
            if near.size and near.min() < CANCELLING:
                a, b = np.unravel_index(int(near.argmin()), near.shape)
                roots = {"ar_root": _root_text(autoregressive[a]), "ma_root": _root_text(averaging[b])}
                remarks.append(Remark.of("roots", case="cancel", term=term, **roots))
            if autoregressive.size and np.abs(autoregressive).max() > 1.0 - 10.0 / samples:
                remarks.append(Remark.of("roots", case="ar", term=term, modulus=float(np.abs(autoregressive).max())))
            if averaging.size and np.abs(averaging).max() > 1.0 - 5.0 / math.sqrt(samples):
                remarks.append(Remark.of("roots", case="ma", term=term, modulus=float(np.abs(averaging).max())))
        return tuple(remarks)

    @classmethod
    def shape(cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR) -> Matrix:
        """Compute the wavelet variances (n, J) for innovation variance 1; NaN if not stationary."""
        numbers, rows = as_levels(levels), np.ascontiguousarray(nonlinear, dtype=np.float64)
        out = np.empty((len(rows), int(numbers[-1])))
        _core.arma_shapes(cls.full_orders(), rows, rational.odd_lags(filter), out)
        return out[:, numbers - 1]

    @classmethod
    def shape_jacobian(
        cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR
    ) -> Matrix:
        """Compute the derivatives (n, J, q) of `shape` with respect to the coefficients; NaN if not stationary."""
        numbers, rows = as_levels(levels), np.ascontiguousarray(nonlinear, dtype=np.float64)
        out = np.empty((*rows.shape, int(numbers[-1])))
        _core.arma_slopes(cls.full_orders(), rows, rational.odd_lags(filter), out)
        return np.ascontiguousarray(np.swapaxes(out[:, :, numbers - 1], 1, 2))

    @classmethod
    def lag_covariances(cls, nonlinear: Matrix, lags: NDArray[np.int64], rate: float) -> Matrix:
        """Compute E W_{1,t} W_{1,t+l} (n, L) for innovation variance 1."""
        every = np.arange(lags.max() + 2)
        values = np.empty((len(nonlinear), every.size))
        for row, theta in zip(values, np.ascontiguousarray(nonlinear, dtype=np.float64), strict=True):
            _core.arma_autocovariance(cls.full_orders(), theta, every, True, row)
        return np.asarray((2.0 * values[:, lags] - values[:, lags - 1] - values[:, lags + 1]) / 4.0)

    @classmethod
    @cache
    def _factors(cls) -> list[tuple[Polynomial, slice]]:
        """Return the polynomials and the slices of their coefficients in the nonlinear parameters."""
        ends = np.cumsum([0, *cls.orders[: len(cls.polynomials)]]).tolist()
        spans = [slice(a, b) for a, b in pairwise(ends)]
        return [(part, span) for part, span in zip(cls.polynomials, spans, strict=True) if span.stop > span.start]

    @classmethod
    def room(cls, nonlinear: Matrix) -> Matrix:
        """Return half the minimum modulus of each polynomial on the unit circle (n, q), a step that keeps it stationary
        by Rouché's theorem."""
        result = np.empty(np.shape(nonlinear))
        for part, span in cls._factors():
            result[:, span] = rational.clearance(_sign(part) * np.asarray(nonlinear)[:, span])[:, None]
        return result

    @classmethod
    def coordinates(cls, nonlinear: Matrix) -> Matrix:
        """Return artanh of partial autocorrelations (n, q) of each polynomial, −θ for θ or Θ; NaN if undefined."""
        result = np.empty(np.shape(nonlinear))
        for part, span in cls._factors():
            result[:, span] = rational.coordinates(_sign(part) * np.asarray(nonlinear)[:, span])
        return result

    @classmethod
    def at_coordinates(cls, z: NDArray[Any]) -> NDArray[Any]:
        """Return the coefficients (n, q) whose partial autocorrelations are tanh z, by Levinson's recursion."""
        result = np.empty_like(np.asarray(z))
        for part, span in cls._factors():
            result[:, span] = _sign(part) * rational.at_coordinates(np.asarray(z)[:, span])
        return result

    @classmethod
    def scan(cls, samples: int, rate: float) -> Matrix:
        """Return the ranges (q, 2) of starting values: partial autocorrelations within ±0.987 for φ and Φ and ±0.964
        for θ and Θ, and at the first lag up to 1 − 1/N for φ and 1 − s/N for Φ with N samples."""
        ends = np.empty((sum(cls.orders[: len(cls.polynomials)]), 2))
        for part, span in cls._factors():
            ends[span] = (-_FARTHEST, _FARTHEST) if _sign(part) > 0 else (-_FARTHEST_AVERAGE, _FARTHEST_AVERAGE)
            if _sign(part) > 0:
                period = cls.full_orders()[-1] if part is SEASONAL_PHI else 1
                ends[span.start, 1] = max(_FARTHEST, 0.5 * math.log(2.0 * samples / period))
        return ends

    def autocovariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute r(k) (u²) = Σ φ_i r(k − i), φ_i of φ(B)Φ(B^s), beyond the degree of θ(B)Θ(B^s)."""
        as_rate(rate)
        return self._autocovariance(np.abs(as_lags(lags)), from_zero=False)

    def generalised_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute r(m) − r(0) (u²) if r(1) > r(0)/2, which avoids cancellation for slow processes, and else r(m)."""
        as_rate(rate)
        r0, r1 = self._autocovariance(np.arange(2), from_zero=False)
        return self._autocovariance(np.abs(as_lags(lags)), from_zero=bool(r1 > 0.5 * r0))

    def running_sum_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the generalised covariance of the running sum, K(m) = −½ Var(sum of |m| samples)."""
        as_rate(rate)
        m, where = np.unique(np.abs(as_lags(lags)), return_inverse=True)
        out = np.empty(m.size)
        _core.arma_block_variance(self.full_orders(), self.nonlinear, m, out)
        return np.asarray(-0.5 * self.scale * out[where].reshape(np.shape(lags)))

    def memory(self, rate: float) -> int | None:
        """Return the lag at which the autocovariance without slow real roots is negligible; None if too large."""
        tail = _short_memory(self.full_orders(), tuple(self.nonlinear.tolist()))
        return None if tail is None else tail.lags

    def decays(self, rate: float) -> tuple[float, ...]:
        """Return the decay rate −ln |λ| of each slow real root λ, with a minus sign for a negative root."""
        tail = _short_memory(self.full_orders(), tuple(self.nonlinear.tolist()))
        return () if tail is None else tail.decays

    def coefficient_covariance(self, at: LagGrid, rate: float) -> Vector:
        """Compute covariances (n,) of Haar coefficients (u²): slow real roots in closed form, others by a table."""
        tail = _short_memory(self.full_orders(), tuple(self.nonlinear.tolist()))
        if tail is None:
            raise self.missing("coefficient_covariance")
        return self.scale * tail.coefficient_covariance(at)

    def exponential_sum(self, rate: float) -> ExponentialSum | None:
        """Return exponentials for the roots of φ(B)Φ(B^s) and a table for the others; None if roots nearly coincide."""
        unit = _exponential_sum(self.full_orders(), tuple(self.nonlinear.tolist()))
        return None if unit is None else unit.scaled(self.scale)

    def psd(self, frequencies: ArrayLike, rate: float) -> Vector:
        """Compute the power spectral density σ²Δt |θ(z) Θ(z^s)|²/|φ(z) Φ(z^s)|² (u²/Hz), with z = exp(−2πifΔt)."""
        return self._density(self.nonlinear, as_frequencies(frequencies, rate), as_rate(rate))

    def _density(self, nonlinear: Vector, frequencies: Vector, rate: float) -> Vector:
        """Compute the spectral density (u²/Hz) for coefficients that need not be stationary or invertible."""
        cycles = frequencies / rate
        density = np.full(cycles.shape, self.scale / rate)
        for part, span in self._factors():
            period = self.full_orders()[-1] if part in (SEASONAL_PHI, SEASONAL_THETA) else 1
            gain = rational.squared_size(_sign(part) * nonlinear[span], cycles * period)
            density = density / gain if _sign(part) > 0 else density * gain
        return density

    def state_space(self, rate: float) -> StateSpace:
        """Return the state space of stationary states Z_t, …: φ(B) Φ(B^s) Z_t = ε_t, X_t = θ(B) Θ(B^s) Z_t."""
        as_rate(rate)
        p, _, seasonal_p, _, period = self.full_orders()
        phi, theta, _, _ = self._recursion()
        size = max(phi.size, theta.size + 1)
        transition, noise, seen = np.eye(size, k=-1), np.zeros((size, size)), np.zeros(size)
        transition[0, : phi.size], noise[0, 0], seen[0], seen[1 : theta.size + 1] = phi, self.scale, 1.0, theta
        driven = np.concatenate([self.nonlinear[s] for part, s in self._factors() if _sign(part) > 0] or [np.empty(0)])
        r = np.empty(size)
        _core.arma_autocovariance((p, 0, seasonal_p, 0, period), driven, np.arange(size), False, r)
        start = self.scale * r[np.abs(np.subtract.outer(np.arange(size), np.arange(size)))]
        return StateSpace(F=transition, Q=noise, H=seen, P0=start)

    def simulate(self, n: int, rate: float, rng: np.random.Generator | int, paths: int | None = None) -> Vector:
        """Simulate Gaussian sample paths with a stationary start, an array (n,) or (paths, n)."""
        as_rate(rate)
        n, count = as_paths(n, paths)
        phi, theta, predictors, deviations = self._recursion()
        draws, deviation = as_rng(rng).standard_normal((count, n + theta.size)), math.sqrt(self.scale)
        _core.mix(draws, phi, theta, predictors, deviation * deviations, deviation)
        return np.ascontiguousarray(draws[:, theta.size :]).reshape(shape_of_paths(n, paths))

    def correlation_time(self, rate: float) -> float | None:
        """Return −Δt/ln |λ| (s) for the largest root λ of φ(B)Φ(B^s); 0 for a moving average, None without values."""
        slowest = 0.0
        for part, _ in self._factors():
            if _sign(part) < 0:
                continue
            values = self.coefficients(part.name)
            if None in values:
                return None
            period = self.full_orders()[-1] if part is SEASONAL_PHI else 1
            size = _largest_root(tuple(values))
            slowest = max(slowest, -period / math.log(min(size, 1.0 - 2.0**-53)) if size > 0 else 0.0)
        return slowest / as_rate(rate)

    def physical(self, rate: float) -> tuple[Physical, ...]:
        """Return the density N, the bandwidth and the resonance if the correlation time is below 1 s, else nothing."""
        time = self.correlation_time(rate)
        if time is None or time >= WHITE_TIME_S or self.scale == 0:
            return ()
        free = tuple(p.name for p in self.nonlinear_parameters() if not self.is_fixed(p.name))
        density, *others = _band_numbers(type(self), tuple(self.nonlinear.tolist()), free, as_rate(rate))
        return (replace(density, value=density.value * math.sqrt(self.scale)), *others)

    @property
    def recursion_polynomials(self) -> tuple[Vector, Vector]:
        """Coefficients of φ(B)Φ(B^s) and θ(B)Θ(B^s), from the lag 0 on."""
        phi, theta, _, _ = self._recursion()
        return np.concatenate([[1.0], -phi]), np.concatenate([[1.0], theta])

    def _recursion(self) -> tuple[Vector, Vector, Matrix, Vector]:
        """Return φ(B)Φ(B^s) and θ(B)Θ(B^s), and predictors of lower orders with errors for σ² = 1, for simulations."""
        p, q, seasonal_p, seasonal_q, period = self.full_orders()
        size = p + period * seasonal_p
        phi, theta, predictors = np.empty(size), np.empty(q + period * seasonal_q), np.empty((size, size))
        deviations = np.empty(size)
        _core.arma_recursion(self.full_orders(), self.nonlinear, phi, theta, predictors, deviations)
        return phi, theta, predictors, deviations

    def _autocovariance(self, lags: NDArray[np.int64], *, from_zero: bool) -> Vector:
        distances, where = np.unique(lags, return_inverse=True)
        out = np.empty(distances.size)
        _core.arma_autocovariance(self.full_orders(), self.nonlinear, distances, from_zero, out)
        return np.asarray(self.scale * out[where].reshape(lags.shape))


@lru_cache(maxsize=256)
def _largest_root(values: tuple[float | None, ...]) -> float:
    """Return the largest modulus of a root of the polynomial with these coefficients."""
    return float(np.abs(rational.roots(np.array(values, dtype=np.float64))).max())


@lru_cache(maxsize=256)
def _band_numbers(
    kind: type[Lagged], parameters: tuple[float, ...], free: tuple[str, ...], rate: float
) -> tuple[Physical, ...]:
    """Return density N, bandwidth and resonance for innovation variance 1, with derivatives by `free` ones."""
    at, process = np.array(parameters), kind.standard(parameters)
    slopes = {kind.scale_parameter().name: 0.5}
    moved: dict[str, Density] = {}
    for part, span in kind._factors():
        sign, values = _sign(part), at[span]
        for k, parameter in enumerate(kind.nonlinear_parameters()[span], span.start):
            # ln N = ½ ln σ² + ln(1 + Σθ) − ln(1 − Σφ), and the same for the seasonal polynomials.
            slopes[parameter.name] = parameters[k] / (1 - sign * float(values.sum()))
            if parameter.name in free:
                stepped = np.where(np.arange(at.size) == k, at * (1 + DIFFERENCE_STEP), at)
                moved[parameter.name] = partial(process._density, stepped, rate=rate)
    return band_numbers(partial(process._density, at, rate=rate), rate, slopes, free=moved)


@lru_cache(maxsize=64)
def _short_memory(orders: tuple[int, int, int, int, int], parameters: tuple[float, ...]) -> ShortMemory | None:
    """Return the autocovariance for innovation variance 1 as a table and exponentials; None if it decays too slowly."""
    p, q, seasonal_p, seasonal_q, period = orders
    values = np.array(parameters, dtype=np.float64)
    season = values[p + q : p + q + seasonal_p]
    slow = np.abs(rational.roots(season)) ** (1.0 / period)
    roots = rational.roots(values[:p])
    # A slow real root has a closed form, unless it nearly cancels with another one.
    real = np.abs(roots.imag) < 1e-12
    # Number of lags. If the exponential of a real root lasts longer, its contribution is computed in closed form.
    apart = np.array([real[k] and _lasting(abs(root)) > 64 for k, root in enumerate(roots)], dtype=np.bool_)
    for k in np.flatnonzero(apart):
        others = np.concatenate([np.delete(roots, k), rational.roots(season) if period == 1 else []])
        # Distance of a root with a closed form from others, over its distance from the unit circle.
        apart[k] = not seasonal_p and np.all(np.abs(others - roots[k]) > 0.1 * (1.0 - abs(roots[k])))
    size = np.concatenate([np.abs(roots[~apart]), slow])
    reach = q + period * seasonal_q + p + period * seasonal_p + math.ceil(_lasting(size.max(initial=0.0)))
    if reach > 2 * LONGEST_LAGS:
        return None
    count = int(np.count_nonzero(apart))
    r, exponentials = np.empty(reach + 1), np.empty((4, count))
    _core.arma_without(orders, values, np.array([roots[apart].real, np.zeros(count)]), exponentials, r)
    table = trim(r)
    decays = np.where(exponentials[3] > 0, -exponentials[2], exponentials[2])
    return None if table is None else ShortMemory(table, tuple(exponentials[0].tolist()), tuple(decays.tolist()))


@lru_cache(maxsize=64)
def _exponential_sum(orders: tuple[int, int, int, int, int], parameters: tuple[float, ...]) -> ExponentialSum | None:
    """Return exponentials of lasting roots and a table; None if roots nearly coincide or the table is too long."""
    # Autocovariance, relative to the largest value of a table, that is left out at its end.
    negligible = 1e-14
    p, q, seasonal_p, seasonal_q, period = orders
    values, degree = np.array(parameters, dtype=np.float64), q + period * seasonal_q
    season = rational.roots(values[p + q : p + q + seasonal_p])[:, None] ** (1.0 / period)
    turns = np.exp(2j * np.pi * np.arange(period) / period)
    roots = np.concatenate([rational.roots(values[:p]), (season * turns).ravel()])
    # Imaginary part of a root, relative to its modulus, below which the root is real.
    roots = np.where(np.abs(roots.imag) < 1e-12 * np.abs(roots), roots.real, roots)
    # The amplitude of a root is a multiple of λ^(p − q): it would be huge for a root near 0 and a long moving average.
    modulus, ahead = np.abs(roots), max(degree - roots.size, 0) + 1
    brief = (modulus < _BRIEF) | (modulus**ahead < _SMALL)
    upper, longest = roots[~brief & (roots.imag >= 0)], modulus[brief].max(initial=0.0)
    reach = ahead + roots.size + (math.ceil(math.log(negligible) / math.log(longest)) if longest > 0 else 0)
    if reach > 2 * LONGEST_LAGS:
        return None
    table, rows = np.empty(reach + 1), np.empty((4, upper.size))
    _core.arma_without(orders, values, np.array([upper.real, upper.imag]), rows, table)
    amplitudes, decays = rows[0] + 1j * rows[1], rows[2] + 1j * rows[3]
    variance = abs(float(table[0] + amplitudes.real.sum()))
    # Larger relative amplitudes belong to roots that nearly coincide, and lose more than six digits.
    if not np.all(np.isfinite(rows)) or np.abs(amplitudes).max(initial=0.0) > 1e6 * variance:
        return None
    # White noise far below an alternating variance matters at most scales. 1e-26 is the rounding of double-double.
    felt = np.flatnonzero(np.abs(table) > max(negligible * np.abs(table).max(), 1e-26 * variance))
    remainder = ExponentialSum.of_table(table[: felt[-1] + 1]) if felt.size else ExponentialSum()
    return replace(remainder, amplitudes=amplitudes, decays=decays, bare=np.zeros(upper.size, dtype=np.bool_))


def _lasting(modulus: float) -> float:
    """Return the number of lags after which k |λ|^k is negligible for a root λ. The factor k covers double roots."""
    if modulus == 0.0:
        return 0.0
    decay = -math.log(min(modulus, 1.0 - 2.0**-53))
    return (-math.log(NEGLIGIBLE_CORRELATION) + 3.0 * math.log1p(1.0 / decay)) / decay


def _sign(part: Polynomial) -> float:
    """Return 1 for polynomials 1 − φ₁B − …, and −1 for 1 + θ₁B + …"""
    return -1.0 if part in (THETA, SEASONAL_THETA) else 1.0


def _root_text(root: complex) -> str:
    return f"{root.real:.3g}" if abs(root.imag) < 1e-9 else f"{root.real:.3g} ± {abs(root.imag):.3g}i"


def _advice(part: Polynomial) -> str:
    if _sign(part) > 0:
        return "Use smaller coefficients; for a zero at 1 use a random walk."
    return "Use the coefficients with this zero inverted, which give the same spectrum up to a factor."
