"""Least squares with one weight for each wavelet level: estimate, exact covariance, and the part of the noise that it
removes.

For y = X β + ε, with W_j the Haar coefficients of level j, D_j = W_j X and w_j = 1/(2^j ν_j²),

    P = Σ_j w_j D_jᵀ D_j,   β̂ = P⁻¹ Σ_j w_j D_jᵀ W_j y = B y,   B = P⁻¹ Uᵀ,   U = Σ_j w_j W_jᵀ D_j,
    Cov β̂ = B Σ Bᵀ,   E ‖W_j (y − X β̂)‖² = M_j ν_j² − 2 tr(D_jᵀ W_j Σ Bᵀ) + tr(D_jᵀ D_j Cov β̂).

The columns of U sum to zero in every run of values, so that Σ may be the generalised covariance of a random walk.
docs/validation/regression.md compares the error with that of generalised least squares with the true covariance matrix.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gmwm._arrays import Matrix, Vector

COLLINEAR = 1e6
"""Condition number of P, scaled to unit diagonal, above which columns are collinear: the standard error of a
coefficient is then 1000 times its standard error without the other columns."""


@dataclass(frozen=True, eq=False)
class Levelwise:
    """A regression on p columns at n equally spaced times; some values may be missing.

    Attributes
    ----------
    columns : (n, p) array
        X; rows without a value are ignored.
    present : (n,) bool array
        Times with a value.
    whole : (n,) bool array
        Times that also count in the wavelet variance of the residuals; at most the times in `present`.
    """

    columns: Matrix
    present: np.ndarray
    whole: np.ndarray

    @cached_property
    def levels(self) -> int:
        """Number J of levels with a coefficient."""
        longest = _longest_run(self.present)
        return max(int(longest).bit_length() - 1, 0)

    @cached_property
    def used(self) -> list[np.ndarray]:
        """For each level, which coefficients have all their values (n − 2^j + 1,)."""
        return [_complete(self.present, 1 << j) for j in range(1, self.levels + 1)]

    @cached_property
    def counted(self) -> list[np.ndarray]:
        """For each level, which coefficients are used for the wavelet variance of the residuals."""
        return [_complete(self.whole, 1 << j) for j in range(1, self.levels + 1)]

    @cached_property
    def counts(self) -> Vector:
        """Number of coefficients of each level (J,)."""
        return np.array([np.count_nonzero(used) for used in self.used], dtype=np.float64)

    @cached_property
    def coefficients(self) -> list[Matrix]:
        """Coefficients D_j of the columns at each level, zero where a value is missing."""
        return [haar(self.columns, j) * used[:, None] for j, used in enumerate(self.used, 1)]

    @cached_property
    def grams(self) -> Matrix:
        """D_jᵀ D_j (J, p, p)."""
        return np.array([d.T @ d for d in self.coefficients])

    def variances(self, values: Vector) -> Vector:
        """Compute the mean squares of the Haar coefficients of values (n,) at each level (J,)."""
        squares = [float(np.sum(haar(values, j)[used] ** 2)) for j, used in enumerate(self.used, 1)]
        return np.asarray(np.array(squares) / self.counts)

    def under(self, weights: Vector) -> Weighted:
        """Return the regression with weights w_j (J,)."""
        return Weighted(self, weights)


@dataclass(frozen=True, eq=False)
class Weighted:
    """A level-wise regression with weights w_j (J,)."""

    design: Levelwise
    weights: Vector

    @cached_property
    def information(self) -> Matrix:
        """Information matrix P (p, p): the sum of the Gram matrices of all levels, weighted with w_j."""
        return np.asarray(np.einsum("j,jab->ab", self.weights, self.design.grams))

    @property
    def condition(self) -> float:
        """Condition number of P, scaled to unit diagonal; infinite if a column is constant."""
        scale = np.sqrt(np.diag(self.information))
        if not np.all(scale > 0):
            return float("inf")
        return float(np.linalg.cond(self.information / np.outer(scale, scale)))

    @cached_property
    def inverse(self) -> Matrix:
        """P⁻¹."""
        scale = 1 / np.sqrt(np.diag(self.information))
        return np.asarray(np.linalg.inv(self.information * np.outer(scale, scale)) * np.outer(scale, scale))

    @cached_property
    def rows(self) -> Matrix:
        """Bᵀ = U P⁻¹ (n, p)."""
        n = len(self.design.columns)
        total = np.zeros_like(self.design.columns)
        for j, (weight, d) in enumerate(zip(self.weights, self.design.coefficients, strict=True), 1):
            total += weight * haar_adjoint(d, n, j)
        return np.asarray(total @ self.inverse)

    def estimate(self, values: Vector) -> Vector:
        """Estimate β̂ (p,) from values (n,); values at missing times must be finite."""
        return np.asarray(self.rows.T @ np.where(self.design.present, values, 0.0))

    def spread(self, lags: Vector) -> Matrix:
        """Compute Σ Bᵀ (n, p) for noise with covariance Σ, whose generalised covariance at the lags 0 … n − 1 is
        `lags`."""
        from scipy import fft

        n = len(self.rows)
        size = fft.next_fast_len(2 * n, real=True)
        circle = np.zeros(size)
        circle[:n], circle[size - n + 1 :] = lags, lags[1:][::-1]
        product = fft.rfft(circle)[:, None] * fft.rfft(self.rows, size, axis=0)
        return np.asarray(fft.irfft(product, size, axis=0)[:n])

    @cached_property
    def lag_products(self) -> Matrix:
        """Σ_t B_at B_b,t+l + B_a,t+l B_bt of the rows of B at the lags l = 0 … n − 1 (n, p, p), at lag 0 only once."""
        from scipy import fft

        n = len(self.rows)
        size = fft.next_fast_len(2 * n, real=True)
        rows = fft.rfft(self.rows, size, axis=0)
        cross = fft.irfft(np.conj(rows)[:, :, None] * rows[:, None, :], size, axis=0)
        found = cross[:n].copy()
        found[1:] += cross[size - n + 1 :][::-1]
        return np.asarray((found + found.transpose(0, 2, 1)) / 2)

    def covariances(self, lags: Matrix) -> Matrix:
        """Compute Cov β̂ (K, p, p) for K processes with the generalised covariances `lags` (K, n)."""
        return np.asarray(np.tensordot(lags, self.lag_products, axes=1))

    def removed(self, spread: Matrix) -> Vector:
        """Compute the part of ν_j² (J,) that the regression removes: ν_j² minus the expected mean square of the
        residuals.

        Counted over the coefficients that enter the wavelet variance, or all if a level has none of these.
        """
        covariance = self.rows.T @ spread
        found = np.zeros(self.design.levels)
        for j, (d, counted) in enumerate(zip(self.design.coefficients, self.design.counted, strict=True), 1):
            wanted = counted if np.any(counted) else self.design.used[j - 1]
            own = d[wanted]
            cross = float(np.sum(own * haar(spread, j)[wanted]))
            found[j - 1] = (2 * cross - float(np.sum((own.T @ own) * covariance))) / len(own)
        return found


def haar(values: Matrix, level: int) -> Matrix:
    """Compute Haar MODWT coefficients W_{j,t} at all t with 2^j values, along the first axis."""
    half = 1 << (level - 1)
    sums = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    return np.asarray((sums[2 * half :] - 2 * sums[half:-half] + sums[: -2 * half]) / (2 * half))


def haar_adjoint(coefficients: Matrix, n: int, level: int) -> Matrix:
    """Compute W_jᵀ d (n, p) of coefficients d (n − 2^j + 1, p)."""
    half = 1 << (level - 1)
    padded = np.zeros((n + 2 * half, *coefficients.shape[1:]))
    padded[2 * half - 1 : 2 * half - 1 + len(coefficients)] = coefficients
    sums = np.concatenate([np.zeros((1, *coefficients.shape[1:])), np.cumsum(padded, axis=0)])
    first, middle, last = sums[:n], sums[half : half + n], sums[2 * half : 2 * half + n]
    return np.asarray((2 * middle - first - last) / (2 * half))


def _complete(present: np.ndarray, width: int) -> np.ndarray:
    """Return which windows of `width` values have all of them."""
    sums = np.concatenate([[0], np.cumsum(present)])
    return np.asarray(sums[width:] - sums[:-width] == width)


def _longest_run(present: np.ndarray) -> int:
    """Return the length of the longest run of values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], present.astype(np.int8), [0]])))
    return int(np.max(edges[1::2] - edges[::2], initial=0))
