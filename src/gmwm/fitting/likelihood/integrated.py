"""ARIMA models: fits to differences of a series, and forecasts of the series itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import FrozenArrays, Vector, as_whole_number
from gmwm.base.errors import DataError, ModelError, OptionError
from gmwm.base.text import Summarised
from gmwm.fitting.likelihood.estimator import fit_ml
from gmwm.fitting.likelihood.problem import as_record
from gmwm.fitting.likelihood.result import LikelihoodFit
from gmwm.fitting.likelihood.tracks import BIAS, predict_tracks
from gmwm.recording.options import as_confidence
from gmwm.recording.signals import Signal
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.linear_recursion import Lagged
from gmwm.theory.processes.model import Model, as_model


@dataclass(frozen=True, kw_only=True, eq=False)
class Forecast(FrozenArrays):
    """Forecast of a series.

    Attributes
    ----------
    mean, error : (steps,) arrays, in the unit of the series
        Forecasts after the last sample, and their standard deviations for the parameters of the fit.
    """

    mean: Vector
    error: Vector

    def band(self, level: float = 0.95) -> tuple[Vector, Vector]:
        """Return the lower and upper ends (steps,) of intervals with the probability `level`."""
        reach = NormalDist().inv_cdf((1 + as_confidence(level, "level")) / 2) * self.error
        return self.mean - reach, self.mean + reach


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ArimaFit(Summarised):
    """ARIMA model that was fitted to a series by maximum likelihood.

    Attributes
    ----------
    fit : LikelihoodFit
        Fit of the ARMA model to the differences, with parameters, errors, `aic` and `bic`.
    differences : (N − D,) array
        Differences of the series, of the order D in all; NaN where a sample is missing.
    series : (N,) array
        The series.
    operator : (D + 1,) array
        Coefficients of (1 − B)^d (1 − B^s)^D', from the lag 0 on.
    """

    fit: LikelihoodFit
    differences: Vector
    series: Vector
    operator: Vector

    def predict(self, steps: int) -> Forecast:
        """Forecast the next samples of the series.

        With the moving-average weights ψ of the series, the variance h steps ahead is σ² Σ_{k<h} ψ_k².

        Parameters
        ----------
        steps : int
            Number of samples.

        Raises
        ------
        DataError
            If one of the last samples, from which the differences are added up, is missing.
        """
        from scipy.signal import lfilter

        steps = as_whole_number(steps, "steps", 1)
        last = self.series[self.series.size - self.operator.size + 1 :]
        if not np.all(np.isfinite(last)):
            raise DataError(
                f"a forecast needs the last {last.size} samples, and one of them is missing", argument="data",
                advice="End the series at its last complete part.",
            )  # fmt: skip
        tracks = predict_tracks(self.fit, self.differences, steps)
        added = np.sum([tracks.mean[label] for label in tracks.labels if label != BIAS], axis=0)
        mean = np.empty(steps)
        series = list(last)
        for k in range(steps):
            series.append(added[k] - self.operator[1:] @ series[: -self.operator.size : -1])
            mean[k] = series[-1]
        process = self.fit.model.processes[0]
        assert isinstance(process, Lagged)
        phi, theta = process.recursion_polynomials
        impulse = np.zeros(steps)
        impulse[0] = 1.0
        weights = lfilter(theta, np.convolve(phi, self.operator), impulse)
        return Forecast(mean=mean, error=np.sqrt(process.scale * np.cumsum(weights**2)))

    def summary(self) -> str:
        """Format the number of differences and the fit to them."""
        return f"{self.operator.size - 1} differences of {self.series.size} samples\n{self.fit.summary()}"

    def __repr__(self) -> str:
        return f"ArimaFit({self.fit.model.structure}, {self.operator.size - 1} differences)"


def fit_arima(
    model: Model | Process | str, data: Signal | ArrayLike, rate: float | None = None, *, integrated: int = 1,
    seasonal: Sequence[int] = (0, 1), drift: bool = False,
) -> ArimaFit:  # fmt: skip
    """Fit an ARIMA or SARIMA model: an ARMA model of the differences (1 − B)^d (1 − B^s)^D X_t, by maximum likelihood.

    Parameters
    ----------
    model : Model, Process or str
        One autoregressive moving average, such as "ARMA(1,1)" or "SARMA(0,1,0,1,12)".
    data : Signal or (N,) array
        The series; gaps and NaN are missing samples, and a difference with a missing sample is missing too.
    rate : float, optional
        Sampling rate (Hz) of an array.
    integrated : int
        Order d of the differences.
    seasonal : (D, s)
        Order D of the seasonal differences, and the period s (samples).
    drift : bool
        Whether the differences have an unknown mean; otherwise it is zero.

    Returns
    -------
    ArimaFit
        Fit of the differences, and forecasts of the series.

    Raises
    ------
    ModelError
        If the model is not a single autoregressive moving average.
    OptionError, DataError
        If an order is invalid, or the series is too short.

    References
    ----------
    Box, Jenkins and Reinsel (2008), Time Series Analysis: Forecasting and Control, 4th ed., chapters 4, 5 and 9.

    Examples
    --------
    >>> import numpy as np
    >>> from gmwm import MA
    >>> x = np.cumsum(MA(theta=[0.5], sigma2=1.0).simulate(2000, 1.0, rng=1))
    >>> result = fit_arima("MA(1)", x, rate=1.0)
    >>> round(result.fit.parameters["MA(1).theta1"], 1), result.predict(3).error.round(1)
    (0.5, array([1. , 1.8, 2.4]))
    """
    terms = as_model(model)
    if len(terms.processes) != 1 or not isinstance(terms.processes[0], Lagged):
        raise ModelError(
            f"an ARIMA model is one autoregressive moving average of the differences; got {terms}", argument="model",
            got=terms, advice="Use `gmwm.fit_ml` for sums of processes, with RW for a random walk.",
        )  # fmt: skip
    order = as_whole_number(integrated, "integrated", 0)
    if len(seasonal) != 2:
        raise OptionError(argument="seasonal", expected="the order and the period (samples)", got=seasonal)
    seasons, period = as_whole_number(seasonal[0], "seasonal", 0), as_whole_number(seasonal[1], "seasonal", 1)
    operator = np.ones(1)
    for lag in [1] * order + [period] * seasons:
        operator = np.convolve(operator, np.concatenate([[1.0], np.zeros(lag - 1), [-1.0]]))
    record = as_record(data, rate)
    if record.values.size < operator.size + 8:
        raise DataError(
            f"{record.values.size} samples are too few for {operator.size - 1} differences", argument="data", got=data
        )
    size = record.values.size - operator.size + 1
    # A lag with the coefficient 0 must not make a difference missing.
    differences = np.sum(
        [c * record.values[operator.size - 1 - k :][:size] for k, c in enumerate(operator) if c], axis=0
    )
    fit = fit_ml(terms, differences, record.rate, mean=None if drift else 0.0)
    return ArimaFit(fit=fit, differences=differences, series=record.values, operator=operator)
