"""Autocorrelation and partial autocorrelation of a recording, or of a model."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base import statistics
from gmwm.base.arrays import Vector, as_rate, as_whole_number
from gmwm.base.errors import ModelError, OptionError
from gmwm.fitting.likelihood.problem import as_record
from gmwm.recording.signals import Signal
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model, as_model


def autocorrelation(
    data: Model | Process | str | Signal | ArrayLike, lags: int | None = None, rate: float = 1.0, *,
    partial: bool = False, robust: bool = False,
) -> Vector:  # fmt: skip
    """Compute the autocorrelation of a recording, or the theoretical one of a stationary model.

    Parameters
    ----------
    data : Signal, (N,) array, Model, Process or str
        A recording, in which samples may be missing (gaps, or NaN), or a model whose parameters all have values.
    lags : int, optional
        Number of lags L; 10 log₁₀ N by default, and 40 for a model.
    rate : float
        Sampling rate (Hz) of a model; only a Gauss-Markov process and other processes in continuous time need it.
    partial : bool
        Whether to return the partial autocorrelation, by the recursion of Durbin and Levinson.
    robust : bool
        Whether to use the normal scores of the ranks instead of the samples. Outliers then have a limited
        influence, and the efficiency for Gaussian noise is one.

    Returns
    -------
    (L + 1,) array
        Values at the lags 0 … L; the first is 1. Values of white noise have the standard deviation 1/√N.

    Raises
    ------
    OptionError
        If an option has an invalid value.
    MissingTheoryError
        If a process of the model is not stationary.
    DataError, ModelError
        If the recording has fewer than 8 samples or is constant, or if the model is zero.

    References
    ----------
    Brockwell and Davis (1991), Time Series: Theory and Methods, section 3.4 and proposition 5.2.1. Boudt, Cornelissen
    and Croux (2012), The Gaussian rank correlation estimator, Statistics and Computing 22, 471-483.

    Examples
    --------
    >>> from gmwm import ARMA
    >>> autocorrelation("AR(2, phi1=1.4, phi2=-0.6, sigma2=1)", 3).round(3)
    array([1.   , 0.875, 0.625, 0.35 ])
    >>> autocorrelation("AR(2, phi1=1.4, phi2=-0.6, sigma2=1)", 3, partial=True).round(3)
    array([ 1.   ,  0.875, -0.6  ,  0.   ])
    >>> x = ARMA(phi=[0.7], theta=[0.4], sigma2=1.0).simulate(5000, 1.0, rng=1)
    >>> x[::50] += 100.0
    >>> autocorrelation(x, 2).round(2), autocorrelation(x, 2, robust=True).round(2)
    (array([ 1.  , -0.01, -0.01]), array([1.  , 0.71, 0.49]))
    """
    if isinstance(data, Model | Process | str):
        if robust:
            raise OptionError(argument="robust", expected="False for a model", got=robust)
        count = 40 if lags is None else as_whole_number(lags, "lags", 1)
        covariance = as_model(data).autocovariance(np.arange(count + 1), as_rate(rate))
        if not covariance[0] > 0:
            raise ModelError(f"the model {data} is zero, so it has no autocorrelation")
        r = np.asarray(covariance / covariance[0])
    else:
        record = as_record(data, data.rate if isinstance(data, Signal) else 1.0)
        values, count = record.values, as_lags(lags, record.observed)
        r = statistics.autocorrelation(_normal_scores(values) if robust else values, count)
        r[1:] *= pair_factors(values, count)
    return _partial(r) if partial else r


def as_lags(lags: int | None, observed: int) -> int:
    """Check a number of lags, 10 log₁₀ N by default, for N = `observed` samples."""
    most = observed - 1
    count = min(int(10 * math.log10(observed)), most) if lags is None else as_whole_number(lags, "lags", 1)
    if count > most:
        raise OptionError(argument="lags", expected=f"at most {most}, the number of samples less one", got=lags)
    return count


def pair_factors(values: Vector, lags: int) -> Vector:
    """Return N − k over the number of observed pairs at lags k = 1 … L: 1 without gaps, 0 without a pair."""
    counts = statistics.observed_pairs(values, lags)
    expected = np.count_nonzero(np.isfinite(values)) - np.arange(1.0, lags + 1)
    return np.divide(expected, counts, out=np.zeros(lags), where=counts > 0)


def _normal_scores(values: Vector) -> Vector:
    """Return Φ⁻¹(rank/(n + 1)) of each value; equal values have their mean rank, and NaN stays NaN."""
    from scipy.special import ndtri
    from scipy.stats import rankdata

    finite = np.isfinite(values)
    scores = np.full(values.size, np.nan)
    scores[finite] = ndtri(rankdata(values[finite]) / (np.count_nonzero(finite) + 1))
    return scores


def _partial(r: Vector) -> Vector:
    """Return the partial autocorrelations (L + 1,) of autocorrelations (L + 1,), by Durbin and Levinson."""
    result, phi, variance = np.ones(r.size), np.empty(0), 1.0
    for k in range(1, r.size):
        last = (r[k] - phi @ r[k - 1 : 0 : -1]) / variance
        phi = np.append(phi - last * phi[::-1], last)
        variance *= 1 - last**2
        result[k] = last
        if variance <= 0:  # rounding of a process that is nearly predictable
            result[k + 1 :] = 0.0
            break
    return result
