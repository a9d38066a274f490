"""Which models the data can tell from the best: the criterion's own uncertainty.

A model is as good as the best one where its own records would show a criterion as much above the least in one case of
twenty. It is judged by the covariance V that it implies itself, as one that claims more makes the levels that came out
low seem well known. Records are drawn as their wavelet variances: the chi-square law of each level, with the
correlations of V. To each the model is fitted by first-order theory; against it stand every sum with one more term and,
as a bound of all that have several more, the best sum of any number of processes with the penalty of two parameters. So
what it does to the least of many criteria that it is the least is accounted for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gmwm import _core
from gmwm._arrays import Matrix, Vector
from gmwm.covariance import Design
from gmwm.errors import GmwmError
from gmwm.estimation.estimator import as_fit
from gmwm.estimation.problem import pose
from gmwm.estimation.result import Fit
from gmwm.estimation.reweighting import Settled, drawn_covariance
from gmwm.estimation.solver import solve
from gmwm.estimation.weighting import precision, square_root
from gmwm.inference.asymptotic import COLLINEAR, columns_of, relative_jacobian
from gmwm.inference.criterion import optimism
from gmwm.selection.candidate_fits import Explored, relaxed_columns
from gmwm.selection.structure import without_values

SPARE = 1e-8
"""A term of which less than this share (squared) lies off the directions of the others adds nothing to them."""
SURELY = 1000.0
"""A criterion that is so much larger, under the common weights, is larger under any."""
NEVER = 1e-6
"""A loss with a smaller probability than this, and by far, needs no closer look."""
CLOSER = 1
"""So often a candidate that fails is fitted again with the weights of its last fit."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """That a recording comes from a candidate: what its own records say of it and of its rivals.

    Attributes
    ----------
    fit : Fit
        The candidate, fitted under the common Ω.
    matrix, wavelet : (J, J) arrays
        Ω and V of its own: V at the fit, and V⁻¹ or 1 / V_jj.
    """

    explored: Explored
    fit: Fit
    matrix: Matrix
    wavelet: Matrix
    draws: int
    seed: int

    @classmethod
    def of(cls, explored: Explored, fit: Fit, draws: int, seed: int) -> Hypothesis | None:
        """None where the candidate has no noise at some level."""
        wv = fit.wavelet_variance
        try:
            wavelet = drawn_covariance(fit.model, Design.of(wv), wv.variance)
            matrix = precision(wavelet)
        except GmwmError:
            return None
        if fit.weighting != "optimal":
            matrix = np.diag(1 / np.diag(wavelet))
        return cls(explored=explored, fit=fit, matrix=matrix, wavelet=wavelet, draws=draws, seed=seed)

    def absurd(self, rival: Fit) -> bool:
        """Whether the loss exceeds that of the rival by far more than chance can do, without fitting either again."""
        from scipy.special import gammaincc

        losses = []
        for fit in (self.fit, rival):
            left = self.root @ (fit.wavelet_variance.variance - fit.implied)
            axes = self.axes if fit is self.fit else axes_of(fit, self.root, Design.of(fit.wavelet_variance))
            losses.append(float(left @ left - np.sum((axes.T @ left) ** 2)))
        size = self.root.shape[0] - self.axes.shape[1]
        return bool(gammaincc(size / 2, max(losses[0] - losses[1], 0.0) / 6) < NEVER)

    def excess(self, rival: Fit) -> float:
        """The candidate's criterion less that of a rival, both fitted under Ω."""
        criteria = [fit.objective + optimism(fit, self.wavelet) for fit in (self.again, self._fitted(rival))]
        return criteria[0] - criteria[1]

    @cached_property
    def again(self) -> Fit:
        """The candidate, fitted under its own Ω."""
        return self._fitted(self.fit)

    def closer(self) -> Hypothesis | None:
        """The same with Ω and V of that fit."""
        return Hypothesis.of(self.explored, self.again, self.draws, self.seed)

    def _fitted(self, fit: Fit) -> Fit:
        wv = fit.wavelet_variance
        problem = pose(without_values(fit.model), wv, self.matrix)
        return as_fit(Settled(problem, solve(problem, certify=False)), wv, fit.weighting)

    @cached_property
    def root(self) -> Matrix:
        """L with LᵀL = Ω."""
        return square_root(self.matrix)

    @cached_property
    def axes(self) -> Matrix:
        """Directions in which the candidate's curve can follow the data."""
        return axes_of(self.fit, self.root, Design.of(self.fit.wavelet_variance))

    @cached_property
    def errors(self) -> Matrix:
        """Weighted errors (B, J) of the candidate's own records."""
        return drawn_errors(self.fit.implied, self.wavelet, self.draws, self.seed) @ self.root.T

    @cached_property
    def _columns(self) -> tuple[Matrix, int]:
        """Unit vectors (n, J) of all processes, and how many come first that have no search."""
        shapes, linear = relaxed_columns(self.explored)
        columns = shapes @ self.root.T
        return columns / np.linalg.norm(columns, axis=1, keepdims=True), linear

    @cached_property
    def losses(self) -> Vector:
        """Losses (B,) of the candidate on its own records."""
        taken = self.errors @ self.axes
        return np.asarray(np.sum(self.errors**2, axis=1) - np.sum(taken**2, axis=1))

    @cached_property
    def single(self) -> Matrix:
        """By how much (B, k) sums with one more term have the smaller criterion."""
        return self._single[0]

    @property
    def least(self) -> float:
        """The least penalty of two parameters."""
        return self._single[1]

    @cached_property
    def _single(self) -> tuple[Matrix, float]:
        all_columns, linear = self._columns
        columns = all_columns - (all_columns @ self.axes) @ self.axes.T
        square = np.sum(columns**2, axis=1)
        new = square > SPARE
        gain = np.zeros((len(self.errors), len(columns)))
        gain[:, new] = np.maximum(self.errors @ columns[new].T, 0) ** 2 / square[new]
        spread = columns @ self.root @ factor_of(self.wavelet)
        penalty = 2 * np.sum(spread**2, axis=1) / np.maximum(square, SPARE)
        net = np.where(new, gain - penalty, 0.0)
        # One parameter more is enough where the process takes the place of one that it becomes at an end of its domain.
        single = np.column_stack([net[:, :linear], net[:, linear:].max(axis=1, initial=0.0)])
        return single, 2 * float(penalty[new].min(initial=np.inf))

    def several(self) -> Vector:
        """By how much (B,) a sum with two or more further parameters has the smaller criterion, at most."""
        parts = [part @ self.root.T for part in map(np.asarray, self.fit.decomposition.values()) if np.any(part > 0)]
        columns = np.concatenate([self._columns[0], [part / np.linalg.norm(part) for part in parts]])
        centre = self.fit.implied @ self.root.T
        best = [_core.nonnegative_least_squares(centre + error, columns)[1] for error in self.errors]
        return np.asarray(self.losses - np.array(best) - self.least)


