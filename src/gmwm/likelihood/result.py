"""A model fitted by maximum likelihood."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from gmwm._arrays import Matrix, Vector, freeze
from gmwm._text import Named
from gmwm.errors import ModelError, ReadError
from gmwm.inference.asymptotic import why_no_error
from gmwm.likelihood.record import Record
from gmwm.processes.kalman_methods import KalmanMethods
from gmwm.processes.model import Model
from gmwm.remarks import Remark
from gmwm.variance.api import wavelet_variance as measure
from gmwm.variance.result import WaveletVariance

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as MatplotlibFigure

    from gmwm.inference.intervals import Interval
    from gmwm.likelihood.intervals import Method
    from gmwm.plots.view import UnitSystem, ViewName


@dataclass(frozen=True, kw_only=True)
class LikelihoodDiagnostics:
    """What to know before using the fit.

    Attributes
    ----------
    acts_as : mapping of term to process name
        Terms at an end of their domain, which these data cannot tell from another process.
    not_supported : tuple of str
        Terms estimated as zero: these data do not show them.
    evaluations : int
        Passes of the filter with derivatives that the search took.
    converged : bool
        Whether the search ended where nothing more is to be gained.
    started_at : float
        The log-likelihood where it started.
    remarks : tuple of Remark
        What to know before using the fit.
    """

    acts_as: Mapping[str, str]
    not_supported: tuple[str, ...]
    evaluations: int
    converged: bool
    started_at: float
    remarks: tuple[Remark, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LikelihoodFit(KalmanMethods):
    """A model fitted to a record by maximum likelihood.

    Attributes
    ----------
    model : Model
        With its estimates; repeated terms have the shortest correlation time first.
    parameters : mapping of name to value
        "WN.sigma2", "GM.beta", with repeats "GM[1].beta"; SI and per sample, β in 1/s.
    loglikelihood : float
        At the estimate.
    level, level_error : float or None, in the unit of the record
        The record's mean by least squares, and its standard error; None where it is known, or is that of a walk.
    mean : float or None
        The mean where it was known beforehand.
    samples, missing : int
        Samples that were there, and that were not.
    names : tuple of str
        The p parameters that were estimated inside their domains.
    covariance : (p, p) array
        Their covariance, the inverse of the information; infinite where the data do not determine one.
    rate : float
        Samples per second (Hz).
    unit, axis : str
        Of the record.
    diagnostics : LikelihoodDiagnostics
        How the search went, and what the data do not support.
    record : Record or None
        What was fitted; None of a fit that was read from a file.

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

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", Named(self.parameters, "parameter"))
        freeze(self.covariance)

    @cached_property
    def wavelet_variance(self) -> WaveletVariance:
        """Of the record, to hold the model against.

        Raises
        ------
        ModelError
            If the fit was read from a file, which does not hold the record.
        """
        if self.record is None:
            raise ModelError("the wavelet variance is that of the record, which a fit that was read from a file lacks")
        return measure(self.record.signal())

    @cached_property
    def implied(self) -> Vector:
        """Wavelet variance (J,) of the fitted model at the levels of the record's."""
        wv = self.wavelet_variance
        return freeze(self.model.wavelet_variance(wv.levels, wv.rate, wv.filter))

    @cached_property
    def decomposition(self) -> dict[str, Vector]:
        """That of each term (J,), by label."""
        wv = self.wavelet_variance
        return self.model.decomposition(wv.levels, wv.rate, wv.filter)

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each parameter that was estimated inside its domain."""
        errors = dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))
        return Named(errors, "standard error of", why_no_error(self.model, errors, self.diagnostics.acts_as))

    @property
    def estimated(self) -> int:
        """Number of parameters that were estimated, zeros among them."""
        return len(self.model.names) - len(self.model.fixed_names)

    @property
    def aic(self) -> float:
        """Akaike's criterion 2p − 2 log L."""
        return 2.0 * self.estimated - 2.0 * self.loglikelihood

    @property
    def bic(self) -> float:
        """Schwarz's criterion p log N − 2 log L."""
        return self.estimated * math.log(self.samples) - 2.0 * self.loglikelihood

    def confidence_intervals(self, level: float = 0.95, method: Method = "wald") -> dict[str, Interval]:
        """Compute a confidence interval (low, high) for every estimated parameter, by name.

        - "wald": θ̂ ± z SE on the scale that keeps the ends inside the domain (logarithm, artanh), with SE from the
          information matrix.
        - "profile": where twice the log-likelihood, maximised over all other parameters, has fallen by z². It is valid
          where the log-likelihood is not a parabola, and takes about ten more fits for each parameter.

        Either method gives the profile interval to a scale that is zero, or whose standard error reaches zero, unless
        the shape of its term is free too: from 0 to an upper limit if zero cannot be excluded. A parameter that the
        data do not determine has (0, inf).

        Parameters
        ----------
        level : float
            Confidence level, between 0 and 1.
        method : "wald" or "profile"
            How to compute the interval.

        Returns
        -------
        dict of name to (low, high)
            In the unit of the parameter.

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
        from gmwm.likelihood.intervals import confidence_intervals

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
            Model, number of samples and rate; log-likelihood and criteria; the tests of the residuals; each parameter
            with estimate, interval, relative standard error and unit; and the warnings.

        Raises
        ------
        OptionError
            If an option is unknown or out of range.
        """
        from gmwm.likelihood.summary import summary

        return summary(self, level, method)

    def plot(
        self,
        *,
        view: ViewName = "wavelet",
        units: UnitSystem = "si",
        decomposition: bool = True,
        ax: Axes | None = None,
        path: str | os.PathLike[str] | None = None,
    ) -> MatplotlibFigure:
        """Draw the wavelet variance of the recording, the curve that the model implies, and the curve of each term.

        Parameters
        ----------
        view : "wavelet" or "allan"
            Wavelet variance ν² over the scale τ (s), or Allan deviation √(2ν²) over the averaging time τ/2 (s).
        units : "si" or "datasheet"
            rad/s and m/s², or deg/h and mg.
        decomposition : bool
            Whether to draw the terms.
        ax : matplotlib Axes, optional
            Where to draw; a new figure by default.
        path : path, optional
            File to write the picture to, ending in .png, .pdf or .svg.

        Returns
        -------
        matplotlib.figure.Figure
            A figure that is not registered with pyplot, so it need not be closed. Notebooks display it.

        Raises
        ------
        OptionError
            If an option is unknown, or the data do not support it.
        ModelError
            If the fit was read from a file, which does not hold the recording.
        """
        from gmwm.plots.fit import plot_fit

        return plot_fit(self, view=view, units=units, decomposition=decomposition, ax=ax, path=path)

    def units(self) -> dict[str, str]:
        """Unit of every parameter."""
        return self.model.units(self.unit)

    def to_dict(self) -> dict[str, Any]:
        """The fit as plain numbers, lists and texts, ready for JSON; the record is not among them."""
        d = self.diagnostics
        return {
            "method": "maximum likelihood",
            "model": str(self.model),
            "parameters": dict(self.parameters),
            "units": self.units(),
            "loglikelihood": self.loglikelihood,
            "aic": self.aic,
            "bic": self.bic,
            "level": self.level,
            "level_error": self.level_error,
            "mean": self.mean,
            "samples": self.samples,
            "missing": self.missing,
            "rate": self.rate,
            "unit": self.unit,
            "axis": self.axis,
            "names": list(self.names),
            "covariance": [[v if math.isfinite(v) else None for v in row] for row in self.covariance.tolist()],
            "acts_as": dict(d.acts_as),
            "not_supported": list(d.not_supported),
            "evaluations": d.evaluations,
            "converged": d.converged,
            "started_at": d.started_at,
            "remarks": [remark.to_dict() for remark in d.remarks],
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> LikelihoodFit:
        """The fit whose `to_dict` gave `values`, or its JSON, without its record.

        Raises
        ------
        ReadError
            If they are not those of such a fit.

        Examples
        --------
        >>> from gmwm import WN, fit_ml
        >>> found = fit_ml(WN(), WN(sigma2=4.0).simulate(1000, 100.0, rng=1), rate=100.0)
        >>> LikelihoodFit.from_dict(found.to_dict()).parameters == found.parameters
        True
        """
        try:
            model = Model.parse(values["model"])
            parameters = {name: value for name, value in model.parameters.items() if value is not None}
            if parameters != dict(values["parameters"]):
                raise ModelError(f"the parameters are not those of {model}")
            matrix = np.array(
                [[math.inf if v is None else v for v in row] for row in values["covariance"]], dtype=np.float64
            ).reshape(len(values["names"]), len(values["names"]))
            diagnostics = LikelihoodDiagnostics(
                acts_as=dict(values["acts_as"]),
                not_supported=tuple(values["not_supported"]),
                evaluations=int(values["evaluations"]),
                converged=bool(values["converged"]),
                started_at=float(values["started_at"]),
                remarks=tuple(Remark.from_dict(remark) for remark in values["remarks"]),
            )
            return cls(
                model=model,
                parameters=parameters,
                loglikelihood=float(values["loglikelihood"]),
                level=values["level"],
                level_error=values["level_error"],
                mean=values["mean"],
                samples=int(values["samples"]),
                missing=int(values["missing"]),
                rate=float(values["rate"]),
                unit=str(values["unit"]),
                axis=str(values["axis"]),
                names=tuple(values["names"]),
                covariance=matrix,
                diagnostics=diagnostics,
            )
        except KeyError as error:
            raise ReadError(f"not a fit by likelihood: it has no {error.args[0]!r}") from error
        except (TypeError, ValueError, AttributeError) as error:
            raise ReadError(f"not a fit by likelihood: {error}") from error

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """What to know before using the fit."""
        return self.diagnostics.remarks

    def _repr_html_(self) -> str:
        """The summary as HTML, with the parameters as a table: what notebooks display."""
        from gmwm.likelihood.summary import as_html

        return as_html(self)

    def __repr__(self) -> str:
        return f"LikelihoodFit({self.model.structure}, log-likelihood {self.loglikelihood:.10g})"
