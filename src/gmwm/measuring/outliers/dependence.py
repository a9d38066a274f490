"""Test whether a robust wavelet variance depends on its efficiency because of too many outliers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.documents import Documented
from gmwm.measuring.outliers.bursts import MATERIAL
from gmwm.measuring.variance.result import WaveletVariance

if TYPE_CHECKING:
    from gmwm.measuring.outliers.ratio_test import Verdict

LOW, HIGH = 0.6, 0.9
"""Efficiencies that are compared: the default, and an efficiency that tolerates fewer and smaller outliers."""


@dataclass(frozen=True, kw_only=True)
class Dependence(Documented):
    """Two robust variances of the same scale `tau` (s) that differ by more than chance explains. `efficiency` and
    `value` are those of the fitted curve, the others those of the curve that it is compared with."""

    tau: float
    efficiency: float
    value: float
    other_efficiency: float
    other_value: float


def other_efficiency(efficiency: float) -> float:
    """Return the efficiency of the robust curve with which a curve of the given efficiency is compared.

    >>> other_efficiency(0.6), other_efficiency(0.95)
    (0.9, 0.6)
    """
    return HIGH if efficiency < 0.5 * (LOW + HIGH) else LOW


def dependence(robust: WaveletVariance, other: WaveletVariance, verdict: Verdict) -> Dependence | None:
    """Return the level at which two robust curves of a recording differ most, if this is more than chance; otherwise
    None. The estimation errors of both curves are expansions in the same Hermite polynomials. The log ratio of the
    curves therefore has at most the variance of the log ratio of the classical curve to the less efficient one, whose
    standard errors are in the `verdict` on `robust`. A difference of 1 % is tolerated."""
    from scipy.special import ndtri

    assert robust.efficiency is not None
    assert other.efficiency is not None
    usable = verdict.tested & (robust.variance > 0) & (other.variance > 0)
    if not np.any(usable):
        return None
    apart = np.abs(np.log(other.variance[usable] / robust.variance[usable]))
    error = verdict.standard_errors[usable]
    if other.efficiency < robust.efficiency:
        # The standard errors of an efficient curve are smaller: 1 / e - 1 is the variance of uncorrelated coefficients.
        error = error * np.sqrt((1 / other.efficiency - 1) / (1 / robust.efficiency - 1))
    limit = MATERIAL - float(ndtri(verdict.size / (2 * apart.size * verdict.comparisons))) * error
    if not np.any(apart > limit):
        return None
    k = int(np.flatnonzero(usable)[np.argmax(apart / limit)])
    return Dependence(
        tau=float(robust.tau[k]), efficiency=robust.efficiency, value=float(robust.variance[k]),
        other_efficiency=other.efficiency, other_value=float(other.variance[k]),
    )  # fmt: skip
