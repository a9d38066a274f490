"""The result of a maximum-likelihood fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.arrays import Matrix, Vector, freeze
from gmwm.base.documents import Documented
from gmwm.base.errors import ModelError
from gmwm.base.kinds import Document
from gmwm.base.remarks import Remark
from gmwm.base.results import Plotted
from gmwm.base.text import Named
from gmwm.fitting.estimation.asymptotic import why_no_error
from gmwm.fitting.likelihood.problem import Record
from gmwm.measuring.regression.result import Regression
from gmwm.measuring.variance.api import wavelet_variance as measure
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.model import KalmanMethods, Model

if TYPE_CHECKING:
    from gmwm.fitting.estimation.intervals import Interval
    from gmwm.fitting.likelihood.intervals import Method


@dataclass(frozen=True, kw_only=True)
class LikelihoodDiagnostics:
    """Diagnostics of a maximum-likelihood fit: terms that the data do not determine, course of the search, and remarks.

    Attributes
    ----------
    acts_as : mapping of term to process name
        Terms whose shape parameter is at an end of its domain, so that the data cannot distinguish them from the named
        process.
    not_supported : tuple of str
        Terms that are estimated as zero.
    evaluations : int
        Number of evaluations of the likelihood with derivatives.
    converged : bool
        Whether the search converged to a maximum.
    started_at : float
        Log-likelihood at the starting values.
    remarks : tuple of Remark
        Remarks about terms and the search.
    """

    acts_as: Mapping[str, str]
    not_supported: tuple[str, ...]
    evaluations: int
    converged: bool
    started_at: float
    remarks: tuple[Remark, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LikelihoodFit(Documented, Plotted, KalmanMethods):
    """A model fitted to a recording by maximum likelihood.

    Attributes
    ----------
    model : Model
        The model with its estimates. Repeated terms are sorted by correlation time, the shortest first.
    parameters : mapping of name to value
        Estimates by name, such as "WN.sigma2", "GM.beta", and "GM[1].beta" for repeated terms. They are in SI units;
        `units()` returns the unit of each.
    loglikelihood : float
        Log-likelihood at the estimate.
    level, level_error : float or None, in the unit of the recording
        Mean of the recording and its standard error; None if the mean was known or a random walk includes it.
    mean : float or None
        The mean that was passed as known.
    samples, missing : int
        Number of observed and of missing samples.
    names : tuple of str
        Names of the p parameters that have a standard error: those that are not estimated at a limit of their domain.
    covariance : (p, p) array
        Covariance of these parameters, from the inverse information matrix. The variance is infinite for a parameter
        that the data do not determine.
    rate : float
        Sampling rate (Hz).
    unit, axis : str
        Unit of the recording and name of the axis.
    diagnostics : LikelihoodDiagnostics
        Terms that act as another process or that the data do not support, and how the search ended.
    record : Record or None
        The recording; None if the fit was read from a file.
    regression : Regression or None
        Effect of conditions that was estimated together with the noise; None without `against`.

    Examples
    --------
    >>> from gmwm import GM, WN, fit_ml
    >>> x = (GM(beta=2.0, sigma2=4.0) + WN(sigma2=1.0)).simulate(5_000, 100.0, rng=1)
    >>> found = fit_ml("GM + WN", x, rate=100.0)
    >>> found.names, found.covariance.shape
    (('GM.beta', 'GM.sigma2', 'WN.sigma2'), (3, 3))
    >>> abs(found.parameters["WN.sigma2"] - 1.0) < 3 * found.standard_errors["WN.sigma2"]
    True
    """

    model: Model
    parameters: Mapping[str, float]
    loglikelihood: float
    level: float | None
    level_error: float | None
    mean: float | None
    samples: int
    missing: int
    rate: float
    unit: str
    axis: str
    names: tuple[str, ...]
    covariance: Matrix
    diagnostics: LikelihoodDiagnostics
    record: Record | None = field(default=None, repr=False)
    regression: Regression | None = None
    _method = "maximum likelihood"
    document = Document("maximum-likelihood fit", "Pass the values that `LikelihoodFit.to_dict()` returned.")
    document_keys = (
        "method=_method", "model", "parameters", "units", "loglikelihood", "aic", "bic", "level", "level_error", "mean",
        "samples", "missing", "rate", "unit", "axis", "names", "regression", "covariance~inf", "*diagnostics",
    )  # fmt: skip

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", Named(self.parameters, "parameter"))
        count = len(self.names)
        object.__setattr__(self, "covariance", freeze(self.covariance.reshape(count, count)))

    def require_consistent(self) -> None:
        """Raise ModelError if the parameters do not belong to the model."""
        if {name: value for name, value in self.model.parameters.items() if value is not None} != self.parameters:
            raise ModelError(
                f"the parameters do not match the model {self.model}", argument="parameters", got=self.parameters
            )

    @cached_property
    def wavelet_variance(self) -> WaveletVariance:
        """Wavelet variance of the recording after the effect of conditions is subtracted.

        Raises
        ------
        ModelError
            If the fit was read from a file, which does not hold the recording.
        """
        if self.record is None:
            raise ModelError(
                "the fit was read from a file, which does not hold the recording for its wavelet variance",
                advice="Fit the model to the recording again.",
            )
        if self.regression is None:
            return measure(self.record.signal())
        return self.regression.corrected(measure(self.record.without(self.regression.estimates).signal()))

    @cached_property
    def implied(self) -> Vector:
        """Wavelet variance (J,) of the fitted model at the levels of `wavelet_variance`."""
        wv = self.wavelet_variance
        return freeze(self.model.wavelet_variance(wv.levels, wv.rate, wv.filter))

    @cached_property
    def decomposition(self) -> dict[str, Vector]:
        """Wavelet variance (J,) of each term of the fitted model, by label of the term."""
        wv = self.wavelet_variance
        return self.model.decomposition(wv.levels, wv.rate, wv.filter)

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each parameter in `names`, by name."""
        errors = dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))
        return Named(errors, "standard error of", why_no_error(self.model, errors, self.diagnostics.acts_as))

    @property
    def estimated(self) -> int:
        """Number of free parameters, including parameters estimated as zero."""
        return len(self.model.names) - len(self.model.fixed_names)

    @property
    def aic(self) -> float:
        """Akaike information criterion, 2p − 2 log L."""
        return 2.0 * self.estimated - 2.0 * self.loglikelihood

    @property
    def bic(self) -> float:
        """Bayesian (Schwarz) information criterion, p log N − 2 log L."""
        return self.estimated * math.log(self.samples) - 2.0 * self.loglikelihood

    def confidence_intervals(self, level: float = 0.95, method: Method = "wald") -> dict[str, Interval]:
        """Compute a confidence interval (low, high) for every estimated parameter, by name.

        - "wald": θ̂ ± z SE after a transformation (logarithm or artanh) that keeps the ends inside the domain of the
          parameter. SE is the standard error from the information matrix, and z is the normal quantile.
        - "profile": the interval in which twice the log-likelihood, maximised over all other parameters, is at most z²
          below its maximum. It is also valid if the log-likelihood is not a parabola, and takes about ten more fits for
          each parameter.

        With both methods, a scale parameter that is estimated as zero, or whose Wald interval includes zero, gets the
        profile interval, unless its term also has a free shape. This interval starts at 0 if the data do not exclude
        zero. A positive parameter that the data do not determine has the interval (0, inf).

        Parameters
        ----------
        level : float
            Confidence level, between 0 and 1.
        method : "wald" or "profile"
            How to compute the interval.

        Returns
        -------
        dict of name to (low, high)
            The interval of each parameter, in its unit.

        Raises
        ------
        OptionError
            If an option is unknown or out of range.
        ModelError
            If `method` is "profile" and the fit was read from a file, which does not hold the recording.

        References
        ----------
        Pawitan (2001), In All Likelihood, Oxford, sections 2.6 and 3.4.

        Examples
        --------
        >>> from gmwm import RW, WN, fit_ml
        >>> found = fit_ml(WN() + RW(), (WN(sigma2=4.0) + RW(gamma2=1e-3)).simulate(5_000, 100.0, rng=1), rate=100.0)
        >>> low, high = found.confidence_intervals(method="profile")["RW.gamma2"]
        >>> low < 1e-3 < high
        True
        """
        from gmwm.fitting.likelihood.intervals import confidence_intervals

        return confidence_intervals(self, level, method)

    def summary(self, level: float = 0.95, method: Method = "wald") -> str:
        """Describe the fit in text.

        Parameters
        ----------
        level : float
            Confidence level of the intervals, between 0 and 1.
        method : "wald" or "profile"
            How to compute the intervals.

        Returns
        -------
        str
            The text states the model, the number of samples and the rate, the log-likelihood and the information
            criteria, the tests of the residuals, the estimate, interval, relative standard error and unit of each
            parameter, and the remarks.

        Raises
        ------
        OptionError
            If an option is unknown or out of range.
        """
        from gmwm.fitting.likelihood.intervals import summary

        return summary(self, level, method)

    def units(self) -> dict[str, str]:
        """Return the unit of every parameter, by name."""
        return self.model.units(self.unit)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks about the terms and the search. Read them before you use the fit."""
        return self.diagnostics.remarks

    def _repr_html_(self) -> str:
        """Return the summary as HTML, with the parameters as a table, for notebooks."""
        from gmwm.fitting.likelihood.intervals import as_html

        return as_html(self)

    def __repr__(self) -> str:
        return f"LikelihoodFit({self.model.structure}, log-likelihood {self.loglikelihood:.10g})"
