"""Confidence intervals of a maximum-likelihood fit, and its table of results."""

from __future__ import annotations

import math
from collections.abc import Mapping
from statistics import NormalDist
from typing import Any, Literal, get_args

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.documents import plain
from gmwm.base.errors import ModelError, OptionError
from gmwm.base.remarks import Dialect, Remark, texts
from gmwm.base.text import counted, p_relation
from gmwm.fitting.estimation.intervals import Interval, about, parameters_by_name
from gmwm.fitting.estimation.summary import (
    ParameterRow,
    no_intervals,
    rows_of,
    short_texts,
    table_html,
    table_text,
    without_axis,
)
from gmwm.fitting.likelihood.estimator import invert, jacobian
from gmwm.fitting.likelihood.innovations import Residuals
from gmwm.fitting.likelihood.problem import LikelihoodProblem
from gmwm.fitting.likelihood.result import LikelihoodFit
from gmwm.fitting.likelihood.search import LikelihoodSearch
from gmwm.recording.options import as_confidence, one_of
from gmwm.theory.processes.parameter import Parameter

Method = Literal["wald", "profile"]
_ROUNDS = 25
"""Limit of iterations per end, needed if other parameters diverge along the profile:
test_a_profile_ends_where_the_other_parameters_run_away in tests/likelihood/test_fit_ml.py."""


def confidence_intervals(fit: LikelihoodFit, level: float = 0.95, method: Method = "wald") -> dict[str, Interval]:
    """Compute a confidence interval for every estimated parameter; see `LikelihoodFit.confidence_intervals`."""
    z = NormalDist().inv_cdf((1 + as_confidence(level, "level")) / 2)
    one_of(method, "method", get_args(Method))
    errors, parameters = fit.standard_errors, parameters_by_name(fit.model)
    profile = _ProfileLikelihood(fit, z)
    intervals: dict[str, Interval] = {}
    for name, parameter in parameters.items():
        if name in fit.model.fixed_names:
            continue
        value, error = fit.parameters[name], errors.get(name)
        term = name.rpartition(".")[0]
        process = fit.model.by_term[term]
        scale = parameter.scale_power is not None and parameter.domain == "positive"
        weak = scale and (error is None or z * (parameter.scale_power or 1.0) * error >= value)
        gone = term in fit.diagnostics.not_supported
        if gone and (not scale or not process.shape_is_fixed):
            intervals[name] = _domain(parameter)
        elif (method == "profile" or (weak and process.shape_is_fixed)) and profile.has(name):
            intervals[name] = profile.interval(name, parameter)
        elif error is None or not math.isfinite(error):
            intervals[name] = _domain(parameter)
        else:
            intervals[name] = about(parameter, value, z * error)
    return intervals


def _domain(parameter: Parameter) -> Interval:
    if parameter.domain == "between":
        return parameter.limits
    return (0.0, math.inf) if parameter.domain == "positive" else (-math.inf, math.inf)


