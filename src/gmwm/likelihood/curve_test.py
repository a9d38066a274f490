"""Test of a maximum-likelihood fit by the wavelet variance of the recording."""

from __future__ import annotations

import numpy as np

from gmwm.covariance import Design
from gmwm.covariance.api import variances
from gmwm.errors import DataError, MissingTheoryError
from gmwm.inference.goodness import usable_levels
from gmwm.likelihood.result import LikelihoodFit
from gmwm.remarks import Quantity, Remark

LEVEL = 1e-3
"""Level of the test. It is conservative: the parameters are not fitted to the curve (tests/likelihood/test_misfit.py).
"""


def misfit(fit: LikelihoodFit) -> Remark | None:
    """Return the remark that a model does not describe the wavelet variance of its recording; None if it does.

    Most of the information in the samples is about the fastest process. Errors at long scales therefore hardly affect
    the likelihood, and the residuals are white. If the model is right, η_j ν̂²_j / ν²_j(θ̂) is about chi-square with
    η_j = 2 ν⁴_j / V_jj degrees of freedom at each level. The least p-value of all levels is adjusted by Holm's method.
    """
    from scipy.special import gammainc, gammaincc

    try:
        wv = fit.wavelet_variance
        kept = usable_levels(wv)
        spread = variances(fit.model, Design.of(wv).only(kept))
    except (DataError, MissingTheoryError):
        return None  # the recording is too short for a curve, or a process has no covariance
    implied, measured = fit.implied[kept], wv.variance[kept]
    if not np.any(kept) or not np.all(implied > 0):
        return None
    half = implied**2 / spread
    scores = half * measured / implied
    pvalues = 2 * np.minimum(gammainc(half, scores), gammaincc(half, scores))
    pvalue = float(min(1.0, pvalues.size * np.min(pvalues)))
    if pvalue >= LEVEL:
        return None
    ratios = implied / np.maximum(measured, 1e-9 * implied)
    worst = int(np.argmax(np.where(pvalues.size * pvalues < LEVEL, np.abs(np.log(ratios)), 0.0)))
    ratio = float(ratios[worst])
    return Remark.of(
        "likelihood-misfit", fit.axis, tau=Quantity(float(wv.tau[kept][worst]), "s"), ratio=max(ratio, 1 / ratio),
        side="above" if ratio > 1 else "below", pvalue=pvalue,
    )  # fmt: skip
