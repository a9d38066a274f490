"""Compare two candidates: the difference of their criteria and its standard error."""

from __future__ import annotations

import numpy as np

from gmwm.base.arrays import Matrix
from gmwm.choosing.selection.equivalence import axes_of
from gmwm.choosing.selection.ranking import Candidate, Comparison, Ranking
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.weighting import Weights


def compare(ranking: Ranking, first: Candidate, second: Candidate) -> Comparison:
    """Compute the difference between the criteria of two candidates of a ranking, and its standard error."""
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
