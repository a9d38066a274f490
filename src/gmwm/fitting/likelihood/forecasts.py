"""Compare models by the errors of their predictions of samples that the fit has not used."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base import _core
from gmwm.base.arrays import FrozenArrays, Vector
from gmwm.base.errors import FitWarning, OptionError
from gmwm.base.text import Summarised, align
from gmwm.fitting.likelihood.estimator import fit_ml
from gmwm.fitting.likelihood.innovations import residuals
from gmwm.fitting.likelihood.record import as_record
from gmwm.fitting.likelihood.result import LikelihoodFit
from gmwm.fitting.likelihood.system import assemble
from gmwm.recording.options import as_confidence
from gmwm.recording.signals import Signal
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model, as_model


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
class Evaluation(Summarised):
    """Predictions of several models out of sample.

    Attributes
    ----------
    forecasts : mapping of structure to Forecasts
        Predictions of each model, the one with the best score first.
    """

    forecasts: Mapping[str, Forecasts]

    def __getitem__(self, model: str) -> Forecasts:
        return self.forecasts[model]

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
    if isinstance(start, bool) or not isinstance(start, int | float) or not 0 < start < 1:
        raise OptionError(argument="start", expected="a share between 0 and 1", got=start)
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
