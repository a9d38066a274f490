"""Autocovariances that are a sum of exponentials, white noise, a random walk and a few terms at short lags.

The running sum of such a process has the generalised covariance

    K(m) = −½ w |m| + γ² (|m|³ − |m|)/12 + ρ(|m|) + Re Σ_p a_p k_p(m),
    k_p(m) = −½ |m| coth(λ_p/2) − e^(−λ_p |m|) / (4 sinh²(λ_p/2)),

where ρ is 0 beyond a few lags, and k_p belongs to the autocovariance e^(−λ_p |m|), with a real or complex decay λ_p.
Covariances of Haar wavelet coefficients are second differences of K over both scales. Between two kinks they are a
polynomial plus exponentials in the lag. Products of such functions are geometric sums, which `cpp/src/lag_sums.cpp`
computes in closed form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gmwm.base import _core
from gmwm.base.arrays import NEGLIGIBLE_EXPONENT, Matrix, Vector

Kernel = tuple[float, float, Vector, Matrix, NDArray[np.uint8]]
"""A process as `_core.lag_sums` takes it."""
_SERIES = 0.5
"""|λ| s below which sinh λs − s sinh λ is computed from its series, because its terms would cancel. The kernel uses the
same limit."""


def _none() -> Vector:
    return np.empty(0)


@dataclass(frozen=True, eq=False)
class ExponentialSum:
    """Generalised covariance of the running sum of a process; see the module docstring.

    Attributes
    ----------
    white : float
        Density w of the white noise (u²).
    walk : float
        Innovation variance γ² of the random walk (u²).
    spikes : (L,) array
        ρ(0), ρ(1), …, ρ(L − 1) (u²).
    amplitudes : (n,) complex array
        Amplitudes a_p (u²). Of a pair of complex decays, one is listed, with twice its amplitude.
    decays : (n,) complex array
        Decays λ_p per sample, with a real part ≥ 0 and an imaginary part between 0 and π.
    bare : (n,) bool array
        Exponentials without the first term of k_p. They must decay faster than e^(−½|m|).
    """

    white: float = 0.0
    walk: float = 0.0
    spikes: Vector = field(default_factory=_none)
    amplitudes: NDArray[np.complex128] = field(default_factory=lambda: np.empty(0, dtype=np.complex128))
    decays: NDArray[np.complex128] = field(default_factory=lambda: np.empty(0, dtype=np.complex128))
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

    C(u) and D(u) are 2^(j+k) Cov(W_{j,t}, W_{k,t+u}) of the process and of the `tables` times their factors; see
    `lag_table`. n(u) is the number of pairs of coefficients with the lag u. Pairs are sorted by the coarser level, then
    the finer.
    """
    return _core.lag_sums(levels, samples, diagonal, process.kernel, list(tables))


def lag_table(levels: NDArray[np.int64], samples: int, process: ExponentialSum, *, diagonal: bool) -> _core.LagTable:
    """Compute the covariances D(u) of a process with real decays and without spikes, for `lag_sums`.

    Many processes can use it; their levels are the first ones of the table.
    """
    return _core.LagTable(levels, samples, diagonal, process.kernel)


def _excess_of_sinh(decay: NDArray[np.complex128], s: float) -> NDArray[np.complex128]:
    """Compute (sinh λs − s sinh λ) / (2 sinh²(λ/2)) for |λ| s below `_SERIES`, by a series."""
    terms, factor = np.zeros_like(decay), decay / 6.0
    for r in range(3, 17, 2):
        terms += factor * (s**r - s)
        factor = factor * decay * decay / ((r + 1) * (r + 2))
    return np.asarray(2.0 * (0.5 * decay / np.sinh(0.5 * decay)) ** 2 * terms)
