"""Result of the comparison of the recordings of a pooled fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import NormalDist
from textwrap import wrap
from typing import Any, Literal, get_args

import numpy as np

from gmwm.base.documents import plain, plain_fields
from gmwm.base.errors import GmwmError
from gmwm.base.remarks import Remark, texts
from gmwm.base.results import Difference
from gmwm.base.statistics import effects, prediction_limits, spread_limits
from gmwm.base.text import TEXT_WIDTH, list_text, p_relation, round_text, table_with_rule
from gmwm.choosing.datasheets import Datasheet, Entry, datasheet
from gmwm.choosing.datasheets.entry import significant
from gmwm.choosing.replicates.comparison import LevelRatio, RecordingComparison, decide, level_ratios, smallest
from gmwm.fitting.estimation.intervals import parameters_by_name, with_quick_intervals
from gmwm.fitting.estimation.recordings import Deviations, deviations, step_parameter
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.weighting import precision
from gmwm.measuring.covariance import Design, covariance
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.options import as_confidence, one_of
from gmwm.theory.processes.model import Model

SIZE = 0.05
"""Significance level of the test that the recordings of an axis are equal (docs/validation/recordings.md)."""
MAIN = ("N", "B", "K", "Q")  # symbols of the parameters that a remark names. Tables contain all parameters
Use = Literal["mean", "high"]
"""Noise that a filter assumes: the mean over the recordings, or the highest that a further recording may have."""


@dataclass(frozen=True, kw_only=True)
class RecordingNumber:
    """One datasheet parameter in each of several recordings, with its spread.

    Attributes
    ----------
    symbol, title, unit : str
        Symbol, name and SI unit.
    pooled : Entry
        Value from all recordings together. Its confidence interval includes the spread between recordings.
    entries : mapping of recording to (Entry or None)
        Value from each recording alone, with the same model; None if the recording is too short.
    spread, spread_low, spread_high : float or None
        Standard deviation of the logarithm between recordings, without estimation errors, and its confidence limits
        (0.1 is 10 %). None if fewer than two recordings have a value.
    predicted_low, predicted_high : float or None
        Prediction limits for the value in a further recording."""

    symbol: str
    title: str
    unit: str
    pooled: Entry
    entries: Mapping[str, Entry | None]
    spread: float | None = None
    spread_low: float | None = None
    spread_high: float | None = None
    predicted_low: float | None = None
    predicted_high: float | None = None

    @property
    def apart(self) -> float | None:
        """Ratio of the largest to the smallest value, minus 1. None if a recording has no value or only an upper
        limit."""
        values = [entry.value for entry in self.entries.values() if entry is not None and not entry.upper_only]
        return max(values) / min(values) - 1 if len(values) == len(self.entries) and min(values) > 0 else None

    def to_dict(self) -> dict[str, Any]:
        """Return the parameter as numbers, lists and strings for JSON."""
        spreads = plain_fields(self, "apart spread spread_low spread_high predicted_low predicted_high")
        return plain_fields(self, "symbol title unit pooled") | {"recordings": plain(self.entries), **spreads}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Replicates(RecordingComparison):
    """Comparison of several recordings of one unit.

    Attributes
    ----------
    fit : Fit
        Fit to the mean of the wavelet variances of all recordings (pooled fit).
    deviations : gmwm.estimation.recordings.Deviations
        Deviations of the parameters of each recording from the pooled fit, with their covariances, and the test of
        equal parameters.
    fits : mapping of recording to Fit
        Fit to each recording alone, computed by one Gauss-Newton step from the pooled fit.
    numbers : tuple of RecordingNumber
        Datasheet parameters with their spread, without the rate ramp R, which differs in each recording.
    levels : tuple of LevelRatio
        Ratio of the wavelet deviation of each recording to the mean of the others at each level, with unadjusted
        p-values.
    """

    fit: Fit
    deviations: Deviations
    fits: Mapping[str, Fit]
    numbers: tuple[RecordingNumber, ...]
    levels: tuple[LevelRatio, ...]
    size = SIZE

    @property
    def recordings(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the recordings."""
        return self.deviations.recordings

    @property
    def axis(self) -> str:
        """Name of the axis."""
        return self.fit.wavelet_variance.axis

    def __getitem__(self, symbol: str) -> RecordingNumber:
        """Return the parameter with a symbol, such as "N"."""
        for number in self.numbers:
            if number.symbol == symbol:
                return number
        raise KeyError(f"{symbol}; there are {', '.join(number.symbol for number in self.numbers)}")

    @property
    def tests(self) -> tuple[Difference, ...]:
        """The ratios of all levels, with p-values that are adjusted for their number."""
        return tuple(row.difference for row in decide(self.levels, self.size))

    @property
    def spread(self) -> dict[str, float]:
        """Standard deviation of the logarithm of each parameter between recordings, if at least two recordings have a
        value."""
        return {number.symbol: number.spread for number in self.numbers if number.spread is not None}

    @property
    def parameter_pvalue(self) -> float:
        """p-value of the test that all recordings have the same parameters. It is valid only if the model is right."""
        return self.deviations.pvalue

    @cached_property
    def model_free_pvalue(self) -> float:
        """p-value of the test that all recordings have the same wavelet variances, without a model."""
        return smallest(decide(self.levels, self.size))

    @property
    def pvalue(self) -> float:
        """p-value of both tests together: twice the smaller p-value, but at most 1."""
        return min(1.0, 2 * min(self.parameter_pvalue, self.model_free_pvalue))

    def for_filter(self, use: Use = "mean", confidence: float = 0.95) -> Model:
        """Return the model with values for a filter that will process further recordings.

        For fixed gains, the error covariance of a filter is linear in the covariance of the noise. A filter with the
        mean noise therefore has the smallest mean squared error over many recordings. With the highest noise, the
        filter rarely underestimates its errors.

        Parameters
        ----------
        use : "mean" or "high"
            "mean" uses the mean over the recordings, weighted by 1/(spread² + error²). "high" uses the upper end of the
            prediction interval for a further recording for each variance, and the mean of the correlation times.
        confidence : float
            Level of the prediction interval, from 0.5 to below 1. With two or three recordings, the interval is wide.

        Raises
        ------
        OptionError
            If `use` or `confidence` is not allowed.
        """
        one_of(use, "use", get_args(Use))
        as_confidence(confidence)
        deviations = self.deviations
        _, high = prediction_limits(deviations.known.T, deviations.variances.T, confidence)
        parameters = parameters_by_name(self.fit.model)
        values: dict[str, float] = {}
        for name, mean, end in zip(deviations.names, deviations.effects.mean, high, strict=True):
            raised = use == "high" and parameters[name].scale_power is not None and math.isfinite(end)
            share = float(end if raised else mean)
            if math.isfinite(share):
                values[name] = step_parameter(parameters[name], self.fit.parameters[name], share)
        return self.fit.model.with_values(values)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """The remark on whether the recordings agree."""
        return (self.remark(self.pvalue),)

    def remark(self, pvalue: float) -> Remark:
        """Return the remark on whether the recordings agree, for a `pvalue` that may be adjusted for several axes."""
        main = [number for number in self.numbers if number.symbol in MAIN]
        if pvalue > SIZE:
            code, nothing = "recordings-agree", "no number has a value"
            parts = [f"{n.symbol} within {_percent(n.apart)}" for n in main if n.apart is not None]
        else:
            code, nothing = "recordings-differ", "only the curves"
            parts = [f"{n.symbol} by {_percent(n.spread)}" for n in main if n.spread]
        # With fewer recordings, an interval is hardly narrower than with one (docs/validation/recordings.md).
        return Remark.of(
            code, self.axis, case="numbers", count=len(self.recordings), numbers=list_text(parts) or nothing,
            p=f"p {p_relation(pvalue)}", few="yes" if len(self.recordings) < 4 else "no", size=SIZE,
        )  # fmt: skip

    def table(self) -> list[list[str]]:
        """Return header and rows of a table in datasheet units: a parameter by recording, pooled, and its spread."""
        rows = [["", *self.recordings, "together", "spread"]]
        for number in self.numbers:
            unit = number.pooled.units[0]
            title = number.pooled.name if unit == "1" else f"{number.pooled.name} ({unit})"
            values = ["" if entry is None else _short(entry) for entry in number.entries.values()]
            rows.append([title, *values, _short(number.pooled), spread_text(number)])
        return rows

    def summary(self) -> str:
        """Format the remarks, the parameters of each recording with their spread, and the tests."""
        lines = [line for text in texts(self.remarks) for line in wrap(text, TEXT_WIDTH)]
        if self.numbers:
            lines += ["", *table_with_rule(self.table())]
        lines += ["", *wrap(
            "spread: standard deviation between recordings without estimation errors, with 95 % limits. Test of equal "
            f"parameters: p {p_relation(self.parameter_pvalue)}; of equal curves, without a model: "
            f"p {p_relation(self.model_free_pvalue)}.", TEXT_WIDTH,
        )]  # fmt: skip
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as numbers, lists and strings for JSON."""
        spread = dict(zip(self.deviations.names, np.sqrt(self.deviations.effects.spread2).tolist(), strict=True))
        return {
            **plain_fields(self, "recordings pvalue differs"),
            "parameters": {**plain_fields(self.deviations, "statistic df pvalue"), "spread": spread},
            **plain_fields(self, "model_free_pvalue numbers"),
            "for_filter": {use: str(self.for_filter(use)) for use in get_args(Use)},
            "remarks": plain(self.remarks),
        }


def _percent(share: float) -> str:
    """Format a relative amount in per cent, or as a factor if it is 1 or larger."""
    return f"{round_text(100 * share)} %" if share < 1 else f"a factor of {round_text(1 + share)}"


def short_spread(number: RecordingNumber) -> str:
    """Format the spread of a parameter without its limits."""
    return "" if number.spread is None else f"{round_text(100 * number.spread)} %"


def spread_text(number: RecordingNumber) -> str:
    """Format the spread of a parameter with its limits."""
    if number.spread is None or number.spread_low is None or number.spread_high is None:
        return ""
    low, spread, high = (100 * s for s in (number.spread_low, number.spread, number.spread_high))
    return f"{round_text(spread)} % ({round_text(low)}–{round_text(high)})"


def _short(entry: Entry) -> str:
    value, _, high, _ = entry.in_units("datasheet")
    if entry.upper_only:
        return "" if high is None or not math.isfinite(high) else f"≤ {significant(high, 2)}"
    return significant(value, 3)


CONFIDENCE = 0.95  # confidence level of the limits of the spread, and of the prediction for a further recording


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
    """Return a Gauss-Newton step from the pooled fit; in a new fit, a slow GM term can become fast."""
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
