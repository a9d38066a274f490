"""Result of a fit to recordings at known conditions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np

from gmwm.base.documents import plain
from gmwm.base.errors import OptionError
from gmwm.base.results import Plotted
from gmwm.base.text import Summarised, align, gap_text, p_relation, with_minus
from gmwm.fitting.estimation.intervals import UNDETERMINED_HALF_WIDTH
from gmwm.fitting.estimation.varies import parse_varies
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.options import as_confidence
from gmwm.theory.processes.model import Model


@dataclass(frozen=True)
class Estimate:
    """Estimate of a parameter in a fit to recordings at known conditions.

    Attributes
    ----------
    value, error : float
        Estimate and its standard error, which is infinite if the data do not determine the parameter.
    acts_as : str or None
        Name of the process that the data cannot distinguish from the term; None if there is no such process.
    shape : bool
        Whether this is a shape parameter, such as a correlation time, which cannot be zero.
    signed : bool
        Whether this is a coefficient that may be negative; its interval is symmetric.
    """

    value: float
    error: float
    acts_as: str | None = None
    shape: bool = False
    signed: bool = False

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Return the confidence interval, which is symmetric on a logarithmic scale.

        If the data do not exclude a variance of zero, the interval is from 0 to an upper limit.

        Parameters
        ----------
        confidence : float
            Confidence level.

        Returns
        -------
        (low, high) : tuple of float
            Limits of the interval; (0, inf) if the data do not determine the parameter.
        """
        z = NormalDist().inv_cdf((1 + as_confidence(confidence)) / 2)
        if self.signed:
            return self.value - z * self.error, self.value + z * self.error
        if not math.isfinite(self.error) or (self.shape and z * self.error > UNDETERMINED_HALF_WIDTH * self.value):
            return 0.0, math.inf
        if z * self.error >= self.value and not self.shape:
            return 0.0, self.value + z * self.error
        factor = math.exp(z * self.error / self.value)
        return self.value / factor, self.value * factor


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ConditionsFit(Summarised, Plotted):
    """One model fitted to recordings at known conditions.

    Attributes
    ----------
    condition : str
        Name of the condition.
    structure : str
        Text of the model.
    varies : mapping of term to str
        For each term that varies, its variance as a sum of functions of the condition.
    curves : mapping of condition to WaveletVariance
        Measured wavelet variance at each condition.
    models : mapping of condition to Model
        Fitted model at each condition.
    estimates : mapping of name to Estimate
        Parameters that are the same at all conditions, such as "RW.gamma2", and a coefficient for each function, such
        as "WN.sigma2 (1)" and "WN.sigma2 (rate^2)". They are in SI units, per sample and per unit of the function.
    objective : float
        Σ_c (ν̂_c − ν_c)ᵀ Ω_c (ν̂_c − ν_c) over the conditions c, with the measured curve ν̂_c and the fitted curve ν_c.
    lower_bound : float or None
        Lower bound on the objective of every model of this form; None if the fit was made with certify=False.
    weighting : str
        Kind of the weighting matrices Ω_c: "diagonal" or "optimal".
    statistic, df, pvalue : float, int, float
        Statistic, degrees of freedom and p-value of the chi-square goodness-of-fit test of all conditions.
    pvalue_constant : float or None
        p-value of the test that no term varies with the condition. None if `varies` is empty; `pvalue` then has this
        meaning.
    whole : WaveletVariance or None
        If the condition moved during one recording: the curve of the whole recording at scales longer than the times at
        nearly constant condition. `curves` then has the shorter scales.
    shares : tuple of float
        Shares of the conditions in the recording, with which `whole` is the mean of their models.
    range : (lowest, highest)
        Smallest and largest condition in the data.
    """

    condition: str
    structure: str
    varies: Mapping[str, str]
    curves: Mapping[float, WaveletVariance]
    models: Mapping[float, Model]
    estimates: Mapping[str, Estimate]
    objective: float
    lower_bound: float | None
    weighting: str
    statistic: float
    df: int
    pvalue: float
    pvalue_constant: float | None
    whole: WaveletVariance | None = None
    shares: tuple[float, ...] = ()
    range: tuple[float, float]

    def at(self, condition: float) -> Model:
        """Return the model with its values at a condition within the range of the data.

        Parameters
        ----------
        condition : float
            Value of the condition.

        Raises
        ------
        OptionError
            If the condition is outside the range of the data.
        """
        low, high = self.range
        if not low <= condition <= high:
            raise OptionError(
                argument="condition", expected=f"from {low:g} to {high:g}, the range of the recordings", got=condition
            )
        model, (functions, links, _) = next(iter(self.models.values())), parse_varies(self.varies)
        for term, link in links.items():
            a, b = (self.estimates[f"{term}.{link.name} ({name})"].value for name in "ab")
            process = link.at(model.by_term[term], a + b * condition)
            model = model.with_values({f"{term}.{link.name}": process.value(link.name)})
        values = {}
        for term, varied in functions.items():
            name = f"{term}.{model.by_term[term].scale_parameter().name}"
            values[name] = sum(
                self.estimates[f"{name} ({function.text})"].value * float(function.of(np.array([float(condition)]))[0])
                for function in varied.functions
            )
        return model.with_values(values)

    def summary(self) -> str:
        """Format a table of the estimates with 95 % confidence intervals, followed by the certificate and the tests."""
        conditions = with_minus(", ".join(f"{c:.4g}" for c in self.curves))
        rows = [("", "estimate", "95 % interval")]
        for name, estimate in self.estimates.items():
            low, high = estimate.interval()
            interval = "undetermined" if math.isinf(high) else f"{low:.4g} … {high:.4g}"
            rows.append((name, f"{estimate.value:.4g}", f"like {estimate.acts_as}" if estimate.acts_as else interval))
        lines = [f"{self.structure} at {self.condition} {conditions}", *align(rows)]
        if self.lower_bound is not None:
            gap = (self.objective - self.lower_bound) / self.objective if self.objective > 0 else 0.0
            lines.append(f"global optimum: no other parameter values lower the objective by more than {gap_text(gap)}")
        lines.append(
            f"goodness of fit: chi-square {self.statistic:.4g} on {self.df} degrees of freedom, "
            f"p {p_relation(self.pvalue)}"
        )
        if self.whole is not None:
            lines.append(
                f"scales from {self.whole.tau[0]:.3g} s on: the whole recording, because {self.condition} changes too "
                "fast to tell its values apart"
            )
        if self.pvalue_constant is not None:
            lines.append(f"no dependence on {self.condition}: p {p_relation(self.pvalue_constant)}")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain numbers, lists and strings for JSON."""
        return {
            "condition": self.condition, "model": self.structure, "varies": dict(self.varies),
            "estimates": plain(
                {
                    name: {"value": estimate.value, "standard_error": estimate.error, "interval": estimate.interval(),
                           "acts_as": estimate.acts_as}
                    for name, estimate in self.estimates.items()
                }
            ),
            "objective": self.objective, "lower_bound": self.lower_bound, "weighting": self.weighting,
            "goodness_of_fit": {"statistic": self.statistic, "df": self.df, "pvalue": self.pvalue},
            "pvalue_constant": self.pvalue_constant, "whole": None if self.whole is None else self.whole.to_dict(),
            "conditions": [
                {"condition": c, "parameters": self.models[c].parameters, "wavelet_variance": wv.to_dict()}
                for c, wv in self.curves.items()
            ],
        }  # fmt: skip

    def __repr__(self) -> str:
        return f"ConditionsFit({self.structure}, {len(self.curves)} conditions)"
