"""The recordings of a pooled fit, compared with each other."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from textwrap import wrap
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from gmwm._tables import headed
from gmwm._text import Summarised, listed, rounded
from gmwm.datasheets import Entry
from gmwm.datasheets.entry import significant
from gmwm.estimation.recordings import Deviations, stepped
from gmwm.estimation.result import Fit
from gmwm.inference.intervals import parameters_by_name
from gmwm.joint.same_result import LevelRatio
from gmwm.multiple_tests import holm
from gmwm.options import as_confidence, one_of
from gmwm.processes.model import Model
from gmwm.random_effects import predicted
from gmwm.remarks import Remark, texts

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure

WIDTH = 80
SIZE = 0.05
"""Level of the test that the recordings of an axis are equal (docs/validation/recordings.md)."""
MAIN = ("N", "B", "K", "Q")
"""The numbers that a remark names; tables have all of them."""
Use = Literal["mean", "high"]
"""Which noise a filter assumes: the mean over recordings, or the highest that a further recording may have."""


@dataclass(frozen=True, kw_only=True)
class RecordingNumber:
    """One number of a datasheet in each of several recordings, and its spread.

    Attributes
    ----------
    symbol, title, unit : str
        Symbol, name and SI unit.
    pooled : Entry
        The number of all recordings together. Its confidence interval includes the spread.
    entries : mapping of recording to (Entry or None)
        The number of each recording alone, with the same model; None if the recording is too short for it.
    spread, spread_low, spread_high : float or None
        Standard deviation of its logarithm between recordings, without estimation errors, and its confidence limits:
        0.1 is 10 %. None if fewer than two recordings have a value.
    predicted_low, predicted_high : float or None
        Prediction limits for a further recording.
    """

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
        """Ratio of the largest to the smallest value, minus 1; None if a recording has only a limit."""
        known = [entry.value for entry in self.entries.values() if entry is not None and not entry.upper_only]
        return max(known) / min(known) - 1 if len(known) == len(self.entries) and min(known) > 0 else None

    def to_dict(self) -> dict[str, Any]:
        """The number as numbers, lists and strings, ready for JSON."""
        entries = {name: None if entry is None else entry.to_dict() for name, entry in self.entries.items()}
        names = ("spread", "spread_low", "spread_high", "predicted_low", "predicted_high")
        return {
            "symbol": self.symbol, "title": self.title, "unit": self.unit, "pooled": self.pooled.to_dict(),
            "recordings": entries, "apart": self.apart, **{name: getattr(self, name) for name in names},
        }  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Replicates(Summarised):
    """Several recordings of one unit, compared with the fit to all of them.

    Attributes
    ----------
    fit : Fit
        The fit to the mean of their curves.
    deviations : gmwm.estimation.recordings.Deviations
        The deviation of the parameters of each recording, with their covariances, and the test of equal parameters.
    fits : mapping of recording to Fit
        The fit to each recording alone, one step from the pooled fit.
    numbers : tuple of RecordingNumber
        The numbers of the datasheet with their spread, without the ramp R, which belongs to one recording.
    levels : tuple of LevelRatio
        The deviation of each recording over the mean of the others at each level, with the p-value of each test alone.
    """

    fit: Fit
    deviations: Deviations
    fits: Mapping[str, Fit]
    numbers: tuple[RecordingNumber, ...]
    levels: tuple[LevelRatio, ...]

    @property
    def recordings(self) -> tuple[str, ...]:
        """Names of the recordings."""
        return self.deviations.recordings

    @property
    def axis(self) -> str:
        """Name of the axis."""
        return self.fit.wavelet_variance.axis

    def __getitem__(self, symbol: str) -> RecordingNumber:
        """The number with a symbol, such as "N"."""
        for number in self.numbers:
            if number.symbol == symbol:
                return number
        raise KeyError(f"{symbol}; there are {', '.join(number.symbol for number in self.numbers)}")

    @property
    def spread(self) -> dict[str, float]:
        """The spread of each number that at least two recordings have: standard deviation of its logarithm."""
        return {number.symbol: number.spread for number in self.numbers if number.spread is not None}

    @property
    def parameter_pvalue(self) -> float:
        """p-value of the test that all recordings have the same parameters; it is only valid if the model is right."""
        return self.deviations.pvalue

    @cached_property
    def model_free_pvalue(self) -> float:
        """p-value of the test that all recordings have the same wavelet variances, without a model."""
        found = holm([math.nan if row.pvalue is None else row.pvalue for row in self.levels])
        known = found[np.isfinite(found)]
        return float(known.min()) if known.size else 1.0

    @property
    def pvalue(self) -> float:
        """p-value of both tests together: twice the smaller one, at most 1."""
        return min(1.0, 2 * min(self.parameter_pvalue, self.model_free_pvalue))

    @property
    def differs(self) -> bool:
        """Whether the recordings differ, at the 5 % level."""
        return self.pvalue <= SIZE

    def for_filter(self, use: Use = "mean", confidence: float = 0.95) -> Model:
        """The model with the values for a filter that will run on further recordings.

        If the gains of a filter are fixed, its error covariance is linear in the covariance of the noise. Over
        recordings, the filter with the mean noise therefore has the smallest mean error. With the highest noise, it is
        rarely too confident.

        Parameters
        ----------
        use : "mean" or "high"
            The mean over the recordings, weighted by 1/(spread² + error²); or the upper end of the prediction interval
            of a further recording for each variance, and the mean of correlation times.
        confidence : float
            Level of the prediction interval, from 0.5 to below 1. With two or three recordings, it is wide.

        Returns
        -------
        Model

        Raises
        ------
        OptionError
            If `use` or `confidence` is not allowed.
        """
        one_of(use, "use", get_args(Use))
        as_confidence(confidence)
        found = self.deviations
        _, high = predicted(found.values.T, found.variances.T, confidence)
        parameters = parameters_by_name(self.fit.model)
        values: dict[str, float] = {}
        for name, mean, end in zip(found.names, found.effects.mean, high, strict=True):
            raised = use == "high" and parameters[name].scale_power is not None and math.isfinite(end)
            share = float(end if raised else mean)
            if math.isfinite(share):
                values[name] = stepped(parameters[name], self.fit.parameters[name], share)
        return self.fit.model.with_values(values)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Whether the recordings agree."""
        return (self.remark(self.pvalue),)

    def remark(self, pvalue: float) -> Remark:
        """Return the remark for a p-value.

        Parameters
        ----------
        pvalue : float
            The p-value of the test that the recordings are equal, possibly adjusted for the number of axes.
        """
        few = "yes" if len(self.recordings) < FEW else "no"
        if pvalue > SIZE:
            return Remark.of(
                "recordings-agree", self.axis, count=len(self.recordings), numbers=self._within(), p=p_text(pvalue),
                few=few, size=SIZE,
            )  # fmt: skip
        return Remark.of(
            "recordings-differ", self.axis, count=len(self.recordings), numbers=self._spreads(), p=p_text(pvalue),
            few=few, size=SIZE,
        )  # fmt: skip

    def _within(self) -> str:
        known = [(one.symbol, one.apart) for one in self.numbers if one.symbol in MAIN and one.apart is not None]
        return listed([f"{symbol} within {_percent(apart)}" for symbol, apart in known]) or "no number has a value"

    def _spreads(self) -> str:
        known = [(one.symbol, one.spread) for one in self.numbers if one.symbol in MAIN and one.spread]
        return listed([f"{symbol} by {_percent(spread)}" for symbol, spread in known]) or "only the curves"

    def table(self) -> list[list[str]]:
        """Header and rows: each number in each recording and in all together, and its spread, in datasheet units."""
        rows = [["", *self.recordings, "together", "spread"]]
        for number in self.numbers:
            unit = number.pooled.units[0]
            title = number.symbol if unit == "1" else f"{number.symbol} ({unit})"
            values = ["" if entry is None else _short(entry) for entry in number.entries.values()]
            rows.append([title, *values, _short(number.pooled), spread_text(number)])
        return rows

    def summary(self) -> str:
        """Format the remarks, the numbers of each recording with their spread, and the tests."""
        lines = [line for text in texts(self.remarks) for line in wrap(text, WIDTH)]
        if self.numbers:
            lines += ["", *headed(self.table())]
        lines += ["", *wrap(
            "spread: standard deviation between recordings without estimation errors, with 95 % limits. Test of equal "
            f"parameters: {p_text(self.parameter_pvalue)}; of equal curves, without a model: "
            f"{p_text(self.model_free_pvalue)}.", WIDTH,
        )]  # fmt: skip
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """The comparison as numbers, lists and strings, ready for JSON."""
        found = self.deviations
        return {
            "recordings": list(self.recordings),
            "pvalue": self.pvalue,
            "differs": self.differs,
            "parameters": {
                "statistic": found.statistic,
                "df": found.df,
                "pvalue": found.pvalue,
                "spread": dict(zip(found.names, np.sqrt(found.effects.spread2).tolist(), strict=True)),
            },
            "model_free_pvalue": self.model_free_pvalue,
            "numbers": [number.to_dict() for number in self.numbers],
            "for_filter": {use: str(self.for_filter(use)) for use in get_args(Use)},
            "remarks": [remark.to_dict() for remark in self.remarks],
        }

    def plot(self, *, path: str | os.PathLike[str] | None = None) -> MatplotlibFigure:
        """Draw the ratio of the wavelet deviation of each recording to the deviation of all recordings, minus 1, with
        its sampling scatter.

        Parameters
        ----------
        path : path, optional
            File to write the picture to, ending in .png, .pdf or .svg.
        """
        from gmwm.plots.recordings import plot_recordings

        return plot_recordings(self, path=path)

    def __repr__(self) -> str:
        found = "different" if self.differs else "equal"
        return f"Replicates({', '.join(self.recordings)}: {found}, p = {self.pvalue:.2g})"


