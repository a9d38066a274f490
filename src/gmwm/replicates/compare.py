"""Compare the recordings of a pooled fit with each other: tests, the numbers of each recording, and their spread."""

from __future__ import annotations

import math
from collections.abc import Mapping
from statistics import NormalDist

import numpy as np

from gmwm._arrays import Vector
from gmwm.covariance import Design, covariance
from gmwm.datasheets import Datasheet, Entry, datasheet
from gmwm.errors import GmwmError
from gmwm.estimation.estimator import as_fit
from gmwm.estimation.problem import pose
from gmwm.estimation.recordings import deviations
from gmwm.estimation.result import Fit
from gmwm.estimation.reweighting import Settled
from gmwm.estimation.solver import solve
from gmwm.estimation.weighting import precision
from gmwm.inference.intervals import with_quick_intervals
from gmwm.joint.same import level_ratios
from gmwm.random_effects import effects, predicted, spread_limits
from gmwm.replicates.result import RecordingNumber, Replicates
from gmwm.variance.pooling import shortened
from gmwm.variance.result import WaveletVariance

CONFIDENCE = 0.95
"""Level of the limits of the spread, and of the prediction for a further recording."""
_RAMP = "R"
"""Symbol of the rate ramp, which has a sign and belongs to one recording."""


def compared(fit: Fit) -> Replicates | None:
    """Compare the recordings of a pooled fit; None if it has a single recording. See `Fit.replicates`."""
    wv = fit.wavelet_variance
    if len(wv.recordings) < 2:
        return None
    apart = deviations(fit)
    own = {name: _own_fit(fit, curve) for name, curve in wv.recordings.items()}
    sheets = {name: _quick_sheet(one) for name, one in own.items() if one is not None}
    return Replicates(
        fit=fit,
        deviations=apart,
        fits={name: one for name, one in own.items() if one is not None},
        numbers=tuple(_numbers(datasheet(fit, CONFIDENCE), sheets, tuple(wv.recordings))),
        levels=tuple(level_ratios(wv.recordings, wv.axis)),
    )


def _own_fit(fit: Fit, curve: WaveletVariance) -> Fit | None:
    """The fit of the same model to one recording, with the weights of the pooled fit; None if it is too short."""
    wv = shortened(curve, min(len(curve), len(fit.wavelet_variance)))
    try:
        problem = pose(fit.model, wv, precision(covariance(fit.model, Design.of(wv))))
        return as_fit(Settled(problem, solve(problem, certify=False)), wv, "optimal")
    except GmwmError:
        return None


def _quick_sheet(fit: Fit) -> Datasheet:
    """The datasheet with quick upper limits; with exact ones if a term is zero, which has no quick limit."""
    try:
        return datasheet(with_quick_intervals(fit, CONFIDENCE), CONFIDENCE)
    except GmwmError:
        return datasheet(fit, CONFIDENCE)


def _numbers(pooled: Datasheet, sheets: Mapping[str, Datasheet], names: tuple[str, ...]) -> list[RecordingNumber]:
    """The numbers of the pooled fit that vary, with their values in each recording."""
    found = []
    for symbol, entry in pooled.items():
        if entry.held or symbol.partition("[")[0] == _RAMP:
            continue
        entries = {name: sheets[name].get(symbol) if name in sheets else None for name in names}
        found.append(_number(symbol, entry, entries))
    return found


def _number(symbol: str, pooled: Entry, entries: Mapping[str, Entry | None]) -> RecordingNumber:
    """The spread of one number over the recordings, on the logarithm."""
    points = [_point(entry, pooled) for entry in entries.values()]
    x, s2 = (np.array([values], dtype=np.float64) for values in zip(*points, strict=True))
    known = int(np.count_nonzero(np.isfinite(x)))
    number = RecordingNumber(symbol=symbol, title=pooled.title, unit=pooled.unit, pooled=pooled, entries=dict(entries))
    if known < 2:
        return number
    at = effects(x, s2)
    low, high = spread_limits(x, s2, CONFIDENCE)
    first, last = predicted(x, s2, CONFIDENCE)
    return RecordingNumber(
        symbol=symbol, title=pooled.title, unit=pooled.unit, pooled=pooled, entries=dict(entries),
        spread=math.sqrt(_one(at.spread2)), spread_low=math.sqrt(_one(low)), spread_high=math.sqrt(_one(high)),
        predicted_low=_exp(_one(first)), predicted_high=_exp(_one(last)),
    )  # fmt: skip


def _point(entry: Entry | None, pooled: Entry) -> tuple[float, float]:
    """The logarithm of a number and its variance; NaN if it is not known.

    An upper limit counts as a value if it is below the number of all recordings: the recording is at least so far off.
    """
    if entry is None or entry.low is None or entry.high is None or not math.isfinite(entry.high):
        return math.nan, 1.0
    z = NormalDist().inv_cdf((1 + CONFIDENCE) / 2)
    if entry.upper_only or entry.low <= 0:
        below = not pooled.upper_only and 0 < entry.high < pooled.value
        return (math.log(entry.high), 1 / z**2) if below else (math.nan, 1.0)
    error = math.log(entry.high / entry.low) / (2 * z)
    return (math.log(entry.value), max(error, 1e-12) ** 2) if entry.value > 0 else (math.nan, 1.0)


def _one(values: Vector) -> float:
    return float(np.asarray(values)[0])


def _exp(value: float) -> float:
    return math.exp(min(value, 700.0))
