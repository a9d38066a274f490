"""Summary of a fit as text and HTML, with estimates, intervals and units, the goodness-of-fit test, and remarks."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from gmwm.base.documents import plain
from gmwm.base.errors import GmwmError, MissingTheoryError, ModelError
from gmwm.base.remarks import Dialect, Remark, texts
from gmwm.base.text import align, gap_text, html_table
from gmwm.fitting.estimation.bootstrap import DRAWS, LEAST_FOR_TEST, as_draws, bootstrap, least_draws
from gmwm.fitting.estimation.goodness import GoodnessOfFit, goodness_of_fit
from gmwm.fitting.estimation.intervals import Interval, Method, confidence_intervals
from gmwm.recording.options import as_confidence
from gmwm.theory.processes.validation import as_seed

if TYPE_CHECKING:
    from gmwm.fitting.estimation.result import Fit
    from gmwm.fitting.likelihood.result import LikelihoodFit


@dataclass(frozen=True)
class IntervalMethod:
    """Confidence level, and method of intervals and tests: theory, or a bootstrap of `draws` recordings."""

    level: float = 0.95
    method: Method = "asymptotic"
    draws: int = DRAWS
    seed: int = 0

    def __post_init__(self) -> None:
        as_confidence(self.level, "level")
        if self.method == "bootstrap":
            as_draws(self.draws, self.least_draws, f"a test at 5 % with intervals of {100 * self.level:g} %")

    @property
    def least_draws(self) -> int:
        """Smallest number of simulated recordings for intervals of this level and a test at the 5 % level."""
        return max(LEAST_FOR_TEST, least_draws(self.level))


@dataclass(frozen=True)
class ParameterRow:
    """Texts of one row of a table of parameters."""

    name: str
    estimate: str
    interval: str
    error: str
    unit: str


def intervals_if_known(fit: Fit, how: IntervalMethod) -> tuple[dict[str, Interval], Remark | None]:
    """Return the confidence intervals and None, or no intervals and a remark with the reason why there are none."""
    try:
        return confidence_intervals(fit, how.level, how.method, draws=how.draws, rng=how.seed), None
    except (MissingTheoryError, ModelError) as error:
        return {}, no_intervals(error)


def test_in_words(fit: Fit, how: IntervalMethod) -> tuple[GoodnessOfFit | None, str]:
    """Return the goodness-of-fit test and its summary, or None and a text with the reason why there is no test."""
    try:
        test = goodness_of_fit(fit, how.method, draws=how.draws, rng=how.seed)
    except (MissingTheoryError, ModelError) as error:
        return None, f"not tested: {error.reason}"
    return test, test.summary()


def inference(fit: Fit, how: IntervalMethod) -> dict[str, Any]:
    """Return intervals, standard errors and test for JSON, with None for infinite or missing ones."""
    intervals, _ = intervals_if_known(fit, how)
    test, _ = test_in_words(fit, how)
    errors = standard_errors(fit, how) if intervals else {}
    numbers = {"confidence": how.level, "method": how.method, "confidence_intervals": intervals}
    document: dict[str, Any] = plain(numbers | {"standard_errors": errors, "goodness_of_fit": test})
    return document


def standard_errors(fit: Fit, how: IntervalMethod) -> dict[str, float]:
    """Return the standard error of each parameter, by theory or from the bootstrap."""
    return bootstrap(fit, how.draws, how.seed).errors if how.method == "bootstrap" else fit.standard_errors


def rows(fit: Fit, intervals: dict[str, Interval], how: IntervalMethod) -> list[ParameterRow]:
    """Return one row of texts for each parameter of a fit, in the order of the terms."""
    return rows_of(fit, intervals, standard_errors(fit, how) if intervals else {}, fit.undetermined)


def rows_of(
    fit: Fit | LikelihoodFit, intervals: Mapping[str, Interval], errors: Mapping[str, float], unknown: Collection[str]
) -> list[ParameterRow]:
    """Return one row of texts for each parameter; the data do not determine the parameters `unknown`."""
    units, table = fit.units(), []
    for name, value in fit.parameters.items():
        if name in unknown:
            table.append(ParameterRow(name, "undetermined", interval="", error="", unit=units[name]))
            continue
        interval, error = "", ""
        if name in fit.model.fixed_names:
            interval = "fixed"
        elif name in intervals:
            interval = interval_text(*intervals[name])
            if math.isfinite(share := errors.get(name, math.inf) / abs(value) if value else math.inf):
                error = f"{100 * share:.2g} %" if share < 1 else f"{100 * share:.0f} %"
        table.append(ParameterRow(name, estimate_text(value), interval=interval, error=error, unit=units[name]))
    return table


def no_intervals(error: GmwmError) -> Remark:
    """Return the remark that there are no confidence intervals, with the reason."""
    return Remark.of("no-intervals", reason=error.reason)


def without_axis(*remarks: Remark | None) -> list[Remark]:
    """Return the remarks without their axis, for a summary whose heading names the axis; None is left out."""
    return [remark.about("") for remark in remarks if remark is not None]


def short_values(fit: Fit, how: IntervalMethod) -> dict[str, str]:
    """Return a short text for each parameter; see `short_texts`."""
    intervals, _ = intervals_if_known(fit, how)
    return short_texts(fit, rows(fit, intervals, how), intervals, fit.undetermined)


def short_texts(
    fit: Fit | LikelihoodFit, table: list[ParameterRow], intervals: Mapping[str, Interval], unknown: Collection[str]
) -> dict[str, str]:
    """Return the estimate of each parameter with its relative standard error, an upper limit, or how its term acts."""
    words = {}
    for row in table:
        low, high = intervals.get(row.name, (0.0, math.inf))
        acting = fit.diagnostics.acts_as.get(row.name.rpartition(".")[0])
        if row.name in unknown:
            words[row.name] = "—"
        elif acting is not None:
            words[row.name] = "fixed" if row.name in fit.model.fixed_names else f"as {acting}"
        elif math.isfinite(high) and low in (0.0, -high):
            words[row.name] = f"≤ {high:.2e}"
        else:
            value = fit.parameters[row.name]
            words[row.name] = (f"{value:.2e}" if value else "0") + (f" ± {row.error}" if row.error else "")
    return words


def estimate_text(value: float) -> str:
    """Format an estimate with four digits."""
    return f"{value:.3e}" if value else "0"


def interval_text(low: float, high: float) -> str:
    """Format an interval as a range, as an upper limit, or as "not determined"."""
    if not math.isfinite(high):
        return "not determined"
    if low == 0:
        return f"at most {high:.3e}"
    if low == -high:
        return f"at most ±{high:.3e}"
    return f"{low:.3e} … {high:.3e}"


def summary(
    fit: Fit, level: float = 0.95, method: Method = "asymptotic", *, draws: int = DRAWS,
    rng: int | np.random.Generator = 0,
) -> str:  # fmt: skip
    """Describe the fit in text.

    Parameters
    ----------
    level : float
        Confidence level of the intervals, between 0 and 1.
    method : "asymptotic" or "bootstrap"
        Source of the intervals and the test: theory, or `draws` simulated recordings.
    draws, rng
        The same as for `Fit.bootstrap`.

    Returns
    -------
    str
        Text with the model, the data, the objective with its bounds, the goodness-of-fit test, a table of the
        parameters, the regression on conditions, and the remarks. Raises OptionError if an option is unknown or out of
        range.
    """
    how = IntervalMethod(level, method, draws, as_seed(rng))
    intervals, missing = intervals_if_known(fit, how)
    table = rows(fit, intervals, how)
    lines = [*head(fit, how), "", *table_text(table, level)]
    lines += [] if fit.regression is None else ["", fit.regression.summary()]
    words = texts(without_axis(missing, *fit.diagnostics.remarks))
    return "\n".join([*lines, "", *words] if words else lines)


def table_text(table: list[ParameterRow], level: float) -> list[str]:
    """Format the rows of parameters as aligned columns with a header."""
    heads = ParameterRow("parameter", "estimate", interval=f"{100 * level:g} % interval", error="error", unit="unit")
    return align([astuple(row) for row in (heads, *table)], right={1, 2, 3})


def head(fit: Fit, how: IntervalMethod) -> list[str]:
    """Return the first lines of a summary, with the model, the data, the objective with its bounds, and the test."""
    wv = fit.wavelet_variance
    start = fit.diagnostics.start
    certificate = "not certified (certify=False)"
    if start is not None and start.how != "convex":
        certificate = f"no proof; {start.in_words}"
    if fit.gap is not None:
        # Largest gap of a global optimum in words, 10 times `certified_gap`, which the limit of nodes may exceed.
        proven = fit.gap <= 1e-3 and (start is None or start.how != "sampled")
        claim = "global optimum" if proven else "best found"
        claim += " given the fixed values" if fit.model.fixed_names else ""
        certificate = f"{claim}, no other fit is lower by more than {gap_text(fit.gap)}"
        if start is not None and start.how == "sampled":
            certificate += f"; {start.in_words}"
    _, words = test_in_words(fit, how)
    return [
        f"{fit.model.structure}{' of ' + wv.axis if wv.axis else ''}",
        f"{wv.extent}, {wv.levels_text}, "
        f"{f'robust, efficiency {wv.efficiency:g}, ' if wv.robust else ''}weighting {fit.weighting}",
        f"objective {fit.objective:.6g}: {certificate}",
        *([f"objective with any number of terms: at least {fit.relaxed_bound:.6g}"] if fit.relaxed_bound > 0 else []),
        f"goodness of fit: {words}",
    ]


def as_html(fit: Fit) -> str:
    """Return the summary as HTML with a table of the parameters, for notebooks."""
    how = IntervalMethod()
    intervals, missing = intervals_if_known(fit, how)
    words = texts(without_axis(missing, *fit.diagnostics.remarks), Dialect.HTML)
    return table_html(head(fit, how), rows(fit, intervals, how), words)


def table_html(head: Sequence[str], rows: Iterable[ParameterRow], words: Iterable[str]) -> str:
    """Return HTML with a title and facts, a table of parameters with 95 % intervals, and remarks (HTML already)."""
    cells = ((row.name, row.estimate, row.interval, row.error, row.unit) for row in rows)
    names = ("parameter", "estimate", "95 % interval", "error", "unit")
    title, *lines = head
    facts = "\n".join(lines).splitlines()
    return (
        f"<div><b>{escape(title)}</b>{''.join(f'<br>{escape(fact)}' for fact in facts)}"
        f"{html_table(names, cells)}{''.join(f'<p>{text}</p>' for text in words)}</div>"
    )
