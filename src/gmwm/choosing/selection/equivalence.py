"""Test whether a candidate is equivalent to the best model, given the uncertainty of the criterion.

It is if its criterion exceeds the smallest as much as in the data in over 5 % of recordings simulated from it.

Simulated wavelet variances are chi-square at each level, with the candidate's covariance V: a larger model's would
weigh low levels too much. Its fit is computed by first-order theory. Rivals are all models with one more term, and, to
bound several more, the best sum of any processes with the penalty of two parameters. So the test accounts for the
choice of the smallest of many criteria."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from gmwm.base import _core
from gmwm.base.arrays import Integers, Matrix, Vector, freeze
from gmwm.base.errors import GmwmError
from gmwm.base.lazy import once_per_result, scipy
from gmwm.choosing.selection.candidate_fits import Explored
from gmwm.choosing.selection.ranking import Candidate, Comparison, Ranking
from gmwm.choosing.selection.structure import without_values
from gmwm.fitting.estimation.criterion import optimism
from gmwm.fitting.estimation.linearised import COLLINEAR_SINGULAR_VALUE, slopes_of
from gmwm.fitting.estimation.problem import pose
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.reweighting import WeightedSolution, drawn_covariance
from gmwm.fitting.estimation.solver import solve
from gmwm.fitting.estimation.weighting import Weights, precision
from gmwm.measuring.covariance import Design

REJECTED_DIFFERENCE = 100.0
"""Criterion difference with the common Ω that rejects a candidate without another fit, to save time."""

QUANTILE_DEGREE = 72
"""Degree of polynomials for chi-square quantiles: error ≤ 1e-12 of the mean (tests/selection/test_equivalence.py)."""


@dataclass(frozen=True, eq=False, repr=False)
class Hypothesis:
    """The hypothesis that the data come from a candidate, with `draws` recordings simulated from this candidate. `fit`
    first has the Ω that all candidates share; `weights` is V⁻¹ or diag(1 / V_jj), with V = `wavelet` under the fit."""

    explored: Explored
    fit: Fit
    weights: Weights
    wavelet: Matrix
    draws: int
    seed: int

    @classmethod
    def of(cls, explored: Explored, fit: Fit, draws: int, seed: int) -> Hypothesis | None:
        """Create the hypothesis for a fit, or return None if the fitted model has no noise at some level."""
        wv = fit.wavelet_variance
        try:
            wavelet = drawn_covariance(fit.model, Design.of(wv), wv.variance)
            matrix = precision(wavelet)
        except GmwmError:
            return None
        if fit.weighting != "optimal":
            matrix = np.diag(1 / np.diag(wavelet))
        return cls(explored=explored, fit=fit, weights=Weights(matrix), wavelet=wavelet, draws=draws, seed=seed)

    def absurd(self, rival: Fit) -> bool:
        """Return whether the loss exceeds the loss of a rival by far more than chance explains, without another fit."""
        losses = []
        for fit in (self.fit, rival):
            residual = self.root @ (fit.wavelet_variance.variance - fit.implied)
            axes = self.axes if fit is self.fit else axes_of(fit, self.root)
            losses.append(float(residual @ residual - np.sum((axes.T @ residual) ** 2)))
        size = self.root.shape[0] - self.axes.shape[1]
        # A bound on the loss below this p-value rejects a candidate without another fit, to save time.
        return bool(scipy.special.gammaincc(size / 2, max(losses[0] - losses[1], 0.0) / 6) < 1e-6)

    def excesses(self, rival: Fit) -> Iterator[float]:
        """Yield the criterion of the candidate minus that of a rival, both fitted with the candidate's Ω, but first a
        limit. A fit of the rival only lowers its loss, and changed its optimism by less than 1 in 999 of 1015 fits."""
        criterion = self.again.objective + optimism(self.again, self.wavelet, self.weights)
        residual = self.root @ (rival.wavelet_variance.variance - rival.implied)
        yield criterion - float(residual @ residual) - optimism(rival, self.wavelet, self.weights) - 1.0
        other = self._fit(rival)
        yield criterion - other.objective - optimism(other, self.wavelet, self.weights)

    @cached_property
    def again(self) -> Fit:
        """Fit of the candidate with its own Ω."""
        return self._fit(self.fit)

    def _fit(self, fit: Fit) -> Fit:
        wv = fit.wavelet_variance
        problem = pose(without_values(fit.model), wv, self.weights)
        return Fit.of(WeightedSolution(problem, solve(problem, certify=False)), wv, fit.weighting)

    @property
    def root(self) -> Matrix:
        """Square root L of the weighting matrix, LᵀL = Ω."""
        return self.weights.root

    @cached_property
    def axes(self) -> Matrix:
        """Orthonormal directions (J, p) in which the weighted wavelet variance of the candidate can change."""
        return axes_of(self.fit, self.root)

    @cached_property
    def errors(self) -> Matrix:
        """Weighted deviations (B, J) of the wavelet variance from its true value in B simulated recordings."""
        return product(drawn_errors(self.fit.implied, self.wavelet, self.draws, self.seed), self.root.T)

    @cached_property
    def _columns(self) -> Matrix:
        """Unit vectors (n, J) of weighted curves of processes to add."""
        columns = self.explored.columns @ self.root.T
        return np.asarray(columns / np.linalg.norm(columns, axis=1, keepdims=True))

    @cached_property
    def losses(self) -> Vector:
        """Losses (B,) of the candidate in the simulated recordings."""
        taken = self.errors @ self.axes
        return np.asarray(np.sum(self.errors**2, axis=1) - np.sum(taken**2, axis=1))

    @property
    def least(self) -> float:
        """Smallest penalty for two additional parameters."""
        return 2 * float(self._penalties.min(initial=np.inf))

    @cached_property
    def _new(self) -> Matrix:
        """Parts (n, J) of unit vectors of terms to add outside the candidate's directions, without collinear terms."""
        # A term is collinear if less of its unit vector's square is outside the candidate's span: √ε of a double.
        spare = 1e-8
        columns = self._columns - (self._columns @ self.axes) @ self.axes.T
        return np.asarray(columns[np.sum(columns**2, axis=1) > spare])

    @cached_property
    def _penalties(self) -> Vector:
        """Penalty (n,) of the criterion for each term that can be added."""
        spread = self._new @ (self.root @ self.wavelet @ self.root.T)
        return np.asarray(2 * np.sum(spread * self._new, axis=1) / np.sum(self._new**2, axis=1))

    def single(self, records: Integers) -> Vector:
        """Return the largest decrease (n,) of the criterion by one more term in these simulated recordings."""
        net = product(self.errors[records], self._new.T)
        np.maximum(net, 0, out=net)
        net *= net
        net /= np.sum(self._new**2, axis=1)
        net -= self._penalties
        return np.asarray(net.max(axis=1, initial=0.0))

    def often_exceeds(self, difference: float, records: Integers, more: float) -> bool:
        """Return whether a bound on the criterion's fall by two parameters is ≥ `difference` in over `more` draws."""
        parts = [part @ self.root.T for part in map(np.asarray, self.fit.decomposition.values()) if np.any(part > 0)]
        columns = np.concatenate([self._columns, [part / np.linalg.norm(part) for part in parts]])
        data = self.fit.implied @ self.root.T + self.errors[records]
        return _core.often_near(data, self.losses[records] - self.least - difference, columns, more)


