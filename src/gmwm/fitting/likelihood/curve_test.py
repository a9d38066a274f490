"""Test whether a maximum-likelihood fit describes the wavelet variance of its recording."""

from __future__ import annotations

import numpy as np

from gmwm.base.errors import DataError, MissingTheoryError
from gmwm.base.remarks import Quantity, Remark
from gmwm.fitting.estimation.goodness import usable_levels
from gmwm.fitting.likelihood.result import LikelihoodFit
from gmwm.measuring.covariance import Design
from gmwm.measuring.covariance.api import variances

LEVEL = 1e-3
"""Significance level, small because the fit does not minimise this distance (tests/likelihood/test_misfit.py)."""


def misfit(fit: LikelihoodFit) -> Remark | None:
    """Return a remark if a model does not describe the wavelet variance of its recording. Most information in the
    samples is about the fastest process, so errors at long scales hardly affect the likelihood or the whiteness. η_j
    ν̂²_j / ν²_j is about chi-square with η_j = 2 ν⁴_j / V_jj degrees of freedom; p-values are adjusted by Holm's
    method."""
    from scipy.special import gammainc, gammaincc

    try:
        wv = fit.wavelet_variance
        usable = usable_levels(wv)
        spread = variances(fit.model, Design.of(wv).only(usable))
    except (DataError, MissingTheoryError):
        return None  # the recording is too short for a wavelet variance, or a process has no covariance
    implied, measured = fit.implied[usable], wv.variance[usable]
    if not np.any(usable) or not np.all(implied > 0):
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
        "likelihood-misfit", fit.axis, tau=Quantity(float(wv.tau[usable][worst]), "s"), ratio=max(ratio, 1 / ratio),
        side="above" if ratio > 1 else "below", pvalue=pvalue,
    )  # fmt: skip
