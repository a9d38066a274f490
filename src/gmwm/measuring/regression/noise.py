"""Estimate the noise of a series from its wavelet variance without choosing a model, for weights and standard errors.

The coarsest levels cannot distinguish a random walk from a Gauss-Markov process of similar length. The noise is
therefore an average of mixtures with different limits for the correlation time, weighted by their likelihoods.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gmwm.base.arrays import Matrix, Vector
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.covariance.mixture import mixture
from gmwm.theory.processes.base import Process

LONGEST = (0.01, 0.03, 0.12, 0.5)
"""Limits for the correlation time in the mixtures, relative to the length of the recording. All include a random walk.
"""


@dataclass(frozen=True, eq=False)
class Mixture:
    """The likeliest mixture of K processes for correlation times up to a limit, with its curves (K, J) and its
    weight."""

    processes: tuple[Process, ...]
    parts: Matrix
    weight: float


@dataclass(frozen=True, eq=False)
class NoiseMixtures:
    """Weighted average of mixtures that describe a wavelet variance with `freedom`; `curve` (J,) is the average."""

    mixtures: tuple[Mixture, ...]
    curve: Vector
    freedom: Vector

    @classmethod
    def of(cls, variance: Vector, freedom: Vector, samples: int) -> NoiseMixtures:
        """Estimate the noise of `samples` values with a wavelet variance (J,) and its degrees of freedom."""
        design = Design(np.arange(1, variance.size + 1), samples=samples, rate=1.0)
        fits = [mixture(variance, freedom, design, within=share * samples) for share in LONGEST]
        # −2 log L, with a Gamma distribution for the wavelet variance of each level.
        loss = np.array([float(np.sum(freedom * (variance / curve + np.log(curve)))) for curve, _ in fits])
        # Penalty that is added to −2 log L of all mixtures except the first one: a parameter decreases it by one to two
        # by chance. Without it, standard errors for a random walk were too small by a quarter
        # (docs/validation/regression.md).
        loss[1:] += 4.0
        weights = np.exp(-(loss - loss.min()) / 2)
        weights /= weights.sum()
        mixtures = tuple(
            Mixture(
                model.processes, np.array([p.wavelet_variance(variance.size, 1.0) for p in model.processes]), float(w)
            )
            for (_, model), w in zip(fits, weights, strict=True)
        )
        return cls(mixtures, sum(w * curve for (curve, _), w in zip(fits, weights, strict=True)), freedom)

    def covariances(self, lags: int) -> list[Matrix]:
        """Return, for each mixture, the generalised covariances of its processes (K, n) at the lags 0 … n − 1."""
        at = np.arange(lags)
        return [np.array([p.generalised_covariance(at, 1.0) for p in parts.processes]) for parts in self.mixtures]

    def psd(self, frequencies: Vector) -> Vector:
        """Return the power spectral density of the average at frequencies in cycles per value."""
        density = np.zeros(frequencies.shape)
        for parts in self.mixtures:
            density += parts.weight * sum(p.psd(frequencies, 1.0) for p in parts.processes)
        return density

    def average(self, of_mixtures: Sequence[Matrix]) -> Matrix:
        """Return the weighted average over the mixtures of sums over their processes, the first axis of each array."""
        return np.asarray(sum(m.weight * part.sum(axis=0) for m, part in zip(self.mixtures, of_mixtures, strict=True)))

    def freedom_of(self, shares: Sequence[Vector]) -> float:
        """Return 2 C²/Var Ĉ of an estimated variance C, by Satterthwaite's approximation, from the contributions of all
        processes of each mixture (`shares`)."""
        totals = np.array([float(np.sum(part)) for part in shares])
        weights = np.array([mixed.weight for mixed in self.mixtures])
        mean = float(weights @ totals)
        variance = float(weights @ (totals - mean) ** 2)
        for mixed, part in zip(self.mixtures, shares, strict=True):
            # The scales are treated as a weighted least-squares fit to independent levels with variance 2 ν⁴/η each.
            rows = mixed.parts * np.sqrt(self.freedom / 2) / np.sum(mixed.parts, axis=0)
            relative = np.linalg.pinv(rows @ rows.T, rcond=1e-10, hermitian=True)
            variance += mixed.weight * float(part @ relative @ part)
        return float(np.clip(2 * mean**2 / variance, 1.0, 1e6)) if variance > 0 else 1e6