def as_good(explored: Explored, fit: Fit, rival: Fit, size: float, draws: int, seed: int) -> bool:
    """Return whether a candidate is equivalent to a rival with a smaller criterion, by a test of level `size`."""
    # A rejected candidate is tested again with weights of its last fit; see docs/validation/selection.md.
    for _ in range(2):
        hypothesis = Hypothesis.of(explored, fit, draws, seed)
        if hypothesis is None or hypothesis.absurd(rival):
            return False
        if by_chance(hypothesis, rival, size):
            return True
        fit = hypothesis.again
    return False


def by_chance(hypothesis: Hypothesis, rival: Fit, size: float) -> bool:
    """Return whether over `size` of the simulated recordings differ as much from the smallest criterion."""
    # The limit decides most tests, without a fit of the rival.
    return all(_occurs(hypothesis, difference, size) for difference in hypothesis.excesses(rival))


def _occurs(hypothesis: Hypothesis, difference: float, size: float) -> bool:
    """Return whether the criterion exceeds the smallest by at least `difference` in over `size` of the recordings."""
    # The loss of the best sum is at least zero. The loss of the candidate is therefore a bound for the decrease, and
    # this bound rejects most candidates. One term has half the penalty of two.
    largest = hypothesis.losses - 0.5 * hypothesis.least
    if np.mean(largest >= difference) <= size:
        return False
    if difference <= 0:
        return True
    single, most = np.zeros(largest.size), hypothesis.losses - hypothesis.least
    near = np.flatnonzero(largest >= difference)
    single[near] = hypothesis.single(near)
    if np.mean(single >= difference) > size:
        return True
    if np.mean(np.maximum(single, most) >= difference) <= size:
        return False
    open_ones = np.flatnonzero((single < difference) & (most >= difference))
    # The recordings with the largest bounds are first, so that most answers need few of them.
    records = open_ones[np.argsort(-most[open_ones])]
    return hypothesis.often_exceeds(difference, records, size * single.size - np.count_nonzero(single >= difference))


