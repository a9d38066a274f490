"""Log-likelihood and maximum-likelihood fit of a model: `Model.loglikelihood` and `gmwm.fit_ml`.

Coefficients of conditions (generalised least squares) and the level have a flat prior and are integrated out. This
restricted likelihood (REML) accounts for the degrees of freedom of the columns."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Matrix, Vector, as_rate, as_vector
from gmwm.base.errors import DataError, FitWarning, MissingTheoryError, ModelError
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.reporting import warn
from gmwm.fitting.estimation import Fit, fit
from gmwm.fitting.estimation.goodness import usable_levels
from gmwm.fitting.likelihood.problem import (
    LikelihoodProblem,
    Record,
    RegressionEstimate,
    as_mean,
    as_record,
    nothing_to_chance,
)
from gmwm.fitting.likelihood.result import LikelihoodDiagnostics, LikelihoodFit
from gmwm.fitting.likelihood.search import LikelihoodSearch, Maximum
from gmwm.fitting.likelihood.system import LEVEL, assemble, require_state
from gmwm.measuring.covariance import Design
from gmwm.measuring.covariance.api import variances
from gmwm.measuring.regression.against import Against, Asked
from gmwm.measuring.regression.api import regress, restate
from gmwm.measuring.regression.covariates import Covariates
from gmwm.measuring.regression.result import Regression
from gmwm.recording.signals import Signal
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.ladder import approximation_remarks
from gmwm.theory.processes.model import Model, as_model
from gmwm.theory.processes.validation import require_values


@dataclass(frozen=True, eq=False)
class Regressed:
    """A recording, its conditions, a first regression by wavelet levels, whose estimate of the time constant of a
    warm-up is used in the columns, and the recording for the Kalman filter with these columns."""

    signal: Signal
    covariates: Covariates
    first: Regression
    record: Record

    @classmethod
    def of(cls, data: Signal | ArrayLike, rate: float | None, record: Record, asked: Asked) -> Regressed:
        """Compute the regression columns at every sample; raise errors for covariates that cannot be used."""
        signal = data if isinstance(data, Signal) else Signal(as_vector(data, "data"), as_rate(rate))
        covariates = Covariates.of(asked.terms, dict(asked.arrays or {}), signal)
        first = regress(signal, covariates)
        columns = np.zeros((len(first), record.values.size))
        observed = np.isfinite(record.values)
        for k, unit in enumerate(np.eye(len(first))):
            columns[k, observed] = covariates.effect(unit, first.tau, 0, len(signal))
        # The restricted likelihood must not depend on the unit of a covariate.
        scales = np.std(columns[:, observed], axis=1)
        record = replace(record, columns=columns / scales[:, None], scales=scales, names=tuple(first))
        return cls(signal, covariates, first, record)

    def regression(self, problem: LikelihoodProblem, found: Maximum) -> Regression:
        """Return the regression at a maximum of the likelihood: coefficients, covariance and degrees of freedom."""
        # Step of a coordinate for the derivative that gives the degrees of freedom of standard errors.
        distance = 0.05
        estimates, covariance = self._at(problem, found.z)
        relative = np.zeros((len(estimates) + 1, len(found.active)))
        inverse = np.linalg.inv(covariance)
        for a, k in enumerate(found.active):
            step = np.zeros(found.z.size)
            step[k] = distance
            slope = (self._at(problem, found.z + step)[1] - self._at(problem, found.z - step)[1]) / (2 * distance)
            relative[:-1, a] = np.diag(slope) / np.diag(covariance)
            relative[-1, a] = np.trace(inverse @ slope) / len(estimates)
        information = found.evaluation.information
        spread = np.zeros(len(relative))
        if information.shape == (len(found.active),) * 2:
            spread = np.einsum("ia,ab,ib->i", relative, np.linalg.pinv(information, hermitian=True), relative)
        freedoms = 2 / np.clip(spread, 2e-6, 2.0)
        return restate(
            self.first, self.signal, self.covariates, estimates, covariance=covariance,
            freedoms=tuple(freedoms[:-1].tolist()), freedom=float(freedoms[-1]),
        )  # fmt: skip

    def _at(self, problem: LikelihoodProblem, z: Vector) -> tuple[Vector, np.ndarray]:
        """Return the coefficients (p,) and their covariance (p, p) for the noise model at coordinates z."""
        level = problem.value(problem.at_point(z))[1]
        part, scales = slice(len(level.values) - len(self.first), None), self.record.scales
        return level.values[part] / scales, level.covariance[part, part] / np.outer(scales, scales)


def loglikelihood(
    model: Model | Process | str, data: Signal | ArrayLike, rate: float | None = None, *, mean: float | None = None
) -> float:
    """Compute the exact Gaussian log-likelihood; see `Model.loglikelihood`. The slope of a drift is the model's."""
    terms = as_model(model)
    advice = "Write the values into the model, or fit it by maximum likelihood with {gmwm fit --likelihood}."
    require_values(terms, "the likelihood", advice)
    problem = LikelihoodProblem(terms.held, as_record(data, rate), as_mean(mean))
    value, _ = problem.value(problem.model)
    if not math.isfinite(value):
        raise nothing_to_chance(terms)
    return value


