"""Maximum-likelihood fits for the output of commands: fit, compute intervals, and format as JSON or tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gmwm.base.remarks import Dialect, Remark, texts
from gmwm.base.text import p_text

if TYPE_CHECKING:
    from gmwm.base.arrays import Vector
    from gmwm.fitting.estimation.intervals import Interval
    from gmwm.fitting.estimation.result import Fit
    from gmwm.fitting.likelihood import LikelihoodFit, Residuals
    from gmwm.measuring.regression.against import Asked
    from gmwm.measuring.regression.result import Regression
    from gmwm.recording.signals import Signal
    from gmwm.theory.processes.model import Model

LIKELIHOOD = ("--likelihood", "--ml")
"""Names of the option for a maximum-likelihood fit, in every command that has this option."""


@dataclass(frozen=True, eq=False)
class LikelihoodResult:
    """A maximum-likelihood fit with its residuals and its confidence intervals. If there are no intervals, `missing` is
    a remark with the reason."""

    fit: LikelihoodFit
    level: float
    intervals: Mapping[str, Interval]
    missing: Remark | None
    residuals: Residuals


def likelihood_fits(
    fits: Mapping[str, Fit], signals: Mapping[str, Signal], given: Model | None = None,
    asked: Mapping[str, Asked | None] | None = None,
) -> dict[str, LikelihoodFit]:  # fmt: skip
    """Fit each axis by maximum likelihood, in parallel, from its wavelet fit or from the model `given` with all values.
    `asked` has the regression to include in the likelihood of each axis."""
    complete = given if given is not None and given.is_complete else None
    from gmwm import fit_ml
    from gmwm.base.threads import in_threads
    from gmwm.cli.output import progress

    with progress("maximum likelihood", len(fits)) as advance:

        def carried_on(axis: str, start: Fit) -> LikelihoodFit:
            label = f"maximum likelihood: {axis}"
            return fit_ml(
                start.model, signals[axis], start=complete or start, against=(asked or {}).get(axis),
                progress=lambda count, value: advance(f"{label}, evaluation {count}, {value:.2f}", 0),
            )  # fmt: skip

        return in_threads(carried_on, fits, done=lambda axis: advance(f"maximum likelihood: {axis}"))


def asked_again(regression: Regression | None, temperature: Vector | None) -> Asked | None:
    """Return the regression of a wavelet fit in the form that `fit_ml` takes as `against`; None without one."""
    from gmwm.measuring.regression.against import TEMPERATURE, Asked

    if regression is None:
        return None
    return Asked(regression.basis.terms, {} if temperature is None else {TEMPERATURE: temperature})


def judge_fits(fits: Mapping[str, LikelihoodFit], level: float) -> dict[str, LikelihoodResult]:
    """Compute the confidence intervals and residuals of each fit, in parallel."""
    from gmwm.base.threads import in_threads
    from gmwm.cli.output import progress
    from gmwm.fitting.likelihood.summary import intervals_if_known, own_residuals

    def one(_: str, fit: LikelihoodFit) -> LikelihoodResult:
        intervals, missing = intervals_if_known(fit, level)
        residuals = own_residuals(fit)
        assert residuals is not None  # the fit was made in this run, so it has the samples
        return LikelihoodResult(fit, level, intervals=intervals, missing=missing, residuals=residuals)

    what = "intervals of the likelihood"
    with progress(what, len(fits)) as advance:
        return in_threads(one, fits, done=lambda axis: advance(f"{what}: {axis}"))


def as_dict(found: LikelihoodResult) -> dict[str, Any]:
    """Return a fit with its intervals and tests as plain values for JSON."""
    from gmwm.fitting.likelihood.summary import inference

    return {
        **found.fit.to_dict(),
        **inference(found.fit, found.level, found.intervals),
        "residuals": found.residuals.to_dict(),
    }


def likelihoods_text(found: Mapping[str, LikelihoodResult]) -> str:
    """Format the summary of one fit, or for several axes a table for each sensor with its axes side by side."""
    from gmwm.base.axis_names import by_sensor
    from gmwm.fitting.likelihood.summary import in_words

    if len(found) == 1:
        judged_fit = next(iter(found.values()))
        return in_words(
            judged_fit.fit, judged_fit.level, intervals=judged_fit.intervals, residuals=judged_fit.residuals,
            missing=judged_fit.missing,
        )  # fmt: skip
    first = next(iter(found.values()))
    sensors = by_sensor(found)
    parts = [
        f"Fit by maximum likelihood: {first.fit.samples} samples at {first.fit.rate:g} Hz",
        *map(_sensor_text, sensors.values()),
        "p: p-values of the tests that the residuals are white (Ljung-Box) and normal\n(Jarque-Bera).",
    ]
    remarks = [
        remark.about(name)
        for name, judged_fit in found.items()
        for remark in (judged_fit.missing, *judged_fit.fit.remarks)
        if remark is not None
    ]
    return "\n\n".join([*parts, *(["\n".join(texts(remarks, Dialect.SHELL))] if remarks else [])])


def _sensor_text(group: Mapping[str, LikelihoodResult]) -> str:
    from gmwm.cli.output import table_text, units_text
    from gmwm.fitting.likelihood.summary import short_values

    first = next(iter(group.values())).fit
    values = [short_values(judged_fit.fit, judged_fit.intervals) for judged_fit in group.values()]
    rows = [[name, *(shown[name] for shown in values)] for name in first.parameters]
    last = len(rows) - 1
    rows += [
        ["log-likelihood", *(f"{judged_fit.fit.loglikelihood:.3f}" for judged_fit in group.values())],
        ["AIC", *(f"{judged_fit.fit.aic:.2f}" for judged_fit in group.values())],
        ["BIC", *(f"{judged_fit.fit.bic:.2f}" for judged_fit in group.values())],
        ["Ljung-Box, p", *(p_text(judged_fit.residuals.ljung_box().p_value) for judged_fit in group.values())],
        ["Jarque-Bera, p", *(p_text(judged_fit.residuals.normality().p_value) for judged_fit in group.values())],
    ]
    return f"{table_text(['parameter', *group], rows, rules=[last])}\n{units_text(first.units())}"