class _ProfileLikelihood:
    """The profile likelihood: the likelihood as a function of one parameter, maximised over all others."""

    def __init__(self, fit: LikelihoodFit, z: float) -> None:
        self.fit, self.z = fit, z

    def has(self, name: str) -> bool:
        """Return whether a parameter depends on one coordinate; ModelError for a fit without recording."""
        if self.fit.record is None:
            raise ModelError(
                f"the profile interval of {name} needs the recording, and the fit was read from a file",
                advice="Fit the model to the recording again.",
            )
        problem = LikelihoodProblem(self.fit.model, self.fit.record, self.fit.mean)
        if not problem.coordinates:
            return False
        self.problem = problem
        row = self._row(name)
        return row is not None and np.count_nonzero(row) == 1

    def interval(self, name: str, parameter: Parameter) -> Interval:
        """Return the interval at whose ends the square root of the deviance is z."""
        row = self._row(name)
        assert row is not None
        k = int(np.flatnonzero(row)[0])
        low = self._end(k, name, -1)
        high = self._end(k, name, 1)
        least, most = _domain(parameter)
        return (least if low is None else low, most if high is None else high)

    def _row(self, name: str) -> Vector | None:
        # The derivative with respect to a scale is zero if the scale is zero, so its coordinate is found by name.
        for k, c in enumerate(self.problem.coordinates):
            scale = self.fit.model.processes[c.term].scale_parameter().name
            if c.shape is None and f"{self.fit.model.terms[c.term]}.{scale}" == name:
                row = np.zeros(len(self.problem.coordinates))
                row[k] = 1.0
                return row
        return jacobian(self.problem, self.fit.model).get(name)

    def _end(self, k: int, name: str, side: int) -> float | None:
        """Return the value at which the profile is z²/2 below its maximum on one side, if any."""
        best = self.problem.at(self.fit.model)
        low, high = self.problem.bounds[k]
        if self.problem.coordinates[k].shape is None and side < 0:
            at = best.copy()
            at[k] = -math.inf
            if best[k] == -math.inf or self._root(at, k)[0] <= self.z:
                return None
        if best[k] == -math.inf:
            return self._limit_from_zero(k, name, best)
        along = self._along(best, k)
        step = side * self.z * min(max(self.reach, 1e-6), 3.0)
        inner, outer = (0.0, 0.0), None
        for _ in range(_ROUNDS):
            step = min(max(best[k] + step, low), high) - best[k]
            root, at = self._root(best + along * step, k)
            # An end with this accuracy has about three correct digits.
            if abs(root - self.z) <= 2e-3 * self.z:
                break
            if root < self.z:
                if best[k] + step in (low, high):
                    return None
                inner = (step, root)
            else:
                outer = (step, root)
            if np.all(np.isfinite(at)) and np.all(np.isfinite(best)):
                along = (at - best) / step  # the other coordinates are extrapolated linearly
            if outer is None:
                step *= min(max(self.z / max(root, 1e-3), 1.1), 3.0)
            else:
                share = (self.z - inner[1]) / (outer[1] - inner[1])
                step = inner[0] + min(max(share, 0.05), 0.95) * (outer[0] - inner[0])
        return self._parameter(best[k] + step, k, name)

    def _along(self, best: Vector, k: int) -> Vector:
        """Return the profile's direction I⁻¹e_k / (I⁻¹)_kk at the maximum; `reach` becomes its standard error."""
        gone = {k for k, c in enumerate(self.problem.coordinates) if c.shape is None and best[k] == -math.inf}
        terms = {self.problem.coordinates[i].term for i in gone}
        active = [i for i, c in enumerate(self.problem.coordinates) if c.term not in terms]
        evaluation, along = self.problem.evaluate(best, active), np.zeros(best.size)
        along[k], self.reach = 1.0, 1.0
        if evaluation is None:
            return along
        column = invert(evaluation.information)[:, active.index(k)]
        if np.all(np.isfinite(column)):
            along[active] = column / column[active.index(k)]
            self.reach = math.sqrt(column[active.index(k)])
        return along

    def _limit_from_zero(self, k: int, name: str, best: Vector) -> float | None:
        """Return the scale of a term that is zero at the maximum at which the profile is z²/2 below it."""
        at = best.copy()
        at[k] = self.problem.faint(best, k, self.fit.model, 1e-3)
        evaluation = self.problem.evaluate(at, [k])
        if evaluation is None:
            return None
        # For a small scale s the log-likelihood falls by c s + ½ k s², and the optimised profile by less.
        size = math.exp(at[k])
        c, curvature = max(-float(evaluation.gradient[0]) / size, 0.0), float(evaluation.information[0, 0]) / size**2
        coordinate = math.log((math.sqrt(c * c + curvature * self.z**2) - c) / curvature)
        before, power = None, 1.5
        for _ in range(_ROUNDS):
            at[k] = coordinate
            root, at = self._root(at, k)
            # A limit with this accuracy has about two correct digits.
            if abs(root - self.z) <= 1e-2 * self.z:
                break
            here = (coordinate, math.log(max(root, 1e-6)))
            if before is not None and here[0] != before[0]:
                power = min(max(2 * (here[1] - before[1]) / (here[0] - before[0]), 0.3), 3.0)
            before = here
            coordinate += min(max(2 * (math.log(self.z) - here[1]) / power, -3.0), 3.0)
        return self._parameter(coordinate, k, name)

    def _root(self, z: Vector, k: int) -> tuple[float, Vector]:
        """Return the root of twice the fall of the profile log-likelihood, and the maximum at this coordinate k."""
        # At the ends of a 95 % interval, the profile is about 2 below its maximum.
        maximum = LikelihoodSearch(self.problem, held=(k,), tolerance=1e-3, revive=False).run(z)
        if maximum is None:
            return math.inf, z
        return math.sqrt(max(2.0 * (self.fit.loglikelihood - maximum.evaluation.value), 0.0)), maximum.z

    def _parameter(self, coordinate: float, k: int, name: str) -> float:
        at = self.problem.at(self.fit.model)
        at[k] = coordinate
        value = self.problem.at_point(at).parameters[name]
        assert value is not None
        return value


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
    numbers = {"confidence": level, "confidence_intervals": intervals, "standard_errors": fit.standard_errors}
    document: dict[str, Any] = plain(numbers)
    return document


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