def fit_ml(
    model: Model | Process | str, data: Signal | ArrayLike, rate: float | None = None, *,
    start: Fit | LikelihoodFit | Model | str | None = None, mean: float | None = None, against: Against | Asked = None,
    progress: Callable[[int, float], None] | None = None,
) -> LikelihoodFit:  # fmt: skip
    """Fit a sum of noise processes to a recording by maximum likelihood.

    The fit maximises the exact Gaussian likelihood, see `Model.loglikelihood`. A second pass of the Kalman filter, with
    derivatives, gives its gradient and the information matrix. Fisher scoring finds the local maximum near the starting
    values, which by default come from a fit to the wavelet variance.

    The estimates are efficient if the model is right and the noise is Gaussian. A single outlier can change them by any
    amount. If the model is wrong, the fit mainly describes the fastest process, because most of the information in the
    samples is about this process (docs/validation/likelihood.md).

    Parameters
    ----------
    model : Model, Process or str
        The model to fit. Values in ``fixed(…)`` are not estimated. Every term needs a state-space form.
    data : Signal or (N,) array
        The recording. Gaps of a signal are treated as missing samples; in an array, NaN is a missing sample.
    rate : float, optional
        Sampling rate (Hz) of an array; 1 by default, so that times count samples.
    start : Fit, LikelihoodFit, Model or str, optional
        Starting values, as a fit or a model with the same terms. By default, the model is first fitted to the wavelet
        variance.
    mean : float, optional
        Mean of the recording if it is known. By default it is unknown and integrated out.
    against : str, (N,) array, Signal, or mapping of name to these, optional
        Conditions whose effect is estimated with the noise, by generalised least squares; see `gmwm.fit`. The
        coefficients are integrated out (restricted likelihood); their estimates are in `fit.regression`. Likelihoods
        are comparable only between fits with the same conditions.
    progress : callable, optional
        Called after each evaluation with the number of evaluations and the log-likelihood.

    Returns
    -------
    LikelihoodFit
        Estimates with their covariance, the log-likelihood and remarks.

    Raises
    ------
    ModelError
        If no parameter is free, if `start` has other terms than the model, or if the model predicts a sample exactly.
    MissingTheoryError
        If a term has no state-space form.
    DataError, OptionError
        If the data or an option cannot be used.

    Warns
    -----
    FitWarning
        If the data do not support a term or cannot distinguish it from another process, if the search did not converge,
        or if the model does not describe the wavelet variance of the recording.

    References
    ----------
    Durbin and Koopman (2012), Time Series Analysis by State Space Methods, 2nd ed., chapter 7.

    Examples
    --------
    >>> from gmwm import GM, WN, fit_ml
    >>> x = (GM(beta=2.0, sigma2=4.0) + WN(sigma2=1.0)).simulate(5_000, 100.0, rng=1)
    >>> found = fit_ml("GM + WN", x, rate=100.0)
    >>> low, high = found.confidence_intervals()["WN.sigma2"]
    >>> low < 1.0 < high
    True
    """
    terms, record, mean_value = as_model(model), as_record(data, rate), as_mean(mean)
    for process in terms.processes:
        require_state(process)
    conditions = Asked.of(against)
    regressed = Regressed.of(data, rate, record, conditions) if conditions.terms else None
    if regressed is not None:
        record = regressed.record
    problem = LikelihoodProblem(_starting_model(terms, record, start, regressed), record, mean_value)
    drifts = any(not r.flat for r in problem.regressors)
    if not problem.coordinates and not drifts:
        raise ModelError(
            f"there is nothing to estimate: every parameter of {terms} is fixed",
            advice="Free a parameter by leaving out `fixed(…)`; `Model.loglikelihood` computes the likelihood.",
        )
    assemble(problem.model, problem.rate)
    maximum = LikelihoodSearch(problem, progress=progress).run(problem.start())
    if maximum is None:
        raise nothing_to_chance(problem.model)
    result = _as_fit(problem, maximum)
    if regressed is not None:
        result = replace(result, regression=regressed.regression(problem, maximum))
    if (wrong := misfit(result)) is not None:
        remarks = (*result.diagnostics.remarks, wrong)
        result = replace(result, diagnostics=replace(result.diagnostics, remarks=remarks))
    for remark in result.remarks:
        warn(FitWarning(remark), stacklevel=2)
    return result


