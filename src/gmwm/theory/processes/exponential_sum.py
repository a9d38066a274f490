"""Autocovariances that are a sum of exponentials, white noise, a random walk and a few terms at short lags.

The running sum of such a process has the generalised covariance

    K(m) = −½ w |m| + γ² (|m|³ − |m|)/12 + ρ(|m|) + Re Σ_p a_p k_p(m),
    k_p(m) = −½ |m| coth(λ_p/2) − e^(−λ_p |m|) / (4 sinh²(λ_p/2)),

with ρ = 0 beyond a few lags, and k_p of e^(−λ_p |m|), λ_p real or complex. Covariances of Haar coefficients are its
second differences over both scales: polynomials plus exponentials between kinks, whose products `cpp/src/lag_sums.cpp`
sums in closed form. The Haar variances of φ^|k|, φ = ±e^(−λ), and derivatives (`cpp/src/exponential.cpp`) have relative
errors of 1e-16 for every λ from 1e-300 to white noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base import _core
from gmwm.base.arrays import NEGLIGIBLE_EXPONENT, Matrix, Vector

Kernel = tuple[float, float, Vector, Matrix, NDArray[np.uint8]]  # A process as `_core.lag_sums` takes it
_SERIES = 0.5  # |λ| s below which sinh λs − s sinh λ comes from its series, without cancellation, as in the kernel


@dataclass(frozen=True, eq=False)
class ExponentialSum:
    """Generalised covariance of the running sum of a process; see the module docstring."""

    white: float = 0.0  # density w of the white noise (u²)
    walk: float = 0.0  # innovation variance γ² of the random walk (u²)
    spikes: Vector = field(default_factory=lambda: np.empty(0))  # (L,) ρ(0), ρ(1), …, ρ(L − 1) (u²)
    # (n,) amplitudes a_p (u²). Of a pair of complex decays, one is listed, with twice its amplitude
    amplitudes: NDArray[np.complex128] = field(default_factory=lambda: np.empty(0, dtype=np.complex128))
    # (n,) decays λ_p per sample, with a real part ≥ 0 and an imaginary part between 0 and π
    decays: NDArray[np.complex128] = field(default_factory=lambda: np.empty(0, dtype=np.complex128))
    # (n,) exponentials without the first term of k_p. They must decay faster than e^(−½|m|)
    bare: NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, dtype=np.bool_))

    @classmethod
    def of_table(cls, autocovariance: Vector) -> ExponentialSum:
        """Return the sum for the autocovariance r(0), r(1), …, r(L), which is 0 at longer lags."""
        tails = np.cumsum(np.cumsum(autocovariance[:0:-1]))[::-1]
        return cls(white=float(autocovariance[0] + 2.0 * autocovariance[:0:-1].sum()), spikes=-tails)

    @classmethod
    def of_exponential(cls, amplitude: complex, decay: complex) -> ExponentialSum:
        """Return the sum for the autocovariance `amplitude` e^(−λ|m|) with λ = `decay`."""
        return cls(amplitudes=np.array([complex(amplitude)]), decays=np.array([complex(decay)]), bare=np.zeros(1, bool))

    def scaled(self, factor: float) -> ExponentialSum:
        """Return the sum multiplied by `factor`."""
        return replace(
            self, white=factor * self.white, walk=factor * self.walk, spikes=factor * self.spikes,
            amplitudes=factor * self.amplitudes,
        )  # fmt: skip

    @classmethod
    def joined(cls, terms: Sequence[ExponentialSum]) -> ExponentialSum:
        """Return the sum of several independent processes."""
        spikes = np.zeros(max((term.spikes.size for term in terms), default=0))
        for term in terms:
            spikes[: term.spikes.size] += term.spikes
        return cls(
            white=sum(term.white for term in terms),
            walk=sum(term.walk for term in terms),
            spikes=spikes,
            amplitudes=np.concatenate([cls().amplitudes, *(term.amplitudes for term in terms)]),
            decays=np.concatenate([cls().decays, *(term.decays for term in terms)]),
            bare=np.concatenate([cls().bare, *(term.bare for term in terms)]),
        )

    @property
    def oscillates(self) -> bool:
        """Whether a decay is not real."""
        return bool(np.any(self.decays.imag))

    def strided(self, stride: int) -> ExponentialSum:
        """Return the sum with lags in steps of `stride` samples, for which K(m) becomes K(sm)."""
        s, decay = float(stride), self.decays
        turned = s * decay.imag - 2.0 * np.pi * np.round(s * decay.imag / (2.0 * np.pi))
        moved = s * decay.real + 1j * turned
        half, quick = np.sinh(0.5 * decay), moved.real > NEGLIGIBLE_EXPONENT
        weights, slopes = -self.amplitudes / (4.0 * half**2), -0.5 * (self.amplitudes / np.tanh(0.5 * decay)).real
        amplitudes = -4.0 * weights * np.sinh(0.5 * np.where(quick, 1.0, moved)) ** 2
        amplitudes = np.where(turned < 0, np.conj(amplitudes), amplitudes)
        decays = moved.real + 1j * np.abs(turned)
        bare = np.abs(decays) >= _SERIES
        with np.errstate(divide="ignore"):
            new_slopes = np.where(bare, 0.0, -0.5 * (amplitudes / np.tanh(0.5 * decays)).real)
        white = -2.0 * (s * np.where(self.bare, 0.0, slopes) - new_slopes)
        # Of a slow exponential, the two terms cancel.
        slow = ~self.bare & (s * np.abs(decay) < _SERIES)
        white[slow] = -(self.amplitudes[slow] * _excess_of_sinh(decay[slow], s)).real
        # An exponential that is gone after one step is a spike.
        spikes = self.spikes[::stride].copy()
        if quick.any():
            spikes = spikes if spikes.size else np.zeros(1)
            spikes[0] += weights[quick].real.sum()
        return ExponentialSum(
            white=s * self.white - (s**3 - s) / 6.0 * self.walk + float(white.sum()), walk=s**3 * self.walk,
            spikes=spikes, amplitudes=amplitudes[~quick], decays=decays[~quick], bare=bare[~quick],
        )  # fmt: skip

    @cached_property
    def kernel(self) -> Kernel:
        """The sum as arguments of `_core.lag_sums`."""
        a, decays = self.amplitudes, self.decays
        rows = np.ascontiguousarray([a.real, a.imag, decays.real, np.clip(decays.imag, 0.0, np.pi)])
        return self.white, self.walk, np.ascontiguousarray(self.spikes), rows, self.bare.astype(np.uint8)


def lag_sums(
    levels: NDArray[np.int64],
    samples: int,
    process: ExponentialSum,
    tables: Sequence[tuple[_core.LagTable, float]] = (),
    *,
    diagonal: bool,
) -> tuple[Vector, Vector]:
    """Compute Σ_u n(u) C(u) and Σ_u n(u) (C(u)² + 2 C(u) D(u)) for each pair of levels, or each level if `diagonal`.

    C(u) and D(u) are 2^(j+k) Cov(W_{j,t}, W_{k,t+u}) of the process and of `tables` times factors (`lag_table`), and
    n(u) numbers of pairs. Pairs are sorted by the coarser level, then the finer."""
    return _core.lag_sums(levels, samples, diagonal, process.kernel, list(tables))


def lag_table(levels: NDArray[np.int64], samples: int, process: ExponentialSum, *, diagonal: bool) -> _core.LagTable:
    """Compute D(u) of a process with real decays and no spikes for `lag_sums`; many processes can use it."""
    return _core.LagTable(levels, samples, diagonal, process.kernel)


def _excess_of_sinh(decay: NDArray[np.complex128], s: float) -> NDArray[np.complex128]:
    """Compute (sinh λs − s sinh λ) / (2 sinh²(λ/2)) for |λ| s below `_SERIES`, by a series."""
    terms, factor = np.zeros_like(decay), decay / 6.0
    for r in range(3, 17, 2):
        terms += factor * (s**r - s)
        factor = factor * decay * decay / ((r + 1) * (r + 2))
    return np.asarray(2.0 * (0.5 * decay / np.sinh(0.5 * decay)) ** 2 * terms)


Array = NDArray[np.float64]

WHITE = 700.0  # upper limit for λ: beyond it, e^(−λ) is below the rounding error of 1, and cosh λ would soon overflow


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


def _s(lam: Array) -> Array:
    """Compute 2e^(−λ)(sinh λ − λ)/λ³."""
    return _piecewise(
        lam,
        lambda v: 2.0 * np.exp(-v) * _polynomial(_EXCESS, v * v),
        lambda v: (-np.expm1(-2.0 * v) - 2.0 * v * np.exp(-v)) / v**3,
    )


def block_variance(lam: float, m: Array) -> Array:
    """Compute [e^(−λm) − 1 + m sinh λ]/(2 sinh²(λ/2)), the variance of m summed samples of e^(−λ|k|)."""
    v = np.array([min(lam, WHITE)])
    # Dividing by e^λ and λ² avoids overflow for large λ and cancellation for small λ.
    x = np.asarray(m, dtype=np.float64) * v
    curve = _piecewise(x, lambda x: _polynomial(_CURVE, x), lambda x: np.asarray((np.expm1(-x) + x) / (x * x)))
    return np.asarray((2.0 * np.exp(-v) * m * m * curve + v * m * _s(v)) / np.asarray(-np.expm1(-v) / v) ** 2)


_CURVE = _series(lambda n: (-1) ** n / factorial(n), 2, 20)


def oscillation_shape(damping: Array, turn: Array, h: Array) -> Array:
    """Compute variances (n, J) of e^(−a|k|)[cos ωk + (a/ω) sin ω|k|], damping a and turn ω a sample, half-scales h."""
    out = np.empty((turn.size, h.size))
    _core.oscillation_shapes(np.ascontiguousarray(damping), np.ascontiguousarray(turn), h, out)
    return out
