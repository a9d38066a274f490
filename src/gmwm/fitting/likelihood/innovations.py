"""Residuals (standardised Kalman innovations, white normal with variance 1 if the model is right), and comparison of
models by prediction errors of new samples."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base import _core
from gmwm.base.arrays import FrozenArrays, Vector, as_number, as_whole_number
from gmwm.base.errors import FitWarning, OptionError
from gmwm.base.results import Plotted
from gmwm.base.statistics import autocorrelation, observed_pairs
from gmwm.base.text import Summarised, align, p_relation
from gmwm.fitting.likelihood.estimator import fit_ml
from gmwm.fitting.likelihood.problem import LikelihoodProblem, as_record, standardise
from gmwm.fitting.likelihood.result import LikelihoodFit
from gmwm.fitting.likelihood.system import assemble
from gmwm.fitting.likelihood.tracks import Modelled, pose_filter
from gmwm.recording.options import as_confidence
from gmwm.recording.signals import Signal
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model, as_model


@dataclass(frozen=True, kw_only=True)
class Check:
    """Result of a test of whiteness or normality of the residuals.

    Attributes
    ----------
    statistic : float
        The test statistic.
    degrees_of_freedom : float
        Degrees of freedom of the chi-square distribution of the statistic if the model is right.
    p_value : float
        Probability of a statistic at least this large if the model is right.
    lags : int
        Number of lags that the test uses; 0 for the test of normality.
    """

    statistic: float
    degrees_of_freedom: float
    p_value: float
    lags: int = 0


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Residuals(FrozenArrays, Summarised, Plotted):
    """Standardised innovations z_t = v_t/√S_t of a recording, with tests of whiteness and normality.

    v_t is the error of the one-step prediction of a Kalman filter, and S_t is its variance.

    Attributes
    ----------
    model : Model
        The model with its values.
    values : (N,) array
        Residuals (dimensionless); NaN where a sample is missing.
    rate : float
        Sampling rate (Hz).
    times : (N,) array
        Times of the samples (s).
    axis : str
        Name of the axis.
    estimated : int
        Number of parameters that were estimated from this recording.
    spent : (L,) array or None
        Degrees of freedom that the estimation of these parameters takes from the autocorrelation at each lag 1 … L. If
        None, each parameter takes one in total.
    """

    model: Model
    values: Vector
    rate: float
    times: Vector
    axis: str = ""
    estimated: int = 0
    spent: Vector | None = None

    @cached_property
    def observed(self) -> Vector:
        """Residuals of the observed samples, in order."""
        return np.asarray(self.values[np.isfinite(self.values)])

    @property
    def usual_lags(self) -> int:
        """Default number of lags: 10 log₁₀ N, but at least the number of estimated parameters plus 5."""
        return min(max(int(10 * math.log10(self.observed.size)), self.estimated + 5), self.observed.size - 1)

    def acf(self, lags: int | None = None) -> Vector:
        """Return the autocorrelation (L + 1,) of the residuals at lags 0 … L. Pairs with a missing sample are left
        out."""
        return autocorrelation(self.values, self._as_lags(lags))

    def acf_error(self, lags: int | None = None) -> Vector:
        """Return the standard deviation (L,) that the autocorrelation of white noise has at lags 1 … L.

        At each lag it is √m/N, where m is the number of pairs of observed samples at this lag."""
        return np.sqrt(observed_pairs(self.values, self._as_lags(lags))) / self.observed.size

    def ljung_box(self, lags: int | None = None) -> Check:
        """Test the residuals for autocorrelation at the first lags with the Ljung-Box statistic Q = n(n + 2) Σ r_k²/(n
        − k).

        n is the number of residuals, and r_k is their autocorrelation at lag k. If samples are missing, the number of
        observed pairs at lag k replaces n − k, and a lag without pairs does not count.

        If the model is right, Q has approximately a χ² distribution. Its degrees of freedom are the number of lags
        minus the degrees of freedom that the estimation of the parameters takes (`spent`). A parameter that determines
        the autocorrelation at these lags takes one, a parameter of a slow process takes less than one, and a common
        scale of all terms takes none.

        Parameters
        ----------
        lags : int, optional
            Number of lags; `usual_lags` by default.

        Raises
        ------
        OptionError
            If `lags` is not a whole number in its range, or is not larger than the number of estimated parameters.

        References
        ----------
        Ljung and Box (1978), Biometrika 65, 297-303; Box and Pierce (1970), JASA 65, 1509-1526, section 3.
        """
        from scipy.stats import chi2

        count = self._as_lags(lags)
        pairs = observed_pairs(self.values, count)
        seen = pairs > 0
        degrees = np.count_nonzero(seen) - (self.estimated if self.spent is None else float(np.sum(self.spent[:count])))
        if count - self.estimated < 1:
            raise OptionError(
                argument="lags", expected=f"more than the {self.estimated} estimated parameters", got=count
            )
        r, n = self.acf(count)[1:], self.observed.size
        statistic = float(n * (n + 2.0) * np.sum(np.square(r[seen]) / pairs[seen]))
        return Check(
            statistic=statistic, degrees_of_freedom=degrees, p_value=float(chi2.sf(statistic, degrees)), lags=count
        )

    def normality(self) -> Check:
        """Test the residuals for normality (Jarque-Bera).

        The statistic n (skewness²/6 + excess kurtosis²/24) has a χ² distribution with 2 degrees of freedom.

        References
        ----------
        Jarque and Bera (1987), International Statistical Review 55, 163-172.
        """
        from scipy.stats import chi2

        z = self.observed - np.mean(self.observed)
        spread = np.mean(np.square(z))
        skew, excess = np.mean(z**3) / spread**1.5, np.mean(z**4) / spread**2 - 3.0
        statistic = float(z.size * (skew**2 / 6.0 + excess**2 / 24.0))
        return Check(statistic=statistic, degrees_of_freedom=2, p_value=float(chi2.sf(statistic, 2)))

    def quantiles(self, points: int = 400) -> tuple[Vector, Vector]:
        """Return normal quantiles and quantiles of the residuals, (points,) each, for a normal probability plot."""
        from scipy.special import ndtr, ndtri

        ordered = np.sort(self.observed)
        n = ordered.size
        count = min(points, n)
        # Equal steps of the normal quantile, instead of the probability, give enough points in the tails.
        reach = float(ndtri((n - 0.5) / n))
        place = np.clip(np.round(ndtr(np.linspace(-reach, reach, count)) * n - 0.5).astype(np.int64), 0, n - 1)
        place = np.unique(place)
        return np.asarray(ndtri((place + 0.5) / n)), ordered[place]

    def summary(self, lags: int | None = None) -> str:
        """Describe the residuals and the two tests in text. `lags` is the number of lags for `ljung_box`."""
        white, normal, z = self.ljung_box(lags), self.normality(), self.observed
        spread = float(np.std(z))
        return "\n".join(
            [
                f"{z.size} standardised innovations of {self.model.structure}: mean {np.mean(z):+.4f}, "
                f"standard deviation {spread:.4f} (0 and 1 if the model is right)",
                f"Ljung-Box, {white.lags} lags: {white.statistic:.1f} on {white.degrees_of_freedom:.4g} degrees of "
                f"freedom, p {p_relation(white.p_value)}",
                f"Jarque-Bera: {normal.statistic:.1f} on 2 degrees of freedom, p {p_relation(normal.p_value)}",
            ]
        )

    def to_dict(self, lags: int | None = None) -> dict[str, Any]:
        """Return the results of the tests as numbers for JSON. `lags` is the number of lags for `ljung_box`."""
        white, normal = self.ljung_box(lags), self.normality()
        return {
            "samples": int(self.observed.size),
            "mean": float(np.mean(self.observed)),
            "standard_deviation": float(np.std(self.observed)),
            "ljung_box": {"lags": white.lags, "statistic": white.statistic, "p_value": white.p_value},
            "jarque_bera": {"statistic": normal.statistic, "p_value": normal.p_value},
        }

    def __repr__(self) -> str:
        return f"Residuals({self.model.structure}, {self.observed.size} samples)"

    def _as_lags(self, lags: int | None) -> int:
        if lags is None:
            return self.usual_lags
        return as_whole_number(lags, "lags", 1, self.observed.size - 1)


def residuals(
    model: Modelled, data: Signal | ArrayLike, rate: float | None = None, *, mean: float | None = None,
    estimated: int | None = None,
) -> Residuals:  # fmt: skip
    """Compute the standardised innovations of a recording; see `Model.residuals`."""
    problem = pose_filter(model, data, rate, mean)
    values, _ = standardise(problem, problem.model)
    terms = getattr(model, "model", None)
    lost = None
    if estimated is None:
        estimated = 0 if terms is None else len(terms.names) - len(terms.fixed_names)
        lost = None if terms is None else spent(LikelihoodProblem(terms, problem.record, problem.mean))
    else:
        estimated = as_whole_number(estimated, "estimated", 0)
    record = problem.record
    return Residuals(
        model=problem.model, values=values, rate=record.rate, times=record.times, axis=record.axis, estimated=estimated,
        spent=lost,
    )  # fmt: skip


def spent(problem: LikelihoodProblem) -> Vector:
    """Return the degrees of freedom (L,) N D_k I⁻¹ D_kᵀ that estimates take from the autocorrelation at lags 1 … L: r̂
    ≈ r + D(θ̂ − θ), D = ∂r/∂θ, has the covariance (1 − N D I⁻¹ Dᵀ)/N with the information I, for efficient estimates
    (Box and Pierce 1970, JASA 65, 1509-1526, section 3)."""
    # Largest number of samples from which `spent` is computed; it hardly depends on the length.
    longest = 65_536
    record = problem.record
    if record.values.size > longest:
        part = replace(record, values=record.values[:longest])
        problem = replace(problem, record=part if part.observed > longest // 2 else record)
    # Largest number of lags of `spent`. It is larger than the default number of lags of all tests in gmwm.
    lags = min(1000, problem.record.observed // 2)
    z = problem.at(problem.model)
    active = [k for k in range(z.size) if np.isfinite(z[k])]
    here = problem.evaluate(z, active) if active else None
    if here is None:
        return np.zeros(lags)
    rows = []
    for a, k in enumerate(active):
        step = np.zeros(z.size)
        step[k] = min(1e-2, 0.1 / math.sqrt(max(here.information[a, a], 1e-12)))
        ends = [standardise(problem, problem.at_point(z + sign * step))[0] for sign in (1.0, -1.0)]
        rows.append((autocorrelation(ends[0], lags) - autocorrelation(ends[1], lags))[1:] / (2.0 * step[k]))
    slopes = np.array(rows)
    size = np.sqrt(np.diag(here.information))
    size = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(here.information / np.outer(size, size))
    able = values > 1e-10 * values[-1]
    along = vectors[:, able].T @ (slopes / size[:, None]) / np.sqrt(values[able])[:, None]
    # If samples are missing, the variance of the autocorrelation is pairs/N² instead of 1/N.
    pairs = np.maximum(observed_pairs(problem.record.values, lags), 1.0)
    return np.asarray(problem.record.observed**2 / pairs * np.sum(np.square(along), axis=0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Forecasts(FrozenArrays):
    """Predictions of one model, each one sample ahead, in the part of a recording that the fit has not used.

    Attributes
    ----------
    fit : LikelihoodFit
        Fit to the first part.
    standardised : (M,) array
        Errors of the predictions divided by their standard deviations; NaN where a sample is missing.
    deviation : float, in the unit of the recording
        Standard deviation of the prediction that the model states, without a gap before the sample.
    """

    fit: LikelihoodFit
    standardised: Vector
    deviation: float

    @property
    def _errors(self) -> Vector:
        return np.asarray(self.standardised[np.isfinite(self.standardised)])

    @property
    def median_error(self) -> float:
        """Median absolute prediction error (MAPE), in the unit of the recording."""
        return self.deviation * float(np.median(np.abs(self._errors)))

    @property
    def rms_error(self) -> float:
        """Root mean square prediction error, in the unit of the recording."""
        return self.deviation * float(np.sqrt(np.mean(self._errors**2)))

    @property
    def score(self) -> float:
        """Mean log density of a sample under its prediction; the largest is best."""
        return float(-0.5 * np.mean(self._errors**2) - 0.5 * math.log(2 * math.pi) - math.log(self.deviation))

    def coverage(self, level: float = 0.95) -> float:
        """Return the share of the samples inside their prediction intervals with the probability `level`."""
        reach = NormalDist().inv_cdf((1 + as_confidence(level, "level")) / 2)
        return float(np.mean(np.abs(self._errors) <= reach))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Evaluation(Summarised, Mapping[str, Forecasts]):
    """Predictions of several models out of sample.

    Attributes
    ----------
    forecasts : mapping of structure to Forecasts
        Predictions of each model, the one with the best score first.
    """

    forecasts: Mapping[str, Forecasts]

    def __getitem__(self, model: str) -> Forecasts:
        return self.forecasts[model]

    def __iter__(self) -> Iterator[str]:
        return iter(self.forecasts)

    def __len__(self) -> int:
        return len(self.forecasts)

    @property
    def best(self) -> str:
        """Structure of the model with the largest score."""
        return next(iter(self.forecasts))

    def summary(self) -> str:
        """Format a table of the median and the root mean square error, the coverage and the score of each model."""
        rows = [("model", "median error", "rms error", "in 95 %", "score")]
        rows += [
            (name, f"{f.median_error:.4g}", f"{f.rms_error:.4g}", f"{100 * f.coverage():.1f} %", f"{f.score:.4f}")
            for name, f in self.forecasts.items()
        ]
        return "\n".join(align(rows))

    def __repr__(self) -> str:
        return f"Evaluation({', '.join(self.forecasts)})"


def evaluate(
    models: Sequence[Model | Process | str], data: Signal | ArrayLike, rate: float | None = None, *, start: float = 0.8
) -> Evaluation:
    """Compare models by one-step predictions out of sample.

    Each model is fitted by maximum likelihood to the first part of the recording. Its Kalman filter then predicts each
    sample of the second part from all samples before it, without a new fit.

    Parameters
    ----------
    models : sequence of Model, Process or str
        Models with a state-space form, for example ``["AR(1)", "ARMA(2,1)"]``.
    data : Signal or (N,) array
        The recording; NaN is a missing sample.
    rate : float, optional
        Sampling rate (Hz) of an array.
    start : float
        Share of the recording to which the models are fitted, between 0 and 1.

    Returns
    -------
    Evaluation
        Median absolute error (MAPE), root mean square error, coverage of prediction intervals and log score of each
        model, in the order of the score.

    Raises
    ------
    OptionError
        If `start` is out of range, or there is no model.
    ModelError, MissingTheoryError, DataError
        The same as for `gmwm.fit_ml`.

    Examples
    --------
    >>> from gmwm import AR
    >>> x = AR(phi=[1.4, -0.6], sigma2=1.0).simulate(3000, 1.0, rng=1)
    >>> result = evaluate(["WN", "AR(1)", "AR(2)"], x, rate=1.0)
    >>> result.best, round(result["AR(2)"].rms_error, 1)
    ('AR(2)', 1.0)
    """
    start = as_number(start, "start", lambda share: 0 < share < 1, "a share between 0 and 1")
    terms = [as_model(model) for model in models]
    if not terms:
        raise OptionError(argument="models", expected="at least one model", got=models)
    record = as_record(data, rate)
    first = round(start * record.values.size)
    forecasts = {model.structure: _forecasts(model, record.values, record.rate, first) for model in terms}
    return Evaluation(forecasts=dict(sorted(forecasts.items(), key=lambda item: -item[1].score)))


def _forecasts(model: Model, values: Vector, rate: float, first: int) -> Forecasts:
    """Fit a model to the first samples, and predict the others."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)  # a poor model is expected among several
        fit = fit_ml(model, values[:first], rate)
    # The mean of a stationary process must not come from the samples that are predicted.
    stationary = all(process.stationary for process in model.processes)
    mean = float(np.nanmean(values[:first])) if stationary else None
    standardised = residuals(fit.model, values, rate, mean=mean, estimated=0).values[first:]
    # The innovation of an impulse in the last sample is the inverse of its standard deviation.
    impulse, out = np.zeros((1, values.size)), np.empty(values.size)
    impulse[0, -1] = 1.0
    _core.kalman_innovations(*assemble(fit.model, rate).matrices, impulse, out)
    return Forecasts(fit=fit, standardised=standardised, deviation=float(1 / out[-1]))