def _starting_model(
    wanted: Model, record: Record, start: Fit | LikelihoodFit | Model | str | None, regressed: Regressed | None = None
) -> Model:
    """Return the model with starting values from `start` or, by default, from a fit to the wavelet variance."""
    if regressed is not None:
        record = record.without(regressed.first.estimates)
    if start is None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FitWarning)
            first = fit(wanted, record.signal(), weighting="diagonal", certify=False).model
    else:
        first = start.model if isinstance(start, Fit | LikelihoodFit) else as_model(start, "start")
        if sorted(first.names) != sorted(wanted.names):
            raise ModelError(
                f"start must be the same model as the fitted one, {wanted.structure}; got {first.structure}",
                argument="start",
                got=first.structure,
            )
        missing = [name for name, value in first.parameters.items() if value is None]
        if missing:
            raise ModelError(
                f"start must have a value for every parameter; {', '.join(missing)} has none",
                argument="start",
                got=tuple(missing),
            )
        if first.fixed_names != wanted.fixed_names or any(
            first.parameters[n] != wanted.parameters[n] for n in wanted.fixed_names
        ):
            free = {n: first.parameters[n] for n in wanted.names if n not in wanted.fixed_names}
            first = wanted.with_values(free)
    return first


def _as_fit(problem: LikelihoodProblem, found: Maximum) -> LikelihoodFit:
    """Create a `LikelihoodFit` from a maximum of the likelihood, with the terms in standard order."""
    best = problem.at_point(found.z)
    value, level = problem.value(best)
    drifts = {label: k for k, label in enumerate(level.labels) if not problem.regressors[k].flat}
    for label, k in drifts.items():
        process = best.by_term[label]
        best = best.with_values({f"{label}.{process.scale_parameter().name}": float(level.values[k])})
    names, covariance = _covariance(problem, found, best, level)
    order = best.sorted(problem.rate)
    ordered = {id(p): t for t, p in order.by_term.items()}
    renamed = {t: ordered[id(p)] for t, p in best.by_term.items()}
    labels = [f"{renamed[term]}.{parameter}" for term, _, parameter in (name.rpartition(".") for name in names)]
    places = sorted(range(len(labels)), key=lambda k: order.names.index(labels[k]))
    constant = _level(problem, level, best)
    gone = [c.term for k, c in enumerate(problem.coordinates) if c.shape is None and found.z[k] == -math.inf]
    acts_as = _acts_as(problem, found, best, renamed)
    zero = tuple(sorted(renamed[best.terms[k]] for k in gone))
    diagnostics = LikelihoodDiagnostics(
        acts_as=acts_as, not_supported=zero, evaluations=found.evaluations, converged=found.converged,
        started_at=problem.value(problem.model)[0],
        remarks=tuple(_remarks(order, acts_as, zero, converged=found.converged, problem=problem)),
    )  # fmt: skip
    return LikelihoodFit(
        model=order, parameters={name: v for name, v in order.parameters.items() if v is not None}, loglikelihood=value,
        level=constant[0], level_error=constant[1], mean=problem.mean, samples=problem.record.observed,
        missing=problem.record.values.size - problem.record.observed, rate=problem.rate, unit=problem.record.unit,
        axis=problem.record.axis, names=tuple(labels[k] for k in places), covariance=covariance[np.ix_(places, places)],
        diagnostics=diagnostics, record=problem.record,
    )  # fmt: skip


