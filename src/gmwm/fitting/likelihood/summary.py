"""Summary of a maximum-likelihood fit in text and HTML."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from gmwm.base.errors import ModelError, OptionError
from gmwm.base.remarks import Dialect, Remark, texts
from gmwm.base.text import counted, p_relation
from gmwm.fitting.estimation.intervals import Interval
from gmwm.fitting.estimation.summary import (
    ParameterRow,
    no_intervals,
    rows_of,
    short_texts,
    table_html,
    table_text,
    without_axis,
)  # fmt: skip
from gmwm.fitting.likelihood.intervals import Method, confidence_intervals

if TYPE_CHECKING:
    from gmwm.fitting.likelihood.innovations import Residuals
    from gmwm.fitting.likelihood.result import LikelihoodFit


def summary(fit: LikelihoodFit, level: float = 0.95, method: Method = "wald") -> str:
    """Return the text of `LikelihoodFit.summary`."""
    intervals, missing = intervals_if_known(fit, level, method)
    return in_words(fit, level, intervals=intervals, residuals=own_residuals(fit), missing=missing)


def in_words(
    fit: LikelihoodFit, level: float, intervals: Mapping[str, Interval], residuals: Residuals | None = None,
    missing: Remark | None = None,
) -> str:  # fmt: skip
    """Write the summary of a fit; the remark `missing` states why there are no intervals."""
    words = texts(without_axis(missing, *fit.remarks))
    lines = [*head(fit, residuals), "", *table_text(rows(fit, intervals), level)]
    return "\n".join([*lines, "", *words] if words else lines)


def as_html(fit: LikelihoodFit) -> str:
    """Return the summary as HTML, with the parameters as a table."""
    intervals, missing = intervals_if_known(fit, 0.95)
    words = texts(without_axis(missing, *fit.remarks), Dialect.HTML)
    return table_html(head(fit, own_residuals(fit)), rows(fit, intervals), words)


def intervals_if_known(
    fit: LikelihoodFit, level: float, method: Method = "wald"
) -> tuple[dict[str, Interval], Remark | None]:
    """Return the confidence intervals and None, or no intervals and a remark with the reason."""
    try:
        return confidence_intervals(fit, level, method), None
    except ModelError as error:
        return {}, no_intervals(error)


def own_residuals(fit: LikelihoodFit) -> Residuals | None:
    """Return the residuals of the recording without the effect of conditions; None if the fit was read from a file."""
    if fit.record is None:
        return None
    record = fit.record if fit.regression is None else fit.record.without(fit.regression.estimates)
    return fit.residuals(record.values)


def inference(fit: LikelihoodFit, level: float, intervals: Mapping[str, Interval]) -> dict[str, Any]:
    """Return confidence intervals and standard errors as numbers for JSON. Infinite values become None."""
    return {
        "confidence": level,
        "confidence_intervals": {
            name: [end if math.isfinite(end) else None for end in interval] for name, interval in intervals.items()
        },
        "standard_errors": {
            name: error if math.isfinite(error) else None for name, error in fit.standard_errors.items()
        },
    }


def head(fit: LikelihoodFit, residuals: Residuals | None = None) -> list[str]:
    """Return the first lines of a summary: model, data, log-likelihood, mean and tests of the residuals."""
    d = fit.diagnostics
    missing = f", {counted(fit.missing, 'sample')} missing" if fit.missing else ""
    duration = (fit.samples + fit.missing) / fit.rate
    lines = [
        f"{fit.model.structure}{' of ' + fit.axis if fit.axis else ''} by maximum likelihood",
        f"{fit.samples} samples at {fit.rate:g} Hz ({duration:g} s){missing}",
        f"log-likelihood {fit.loglikelihood:.6f} ({fit.loglikelihood - d.started_at:+.4g} from the start, "
        f"{counted(d.evaluations, 'evaluation')}), AIC {fit.aic:.2f}, BIC {fit.bic:.2f}",
    ]
    if fit.level is not None:
        lines.append(f"mean {fit.level:.6g} ± {fit.level_error:.2g} {fit.unit}".rstrip())
    if fit.regression is not None:
        lines.append(fit.regression.summary())
    if residuals is not None:
        lines.append(f"residuals: {checks_in_words(residuals)}")
    return lines


def checks_in_words(residuals: Residuals) -> str:
    """Describe the tests of the residuals in one line."""
    normal = f"normality p {p_relation(residuals.normality().p_value)} (Jarque-Bera)"
    try:
        white = residuals.ljung_box()
    except OptionError:  # too few samples for a lag to test
        return normal
    return f"whiteness p {p_relation(white.p_value)} (Ljung-Box, {white.lags} lags); {normal}"


def rows(fit: LikelihoodFit, intervals: Mapping[str, Interval]) -> list[ParameterRow]:
    """Return one row for each parameter of a fit, in the order of the terms."""
    return rows_of(fit, intervals, fit.standard_errors, _undetermined(fit, intervals))


def short_values(fit: LikelihoodFit, intervals: Mapping[str, Interval]) -> dict[str, str]:
    """Return a short text for each parameter of a fit; see `gmwm.estimation.summary.short_texts`."""
    return short_texts(fit, rows(fit, intervals), intervals, _undetermined(fit, intervals))


def _undetermined(fit: LikelihoodFit, intervals: Mapping[str, Interval]) -> list[str]:
    """Return the names of the shape parameters of terms that are estimated as zero."""
    zero = [
        name
        for name, value in fit.parameters.items()
        if name.rpartition(".")[0] in fit.diagnostics.not_supported and name not in fit.model.fixed_names and value
    ]
    return [name for name in zero if intervals.get(name, (0.0, math.inf)) == (0.0, math.inf)]
