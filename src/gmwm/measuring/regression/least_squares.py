"""Generalised least squares with a weight w_k = 1/S(f_k) for each frequency: the estimate and its exact covariance.

For y = X β + ε, covariance Σ, density S(f), and the orthonormal DCT-II C of a span without its mean (f_k = k/2n): U =
Cᵀ diag(w) C X, P = Xᵀ U, β̂ = P⁻¹ Uᵀ y = B y, Cov β̂ = B Σ Bᵀ, the best linear unbiased one for white noise and walks
(docs/validation/regression.md). With gaps (R selects values), R Cᵀ diag(1/w) C Rᵀ U = X − 1 μᵀ, 1ᵀ U = 0."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.arrays import Matrix, Vector, runs_of
from gmwm.base.lazy import scipy
from gmwm.measuring.covariance.design import Design

if TYPE_CHECKING:
    from gmwm.theory.processes.base import Process

COLLINEAR_CONDITION = 1e6
"""Condition number of P (unit diagonal) of collinear columns: standard errors grow up to 1000 times."""


@dataclass(frozen=True, eq=False)
class RegressionDesign:
    """Columns X (n, p) at n equally spaced times, used where `present`, and for the wavelet variance where `whole`.
    `offsets`: one for each run between gaps; otherwise a new one only from each index in `restarts`."""

    columns: Matrix
    present: np.ndarray
    whole: np.ndarray
    offsets: bool = False
    restarts: tuple[int, ...] = ()

    @cached_property
    def complete_levels(self) -> int:
        """Number of levels with a Haar coefficient without a missing value."""
        return max((last - first for first, last in self.runs), default=1).bit_length() - 1

    @cached_property
    def levels(self) -> int:
        """Number of levels with a Haar coefficient; without offsets, those of coarse levels cross gaps."""
        if self.offsets:
            return self.complete_levels
        crossing = max((last - first for first, last in self.spans), default=1).bit_length() - 1
        while crossing > self.complete_levels and not np.any(self._mask(crossing)):
            crossing -= 1
        return crossing

    def _mask(self, level: int) -> np.ndarray:
        """Return the mask of used coefficients: complete, or at coarse levels with half the values in both halves."""
        half = 1 << (level - 1)
        if level <= self.complete_levels:
            return np.asarray(_sums(self.present, 2 * half) == 2 * half)
        counts = _sums(self.present, half)
        mask = np.asarray((2 * counts[half:] >= half) & (2 * counts[:-half] >= half))
        for restart in self.restarts:
            mask[max(restart - 2 * half + 1, 0) : restart] = False
        return mask

    @cached_property
    def masks(self) -> list[np.ndarray]:
        """For each level j, the mask of the coefficients that are used."""
        return [self._mask(j) for j in range(1, self.levels + 1)]

    @cached_property
    def residual_masks(self) -> list[np.ndarray]:
        """For each level, mask of the coefficients that are used for the wavelet variance of the residuals."""
        return [_sums(self.whole, 1 << j) == 1 << j for j in range(1, self.levels + 1)]

    @cached_property
    def counts(self) -> Vector:
        """Number (J,) of coefficients at each level."""
        return np.array([np.count_nonzero(used) for used in self.masks], dtype=np.float64)

    def haar(self, values: Matrix, level: int) -> Matrix:
        """Compute half the difference of the means of neighbouring halves of 2^j values, without missing values."""
        if level <= self.complete_levels:
            return haar(values, level)
        half, mask = 1 << (level - 1), self.present.reshape(-1, *[1] * (values.ndim - 1))
        means = _sums(values * mask, half) / np.maximum(_sums(1.0 * mask, half), 1.0)
        return np.asarray((means[half:] - means[:-half]) / 2)

    @cached_property
    def coefficients(self) -> list[Matrix]:
        """Haar coefficients D_j of the columns at each level; 0 where they are not used."""
        return [self.haar(self.columns, j) * used[:, None] for j, used in enumerate(self.masks, 1)]

    def variances(self, values: Vector) -> Vector:
        """Compute the mean squares of the Haar coefficients of values (n,) at each level (J,)."""
        squares = [float(np.sum(self.haar(values, j)[used] ** 2)) for j, used in enumerate(self.masks, 1)]
        return np.asarray(np.array(squares) / self.counts)

    @cached_property
    def runs(self) -> list[tuple[int, int]]:
        """Index ranges (first, end) of the runs of at least two values without a gap."""
        return [(first, last) for first, last in runs_of(self.present).tolist() if last - first > 1]

    @cached_property
    def spans(self) -> list[tuple[int, int]]:
        """Index ranges (first, end) with an offset of their own."""
        if self.offsets:
            return self.runs
        parts = np.split(np.flatnonzero(self.present), np.searchsorted(np.flatnonzero(self.present), self.restarts))
        return [(int(part[0]), int(part[-1]) + 1) for part in parts if part.size > 1]

    def weights(self, density: Callable[[Vector], Vector], highest: float = 0.5) -> list[Vector]:
        """Compute the weights 1/S(f) by span; 0 above `highest`, where columns have too large errors."""
        # Frequencies with computed densities; other weights are interpolated.
        points = 4096
        weights: dict[int, Vector] = {}
        for size in {last - first for first, last in self.spans}:
            at = np.arange(1, size) / (2 * size)
            grid = at if size <= points else np.geomspace(at[0], at[-1], points)
            inverse = np.exp(np.interp(np.log(at), np.log(grid), -np.log(density(grid))))
            weights[size] = np.concatenate([[0.0], np.where(at <= highest, inverse, 0.0)])
        return [weights[last - first] for first, last in self.spans]

    def under(self, weights: Sequence[Vector]) -> Weighted:
        """Return the regression with given weights for each run."""
        return Weighted(self, weights)


@dataclass(frozen=True, eq=False)
class Weighted:
    """A regression with weights (n_r,) for the frequencies of each span of n_r values."""

    design: RegressionDesign
    weights: Sequence[Vector]

    @cached_property
    def whitened_columns(self) -> Matrix:
        """U (n, p): the columns after weighting each frequency of the cosine transform of each span."""
        total = np.zeros_like(self.design.columns)
        for (first, last), weights in zip(self.design.spans, self.weights, strict=True):
            columns, present = self.design.columns[first:last], self.design.present[first:last]
            weigh = _filtered if np.all(present) else _filtered_between_gaps
            total[first:last] = weigh(columns, weights, present)
        return total

    @cached_property
    def information(self) -> Matrix:
        """Information matrix P (p, p)."""
        product = self.design.columns.T @ self.whitened_columns
        return np.asarray((product + product.T) / 2)

    @property
    def condition(self) -> float:
        """Condition number of P, scaled to unit diagonal; infinite if a column is constant in each span."""
        scale = np.sqrt(np.maximum(np.diag(self.information), 0.0))
        largest = max(float(weights.max()) for weights in self.weights) * np.sum(self.design.columns**2, axis=0)
        # A column that an offset replaces has the square of the rounding error.
        if not np.all(scale**2 > 1e-24 * largest):
            return float("inf")
        return float(np.linalg.cond(self.information / np.outer(scale, scale)))

    @cached_property
    def inverse(self) -> Matrix:
        """Inverse P⁻¹ (p, p) of the information matrix."""
        scale = 1 / np.sqrt(np.diag(self.information))
        return np.asarray(np.linalg.inv(self.information * np.outer(scale, scale)) * np.outer(scale, scale))

    @cached_property
    def rows(self) -> Matrix:
        """Bᵀ = U P⁻¹ (n, p), with B the matrix that computes the estimate from the values."""
        return np.asarray(self.whitened_columns @ self.inverse)

    def estimate(self, values: Vector) -> Vector:
        """Estimate β̂ (p,) from values (n,); values at missing times must be finite."""
        return np.asarray(self.rows.T @ np.where(self.design.present, values, 0.0))

    def covariance_rows(self, lags: Vector) -> Matrix:
        """Compute Σ Bᵀ (n, p) from `lags`; U sums to zero in every run, so offsets and random walks are allowed."""
        n = len(self.rows)
        size = scipy.fft.next_fast_len(2 * n, real=True)
        circle = np.zeros(size)
        circle[:n], circle[size - n + 1 :] = lags, lags[1:][::-1]
        product = scipy.fft.rfft(circle)[:, None] * scipy.fft.rfft(self.rows, size, axis=0)
        return np.asarray(scipy.fft.irfft(product, size, axis=0)[:n])

    @cached_property
    def lag_products(self) -> Matrix:
        """Sums Σ_t (B_at B_b,t+l + B_a,t+l B_bt) at the lags l = 1 … n − 1 (n, p, p), and Σ_t B_at B_bt at 0."""
        n = len(self.rows)
        size = scipy.fft.next_fast_len(2 * n, real=True)
        rows = scipy.fft.rfft(self.rows, size, axis=0)
        cross = scipy.fft.irfft(np.conj(rows)[:, :, None] * rows[:, None, :], size, axis=0)
        products = cross[:n].copy()
        products[1:] += cross[size - n + 1 :][::-1]
        return np.asarray((products + products.transpose(0, 2, 1)) / 2)

    def covariances(self, lags: Matrix) -> Matrix:
        """Compute Cov β̂ (K, p, p) for K processes with the generalised covariances `lags` (K, n)."""
        return np.asarray(np.tensordot(lags, self.lag_products, axes=1))

    def removed_variance(self, spread: Matrix) -> Vector:
        """Compute the part (J,) of the noise variance ν_j² that the regression removes: with D_j = W_j X, E ‖W_j (y − X
        β̂)‖² = M_j ν_j² − 2 tr(D_jᵀ W_j Σ Bᵀ) + tr(D_jᵀ D_j Cov β̂), over used coefficients (or all)."""
        covariance = self.rows.T @ spread
        shares = np.zeros(self.design.levels)
        for j, (d, counted) in enumerate(zip(self.design.coefficients, self.design.residual_masks, strict=True), 1):
            mask = counted if np.any(counted) else self.design.masks[j - 1]
            haar_columns = d[mask]
            cross = float(np.sum(haar_columns * self.design.haar(spread, j)[mask]))
            shares[j - 1] = (2 * cross - float(np.sum((haar_columns.T @ haar_columns) * covariance))) / len(
                haar_columns
            )
        return shares


def _filtered(columns: Matrix, weights: Vector, present: np.ndarray) -> Matrix:
    """Multiply each frequency of the cosine transform of columns (n, p) by its weight."""
    return np.asarray(
        scipy.fft.idct(weights[:, None] * scipy.fft.dct(columns, axis=0, norm="ortho"), axis=0, norm="ortho")
    )


def _filtered_between_gaps(columns: Matrix, weights: Vector, present: np.ndarray) -> Matrix:
    """Solve for weighted columns, sum zero, by conjugate gradients; any result is unbiased with exact covariance."""
    used = weights[1:] > 0
    # Weight of unused frequencies, relative to the next one used, so that the inverse exists.
    floor = 1e-3 * float(weights[1:][used][-1])
    weights = np.concatenate([[0.0], np.where(used, weights[1:], floor)])
    inverse = np.concatenate([[0.0], 1 / weights[1:]])
    shares = present / np.count_nonzero(present)

    def centred(values: Matrix) -> Matrix:
        return np.asarray((values - shares @ values) * present[:, None])

    solution = np.zeros_like(columns)
    residual = centred(columns)
    largest = np.linalg.norm(residual, axis=0)
    step = centred(_filtered(residual, weights, present))
    power = np.sum(residual * step, axis=0)
    # Largest number of steps; 20 to 40 are enough if a fifth of the values is missing.
    for _ in range(300):
        product = centred(_filtered(step, inverse, present))
        length = power / np.maximum(np.sum(step * product, axis=0), np.finfo(float).tiny)
        solution += length * step
        residual -= length * product
        if np.all(np.linalg.norm(residual, axis=0) <= 1e-9 * largest):
            break
        nearer = centred(_filtered(residual, weights, present))
        before, power = power, np.sum(residual * nearer, axis=0)
        step = nearer + power / np.maximum(before, np.finfo(float).tiny) * step
    return solution


def haar(values: Matrix, level: int) -> Matrix:
    """Compute the Haar MODWT coefficients of a level at all times with 2^j values, along the first axis."""
    half = 1 << (level - 1)
    sums = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    return np.asarray((sums[2 * half :] - 2 * sums[half:-half] + sums[: -2 * half]) / (2 * half))


def _sums(values: Matrix, width: int) -> Matrix:
    """Return the sums of `width` consecutive values along the first axis."""
    sums = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    return np.asarray(sums[width:] - sums[:-width])


LONGEST = (0.01, 0.03, 0.12, 0.5)
"""Limits of correlation times in mixtures, as shares of the recording's length. All include a random walk."""


@dataclass(frozen=True, eq=False)
class Mixture:
    """Likeliest mixture with correlation times up to a limit, its curves (K, J) and its weight."""

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
        from gmwm.measuring.covariance.mixture import mixture

        design = Design(np.arange(1, variance.size + 1), samples=samples, rate=1.0)
        fits = [mixture(variance, freedom, design, within=share * samples) for share in LONGEST]
        # −2 log L, with a Gamma distribution for the wavelet variance of each level.
        loss = np.array([float(np.sum(freedom * (variance / curve + np.log(curve)))) for curve, _ in fits])
        # Penalty of all mixtures but the first, as chance decreases −2 log L by one to two; without it, errors for a
        # walk were a quarter too small (docs/validation/regression.md).
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
        """Return 2 C²/Var Ĉ of a variance C (Satterthwaite), from contributions of the processes of each mixture."""
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