def _remarks(
    model: Model, acts_as: Mapping[str, str], zero: Sequence[str], *, converged: bool, problem: LikelihoodProblem
) -> Iterator[Remark]:
    """Yield the remarks about the terms of a fit and about the search."""
    axis = problem.record.axis
    for term, name in acts_as.items():
        yield Remark.of("correlation-time-unknown", axis, case="fit", term=term, process=name, known="no")
    for term in zero:
        yield Remark.of("term-zero", axis, case="fit", term=term)
    if not converged:
        yield Remark.of("not-converged", axis)
    for term, process in model.by_term.items():
        if process.scale > 0 and term not in acts_as:
            remarks = process.remarks(term, problem.record.observed, problem.rate)
            yield from (remark.about(axis) for remark in remarks)
    yield from approximation_remarks(model, problem.rate, axis)


def _level(problem: LikelihoodProblem, level: RegressionEstimate, best: Model) -> tuple[float | None, float | None]:
    """Return the estimated mean of the recording and its standard error; None if it is known or part of a random walk.
    If the variance of the random walk is estimated as zero, its constant level is the mean."""
    if problem.mean is None:
        zero = {term for term, process in best.by_term.items() if process.scale == 0}
        for k, regressor in enumerate(problem.regressors):
            if regressor.flat and regressor.label in {LEVEL, *zero}:
                error = math.sqrt(max(float(level.covariance[k, k]), 0.0))
                return float(level.values[k]) + problem.centre, error
    return None, None


def _acts_as(problem: LikelihoodProblem, found: Maximum, best: Model, renamed: dict[str, str]) -> dict[str, str]:
    """Return the terms whose shape parameter is at an end of its domain, with the equivalent process there."""
    out = {}
    for k in found.at_end:
        coordinate = problem.coordinates[k]
        process = best.processes[coordinate.term]
        if len(process.nonlinear_parameters()) != 1:
            continue
        for branch in problem.branch(coordinate):
            u = branch.coordinate(float(process.nonlinear[0]))
            if u is not None:
                name = branch.low_acts_as if 2 * u < branch.low + branch.high else branch.high_acts_as
                if name is not None:
                    out[renamed[best.terms[coordinate.term]]] = name
    return out


def _covariance(
    problem: LikelihoodProblem, found: Maximum, best: Model, level: RegressionEstimate
) -> tuple[list[str], Matrix]:
    """Return the names and the covariance of the parameters that are not estimated at a limit of their domain."""
    active = list(found.active)
    turned = jacobian(problem, best)
    names, rows = [], []
    for term, process in best.by_term.items():
        for parameter in process.parameters:
            name = f"{term}.{parameter.name}"
            row = turned.get(name)
            if row is not None and np.any(row[active]) and not np.any(np.delete(row, active)):
                names.append(name)
                rows.append(row[active])
    covariance = np.zeros((len(names), len(names)))
    if rows:
        # The last evaluation may have derivatives with respect to other coordinates.
        same = len(found.evaluation.gradient) == len(active) and not found.at_end
        evaluation = found.evaluation if same else problem.evaluate(found.z, active)
        assert evaluation is not None
        inverse = invert(evaluation.information)
        by = np.array(rows)
        with np.errstate(invalid="ignore"):
            covariance = by @ inverse @ by.T
        lost = ~np.isfinite(np.diag(inverse))
        if np.any(lost):
            unknown = np.any(by[:, lost] != 0, axis=1)
            covariance = by[:, ~lost] @ inverse[np.ix_(~lost, ~lost)] @ by[:, ~lost].T
            covariance[unknown, unknown] = np.inf
    for k, regressor in enumerate(problem.regressors):
        if not regressor.flat:
            process = best.by_term[regressor.label]
            names.append(f"{regressor.label}.{process.scale_parameter().name}")
            covariance = np.block(
                [[covariance, np.zeros((len(covariance), 1))], [np.zeros((1, len(covariance))), level.covariance[k, k]]]
            )
    return names, covariance


