"""Test whether recordings have the same parameters of a noise model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from gmwm.fitting.estimation.estimator import fit
from gmwm.fitting.estimation.intervals import parameters_by_name
from gmwm.fitting.estimation.recordings import LONGEST, deviations
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.variance.pooling import pooled
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.model import ModelLike


@dataclass(frozen=True, kw_only=True)
class ParameterRatio:
    """A parameter of one recording over the parameter of the other, or over the mean of the others.

    Attributes
    ----------
    recording : str
        The recording in the numerator.
    name : str
        The parameter, such as "WN.sigma2".
    ratio, lower, upper : float
        The ratio, and its confidence limits.
    """

    recording: str
    name: str
    ratio: float
    lower: float
    upper: float


@dataclass(frozen=True, kw_only=True)
class SameParameters:
    """The test whether recordings of one axis have the same parameters.

    Attributes
    ----------
    axis : str
    model : str
        The model with the parameters of all recordings together.
    statistic : float
        Decrease of the weighted residuals if each recording has parameters of its own.
    df : int
    pvalue : float
        p-value, adjusted for the number of axes.
    differs : bool
        Whether the test finds a difference.
    fit_pvalue : float
        p-value of the goodness-of-fit test of the model for all recordings together. If it is small, the test of the
        parameters is not valid.
    ratios : tuple of ParameterRatio
        The parameters that the recordings determine, if any: for two recordings, the first over the second; for more,
        each over the mean of the others.
    """

    axis: str
    model: str
    statistic: float
    df: int
    pvalue: float
    differs: bool
    fit_pvalue: float
    ratios: tuple[ParameterRatio, ...]

    @property
    def largest(self) -> ParameterRatio:
        """Ratio that differs most from 1, in standard errors."""
        return max(self.ratios, key=lambda one: abs(math.log(one.ratio)) / math.log(one.upper / one.lower))


def same_parameters(
    model: ModelLike, curves: Mapping[str, WaveletVariance], axis: str, confidence: float
) -> SameParameters:
    """Test the recordings of one axis, with the p-value of this test alone."""
    together = fit(model, pooled(curves), certify=False)
    apart = deviations(together)
    return SameParameters(
        axis=axis, model=str(together.model), statistic=apart.statistic, df=apart.df, pvalue=apart.pvalue,
        differs=False, fit_pvalue=together.goodness_of_fit().pvalue, ratios=tuple(_ratios(together, confidence)),
    )  # fmt: skip


def _ratios(together: Fit, confidence: float) -> list[ParameterRatio]:
    """Return the ratios of each recording to the others, for the parameters that both determine."""
    apart, parameters = deviations(together), parameters_by_name(together.model)
    z = NormalDist().inv_cdf((1 + confidence) / 2)
    precision = np.where(np.isfinite(apart.values), 1 / apart.variances, 0.0)
    values = np.nan_to_num(apart.values)
    rows = []
    for k, recording in enumerate(apart.recordings[: 1 if len(apart.recordings) == 2 else None]):
        others = np.arange(len(values)) != k
        for place, name in enumerate(apart.names):
            weight, rest = float(precision[k, place]), precision[others, place]
            if not weight or not rest.sum():
                continue
            scale = parameters[name].scale_power is not None
            one = _on_logarithm(float(values[k, place]), weight, scale)
            other = _on_logarithm(float(np.average(values[others, place], weights=rest)), float(rest.sum()), scale)
            if one is None or other is None:
                continue
            width = z * math.hypot(one[1], other[1])
            low, at, high = (math.exp(one[0] - other[0] + s * width) for s in (-1, 0, 1))
            rows.append(ParameterRatio(recording=recording, name=name, ratio=at, lower=low, upper=high))
    return rows


def _on_logarithm(step: float, precision: float, scale: bool) -> tuple[float, float] | None:
    """Return the logarithm of a parameter over its pooled value, and its standard error; None if it is not determined.

    The curve is linear in variances, so one step is exact."""
    size = 1.0 + step if scale else 1.0
    error = 1 / math.sqrt(precision) / size if size > 0 else math.inf
    if error > LONGEST or abs(step) > LONGEST:
        return None
    return (math.log(size) if scale else step), error