def drawn_errors(curve: Vector, wavelet: Matrix, draws: int, seed: int) -> Matrix:
    """Draw deviations of ν̂² (B, J) from a curve, chi-square distributed with the covariance V (J, J) `wavelet`."""
    deviation = np.sqrt(np.diag(wavelet))
    scores = product(_normal(draws, curve.size, seed), factor_of(wavelet).T) / deviation
    return np.asarray(curve * (_mean_squares(scores, 2 * (curve / deviation) ** 2) - 1))


def product(rows: Matrix, columns: Matrix) -> Matrix:
    """Return the product of rows (B, J) and columns (J, n), in parts for which BLAS starts no threads, which only
    wait for each other on a busy machine."""
    out = np.empty((len(rows), columns.shape[1]))
    # Number of multiplications from which OpenBLAS starts threads.
    count = max((1 << 18) // columns.size, 1)
    for first in range(0, len(rows), count):
        np.matmul(rows[first : first + count], columns, out=out[first : first + count])
    return out


@lru_cache(maxsize=2)
def _normal(draws: int, size: int, seed: int) -> Matrix:
    """Draw standard normal numbers (draws, size), which all candidates of a ranking share."""
    return freeze(np.random.default_rng(seed).standard_normal((draws, size)))


def _mean_squares(scores: Matrix, freedom: Vector) -> Matrix:
    """Return χ²_η/η quantiles (B, J) of normal scores, by Chebyshev polynomials of degree `QUANTILE_DEGREE`."""
    reach = float(np.abs(scores).max(initial=0.0))
    if len(scores) <= QUANTILE_DEGREE or reach == 0:
        return np.asarray(scipy.special.chdtri(freedom, scipy.special.ndtr(-scores)) / freedom)
    out = np.ascontiguousarray(scores.T) / reach
    # The more degrees of freedom, the more linear are the quantiles.
    for part, low, high in ((1, 0.0, 20.0), (4, 20.0, 200.0), (8, 200.0, np.inf)):
        levels = (freedom >= low) & (freedom < high)
        number, eta = np.arange(QUANTILE_DEGREE // part + 1), freedom[levels, None]
        angle = (number + 0.5) * np.pi / number.size
        values = scipy.special.chdtri(eta, scipy.special.ndtr(-reach * np.cos(angle))) / eta
        terms = 2 / number.size * values @ np.cos(np.outer(angle, number))
        terms[:, 0] /= 2
        quantiles = out[levels]
        _core.chebyshev(terms, quantiles)
        out[levels] = quantiles
    return np.ascontiguousarray(out.T)


def factor_of(wavelet: Matrix) -> Matrix:
    """Return F (J, J) with FFᵀ = V. V is first scaled to unit diagonal."""
    deviation = np.sqrt(np.diag(wavelet))
    share, axes = np.linalg.eigh(wavelet / np.outer(deviation, deviation))
    return np.asarray(deviation[:, None] * axes * np.sqrt(np.maximum(share, 0)))


def axes_of(fit: Fit, root: Matrix) -> Matrix:
    """Return orthonormal directions (J, p) in which the parameters of a fit can change the weighted curve."""
    slopes = root @ slopes_of(fit)
    length = np.linalg.norm(slopes, axis=0)
    if not np.any(length > 0):
        return np.empty((root.shape[0], 0))
    axes, strength, _ = np.linalg.svd(slopes[:, length > 0] / length[length > 0], full_matrices=False)
    return np.asarray(axes[:, strength > COLLINEAR_SINGULAR_VALUE * strength[0]])


def compare(ranking: Ranking, first: Candidate, second: Candidate) -> Comparison:
    """Compute the difference between the criteria of two candidates of a ranking, and its standard error."""
    error = difference_error(first.fit, second.fit, Weights(ranking.weighting_matrix), ranking.wavelet)
    difference = first.wic.value - second.wic.value
    return Comparison(first=first, second=second, difference=difference, error=error)


def difference_error(first: Fit, second: Fit, weights: Weights, wavelet: Matrix) -> float:
    """Compute the standard error of the difference of two fits' losses, with Ω and V of the ranking; see `compare`."""
    root = weights.root
    scatter = root @ wavelet @ root.T
    # A ranking compares all candidates with the best one.
    best = once_per_result(second, "axes", weights.matrix.tobytes(), lambda: axes_of(second, root))
    axes = axes_of(first, root), best
    shape = axes[1] @ axes[1].T - axes[0] @ axes[0].T
    residuals = [root @ (fit.wavelet_variance.variance - fit.implied) for fit in (first, second)]
    pull = residuals[0] - residuals[1]
    spread = shape @ scatter
    variance = 2 * float(np.trace(spread @ spread)) + 4 * float(pull @ scatter @ pull)
    return float(np.sqrt(max(variance, 0.0)))