def invert(information: Matrix) -> Matrix:
    """Invert the information matrix. Coordinates about which the data have no information get an infinite variance."""
    size = np.sqrt(np.diag(information))
    informed = size > 0
    size = np.where(informed, size, 1.0)
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    able = values > 1e-10 * values[-1]
    inverse = (vectors[:, able] / values[able]) @ vectors[:, able].T / np.outer(size, size)
    lost = np.any(np.abs(vectors[:, ~able]) > 0.1, axis=1) | ~informed
    inverse[lost, lost] = np.inf
    return np.asarray(inverse)


def jacobian(problem: LikelihoodProblem, model: Model) -> dict[str, Vector]:
    """Return the derivatives ∂θ/∂z (q,) of each parameter θ with respect to the coordinates z, by name."""
    out: dict[str, Vector] = {}
    q = len(problem.coordinates)
    for k, coordinate in enumerate(problem.coordinates):
        process, term = model.processes[coordinate.term], model.terms[coordinate.term]
        if coordinate.shape is None:
            parameter = process.scale_parameter()
            row = out.setdefault(f"{term}.{parameter.name}", np.zeros(q))
            row[k] = process.value(parameter.name) / (parameter.scale_power or 1.0)
            continue
        z = type(process).coordinates(process.nonlinear.reshape(1, -1)).astype(np.complex128)
        z[0, coordinate.shape] += 1e-30j
        slope = np.imag(type(process).at_coordinates(z)[0]) / 1e-30
        for parameter, value in zip(process.nonlinear_parameters(), slope.tolist(), strict=True):
            out.setdefault(f"{term}.{parameter.name}", np.zeros(q))[k] = value
    return out


def misfit(fit: LikelihoodFit) -> Remark | None:
    """Return a remark if a model does not describe its recording's wavelet variance: most information is about the
    fastest process, so long scales hardly affect the likelihood or the whiteness. η_j ν̂²_j / ν²_j is about chi-square
    with η_j = 2 ν⁴_j / V_jj degrees of freedom; p-values are adjusted by Holm's method."""
    from scipy.special import gammainc, gammaincc

    # Significance level, small because the fit does not minimise this distance (tests/likelihood/test_misfit.py).
    level = 1e-3
    try:
        wv = fit.wavelet_variance
        usable = usable_levels(wv)
        spread = variances(fit.model, Design.of(wv).only(usable))
    except (DataError, MissingTheoryError):
        return None  # the recording is too short for a wavelet variance, or a process has no covariance
    implied, measured = fit.implied[usable], wv.variance[usable]
    if not np.any(usable) or not np.all(implied > 0):
        return None
    half = implied**2 / spread
    scores = half * measured / implied
    pvalues = 2 * np.minimum(gammainc(half, scores), gammaincc(half, scores))
    pvalue = float(min(1.0, pvalues.size * np.min(pvalues)))
    if pvalue >= level:
        return None
    ratios = implied / np.maximum(measured, 1e-9 * implied)
    worst = int(np.argmax(np.where(pvalues.size * pvalues < level, np.abs(np.log(ratios)), 0.0)))
    ratio = float(ratios[worst])
    return Remark.of(
        "likelihood-misfit", fit.axis, tau=Quantity(float(wv.tau[usable][worst]), "s"), ratio=max(ratio, 1 / ratio),
        side="above" if ratio > 1 else "below", pvalue=pvalue,
    )  # fmt: skip
