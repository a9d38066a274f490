"""The difference of two criteria and its standard error."""

from __future__ import annotations

import numpy as np

from gmwm.covariance import Design
from gmwm.estimation.weighting import square_root
from gmwm.selection.equivalence import axes_of
from gmwm.selection.ranking import Candidate, Comparison, Ranking


def compared(ranking: Ranking, first: Candidate, second: Candidate) -> Comparison:
    """Compare two candidates of a ranking.

    The loss of a model is the quadratic form |P L (ν̂ − ν)|² of ν̂², where P projects onto the complement of the
    directions in which the curve of the model can change. The difference of two losses, (e + m)ᵀ(P₁ − P₂)(e + m), has
    the variance 2 tr[(AW)²] + 4 aᵀWa with A = P₁ − P₂, W = LVLᵀ, and a = r₁ − r₂, the difference of the residuals. For
    several recordings, it is the variance for the first one divided by their number.
    """
    root = square_root(ranking.weighting_matrix)
    scatter = root @ ranking.wavelet @ root.T
    design = Design.of(first.fit.wavelet_variance)
    axes = [axes_of(candidate.fit, root, design) for candidate in (first, second)]
    shape = axes[1] @ axes[1].T - axes[0] @ axes[0].T
    residuals = [root @ (c.fit.wavelet_variance.variance - c.fit.implied) for c in (first, second)]
    pull = residuals[0] - residuals[1]
    spread = shape @ scatter
    variance = 2 * float(np.trace(spread @ spread)) + 4 * float(pull @ scatter @ pull)
    variance /= len(first.fits)
    difference = first.wic.value - second.wic.value
    return Comparison(first=first, second=second, difference=difference, error=float(np.sqrt(max(variance, 0.0))))