FEW = 4
"""Recordings below which an interval is hardly narrower than that of one recording alone, because the spread is hardly
known (docs/validation/recordings.md)."""


def p_text(pvalue: float) -> str:
    """A p-value with its sign.

    >>> p_text(0.234), p_text(1e-9)
    ('p = 0.23', 'p < 0.001')
    """
    return f"p = {pvalue:.2g}" if pvalue >= 0.001 else "p < 0.001"


def _percent(share: float) -> str:
    """A small relative amount in per cent; a large one as a factor."""
    return f"{rounded(100 * share)} %" if share < 1 else f"a factor of {rounded(1 + share)}"


def short_spread(number: RecordingNumber) -> str:
    """The spread of a number, without its limits."""
    return "" if number.spread is None else f"{rounded(100 * number.spread)} %"


def spread_text(number: RecordingNumber) -> str:
    """The spread of a number with its limits."""
    if number.spread is None or number.spread_low is None or number.spread_high is None:
        return ""
    low, spread, high = (100 * s for s in (number.spread_low, number.spread, number.spread_high))
    return f"{rounded(spread)} % ({rounded(low)}–{rounded(high)})"


def _short(entry: Entry) -> str:
    value, _, high, _ = entry.in_units("datasheet")
    if entry.upper_only:
        return "" if high is None or not math.isfinite(high) else f"≤ {significant(high, 2)}"
    return significant(value, 3)
