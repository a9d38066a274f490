"""Compare two candidates: the difference of their criteria and its standard error."""

from __future__ import annotations

import numpy as np

from gmwm.base.arrays import Matrix
from gmwm.choosing.selection.equivalence import axes_of
from gmwm.choosing.selection.ranking import Candidate, Comparison, Ranking
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.weighting import Weights


def compare(ranking: Ranking, first: Candidate, second: Candidate) -> Comparison:
    """Return the difference of the criteria of two candidates of a ranking, with its standard error.

    Let Ω = LᵀL be the weighting matrix, and V the covariance of the measured wavelet variance ν̂². For small changes,
    the loss of model i is |P_i L (ν̂² − ν²)|². The matrix P_i projects onto the complement of the directions in which
    the wavelet variance ν² of the model can change with its parameters. The variance of the difference of two losses is
    then 2 tr[(AW)²] + 4 aᵀWa, with A = P₁ − P₂ and W = LVLᵀ. a = r₁ − r₂ is the difference of the weighted residuals.
    """
    error = difference_error(first.fit, second.fit, Weights(ranking.weighting_matrix), ranking.wavelet)
    difference = first.wic.value - second.wic.value
    return Comparison(first=first, second=second, difference=difference, error=error)


def difference_error(first: Fit, second: Fit, weights: Weights, wavelet: Matrix) -> float:
    """Compute the standard error of the difference between the losses of two fits.

    `weights` has Ω (J, J) and `wavelet` is V (J, J) of the ranking; see `compared`.
    """
    root = weights.root
    scatter = root @ wavelet @ root.T
    axes = [axes_of(fit, root) for fit in (first, second)]
    shape = axes[1] @ axes[1].T - axes[0] @ axes[0].T
    residuals = [root @ (fit.wavelet_variance.variance - fit.implied) for fit in (first, second)]
    pull = residuals[0] - residuals[1]
    spread = shape @ scatter
    variance = 2 * float(np.trace(spread @ spread)) + 4 * float(pull @ scatter @ pull)
    return float(np.sqrt(max(variance, 0.0)))