def as_good(
    explored: Sequence[Explored], fits: Sequence[Fit], rivals: Sequence[Fit], size: float, draws: int, seed: int
) -> bool:
    """Whether a candidate is as good as its rival, by its fits and those of the rival to each recording."""
    pairs = enumerate(zip(explored, fits, strict=True))
    hypotheses = [Hypothesis.of(e, fit, draws, seed + r) for r, (e, fit) in pairs]
    for closer in range(1 + CLOSER):
        if closer:
            hypotheses = [h and h.closer() for h in hypotheses]
        sound = [h for h in hypotheses if h is not None]
        if len(sound) < len(hypotheses) or any(h.absurd(rival) for h, rival in zip(sound, rivals, strict=True)):
            return False
        if by_chance(sound, rivals, size):
            return True
    return False


def by_chance(hypotheses: Sequence[Hypothesis], rivals: Sequence[Fit], size: float) -> bool:
    """Whether a candidate's own records put its criterion so far above the least in more than a share `size` of cases.

    One hypothesis and one fit of the rival for each recording; criteria add up.
    """
    difference = sum(h.excess(rival) for h, rival in zip(hypotheses, rivals, strict=True))
    if difference <= 0:
        return True
    single = np.max(np.sum([h.single for h in hypotheses], axis=0), axis=1)
    if np.mean(single >= difference) > size:
        return True
    # What the best sum leaves of a loss is not negative: most candidates fail by the loss alone.
    most = np.sum([h.losses - h.least for h in hypotheses], axis=0)
    if np.mean(np.maximum(single, most) >= difference) <= size:
        return False
    several = np.sum([h.several() for h in hypotheses], axis=0)
    return bool(np.mean(np.maximum(single, several) >= difference) > size)


def drawn_errors(curve: Vector, wavelet: Matrix, draws: int, seed: int) -> Matrix:
    """Errors of ν̂² (B, J): each level chi-square about the curve, with the variances and correlations of V."""
    from scipy.special import chdtri, ndtr

    deviation = np.sqrt(np.diag(wavelet))
    normal = np.random.default_rng(seed).standard_normal((draws, curve.size))
    scores = normal @ factor_of(wavelet).T / deviation
    freedom = 2 * (curve / deviation) ** 2
    return np.asarray(curve * (chdtri(freedom, ndtr(-scores)) / freedom - 1))


def factor_of(wavelet: Matrix) -> Matrix:
    """F (J, J) with FFᵀ = V, from V scaled to unit diagonal."""
    deviation = np.sqrt(np.diag(wavelet))
    share, axes = np.linalg.eigh(wavelet / np.outer(deviation, deviation))
    return np.asarray(deviation[:, None] * axes * np.sqrt(np.maximum(share, 0)))


def axes_of(fit: Fit, root: Matrix, design: Design) -> Matrix:
    """Orthonormal directions (J, p) in which the fitted curve can follow the data."""
    columns, _ = columns_of(fit.model, fit.diagnostics.acts_as)
    slopes = root @ relative_jacobian(fit.model, design, columns)
    length = np.linalg.norm(slopes, axis=0)
    if not np.any(length > 0):
        return np.empty((root.shape[0], 0))
    axes, strength, _ = np.linalg.svd(slopes[:, length > 0] / length[length > 0], full_matrices=False)
    return np.asarray(axes[:, strength > COLLINEAR * strength[0]])
