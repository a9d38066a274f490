"""Compare the recordings of a pooled fit: tests, the noise parameters of each recording, and their spread."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from statistics import NormalDist

import numpy as np

from gmwm.base.errors import GmwmError
from gmwm.base.random_effects import effects, prediction_limits, spread_limits
from gmwm.choosing.datasheets import Datasheet, Entry, datasheet
from gmwm.choosing.replicates.comparison import level_ratios
from gmwm.choosing.replicates.result import RecordingNumber, Replicates
from gmwm.fitting.estimation.intervals import parameters_by_name, with_quick_intervals
from gmwm.fitting.estimation.recordings import Deviations, deviations, step_parameter
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.weighting import precision
from gmwm.measuring.covariance import Design, covariance
from gmwm.measuring.variance.result import WaveletVariance

CONFIDENCE = 0.95
"""Confidence level of the limits of the spread, and of the prediction for a further recording."""


def compare_recordings(fit: Fit) -> Replicates | None:
    """Compare the recordings of a pooled fit, or return None if there is a single recording; see `Fit.replicates`."""
    wv = fit.wavelet_variance
    if len(wv.recordings) < 2:
        return None
    apart = deviations(fit)
    singles = {name: _single_fit(fit, curve, apart, k) for k, (name, curve) in enumerate(wv.recordings.items())}
    sheets = {name: _quick_sheet(single) for name, single in singles.items() if single is not None}
    return Replicates(
        fit=fit, deviations=apart, fits={name: single for name, single in singles.items() if single is not None},
        numbers=tuple(_numbers(datasheet(fit, CONFIDENCE), sheets, tuple(wv.recordings))),
        levels=tuple(level_ratios(wv.recordings, wv.axis)),
    )  # fmt: skip


def _single_fit(fit: Fit, curve: WaveletVariance, apart: Deviations, place: int) -> Fit | None:
    """Return one Gauss-Newton step from the pooled fit to one recording, if long enough. In a new fit, a slow
    Gauss-Markov term can become fast."""
    if not np.all(np.isfinite(apart.values[place])):
        return None
    wv = curve.first(min(len(curve), len(fit.wavelet_variance)))
    parameters = parameters_by_name(fit.model)
    steps = zip(apart.names, apart.values[place].tolist(), strict=True)
    try:
        model = fit.model.with_values({n: step_parameter(parameters[n], fit.parameters[n], s) for n, s in steps})
    except GmwmError:  # after the step, the coefficients of an AR process may not be stationary
        return None
    matrix = precision(covariance(fit.model, Design.of(wv)))
    implied = model.wavelet_variance(wv.levels, wv.rate, wv.filter)
    miss = wv.variance - implied
    return Fit(
        wavelet_variance=wv, model=model, objective=float(miss @ matrix @ miss), lower_bound=None, relaxed_bound=0.0,
        parameters={name: value for name, value in model.parameters.items() if value is not None},
        implied=implied, decomposition=model.decomposition(wv.levels, wv.rate, wv.filter), weighting="optimal",
        weighting_matrix=matrix, diagnostics=fit.diagnostics,
    )  # fmt: skip


def _quick_sheet(fit: Fit) -> Datasheet:
    """Return the datasheet of a fit with approximate upper limits, or exact ones if a term is zero."""
    try:
        return datasheet(with_quick_intervals(fit, CONFIDENCE), CONFIDENCE)
    except GmwmError:
        return datasheet(fit, CONFIDENCE)


def _numbers(pooled: Datasheet, sheets: Mapping[str, Datasheet], names: tuple[str, ...]) -> list[RecordingNumber]:
    """Return each free datasheet parameter of the pooled fit, except the rate ramp, with its recorded values."""
    numbers = []
    for symbol, entry in pooled.items():
        if entry.held or symbol.partition("[")[0] == "R":  # it has a sign and differs in each recording
            continue
        entries = {name: sheets[name].get(symbol) if name in sheets else None for name in names}
        numbers.append(_number(symbol, entry, entries))
    return numbers


def _number(symbol: str, pooled: Entry, entries: Mapping[str, Entry | None]) -> RecordingNumber:
    """Return one datasheet parameter with the spread of its logarithm over the recordings."""
    points = [_point(entry, pooled) for entry in entries.values()]
    x, s2 = (np.array([values], dtype=np.float64) for values in zip(*points, strict=True))
    number = RecordingNumber(symbol=symbol, title=pooled.title, unit=pooled.unit, pooled=pooled, entries=dict(entries))
    if np.count_nonzero(np.isfinite(x)) < 2:
        return number
    spread, low, high = (math.sqrt(v.item()) for v in (effects(x, s2).spread2, *spread_limits(x, s2, CONFIDENCE)))
    first, last = (math.exp(min(value.item(), 700.0)) for value in prediction_limits(x, s2, CONFIDENCE))
    return replace(number, spread=spread, spread_low=low, spread_high=high, predicted_low=first, predicted_high=last)


def _point(entry: Entry | None, pooled: Entry) -> tuple[float, float]:
    """Return the logarithm of a parameter in one recording, or NaN, and its variance; an upper limit below the pooled
    value is a value, because the recording deviates by at least this much."""
    if entry is None or entry.low is None or entry.high is None or not math.isfinite(entry.high):
        return math.nan, 1.0
    z = NormalDist().inv_cdf((1 + CONFIDENCE) / 2)
    if entry.upper_only or entry.low <= 0:
        below = not pooled.upper_only and 0 < entry.high < pooled.value
        return (math.log(entry.high), 1 / z**2) if below else (math.nan, 1.0)
    error = math.log(entry.high / entry.low) / (2 * z)
    return (math.log(entry.value), max(error, 1e-12) ** 2) if entry.value > 0 else (math.nan, 1.0)
