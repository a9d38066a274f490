"""Confidence intervals of the parameters of a fit, and upper limits of terms that may be zero."""

from __future__ import annotations

import math
from copy import copy
from statistics import NormalDist
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from gmwm.base.arrays import Matrix
from gmwm.base.errors import OptionError
from gmwm.base.lazy import once_per_result
from gmwm.fitting.estimation.asymptotic import sandwich_of
from gmwm.fitting.estimation.bootstrap import DRAWS, as_draws, bootstrap, least_draws
from gmwm.fitting.estimation.reweighting import REWEIGHTED, reciprocal
from gmwm.fitting.estimation.weighting import no_noise, precision
from gmwm.measuring.axis_results import chi_square_limits
from gmwm.measuring.covariance import Design, covariances
from gmwm.recording.options import as_confidence, one_of
from gmwm.theory.processes.model import Model
from gmwm.theory.processes.parameter import Parameter
from gmwm.theory.processes.validation import as_seed

if TYPE_CHECKING:
    from gmwm.fitting.estimation.result import Fit

Method = Literal["asymptotic", "bootstrap"]
Interval = tuple[float, float]

UNDETERMINED_HALF_WIDTH = 14.0
"""Half width of an interval for a logarithm, a factor of a million, above which a parameter is not determined."""


def confidence_intervals(
    fit: Fit, level: float = 0.95, method: Method = "asymptotic", *, covariance: Matrix | None = None,
    draws: int = DRAWS, rng: int | np.random.Generator = 0,
) -> dict[str, Interval]:  # fmt: skip
    """Compute a confidence interval (low, high) for every estimated parameter, by name.

    With the estimate θ̂, its standard error SE and the normal quantile z:

    - The interval of a variance or a correlation time is θ̂ exp(±z SE/θ̂), which is symmetric for the logarithm.
    - The interval of φ of an AR1 is symmetric for artanh φ.
    - The interval of the slope ω of a drift, which has a sign, is ω̂ ± z SE.
    - If the data do not exclude that a white noise, a random walk or a drift is zero, the interval is from 0 to an
      upper limit (for a drift, from −limit to limit). This one-sided limit of a 95 % interval has the level 97.5 %.
    - If the data do not determine a parameter, the interval is (0, inf).

    Parameters
    ----------
    level : float
        Confidence level, between 0 and 1.
    method : "asymptotic" or "bootstrap"
        Source of the intervals: the exact covariance of the wavelet variance, or quantiles of the estimates from
        `draws` simulated recordings.
    covariance : (J, J) array, optional
        Covariance V that replaces the covariance of the fitted model, for example from `empirical_covariance`; only
        with method="asymptotic". It must belong to the wavelet variance that was fitted. The empirical covariance
        of data with outliers belongs to the classical estimate, not to a robust fit.
    draws, rng
        The same as for `Fit.bootstrap`, with at least 2 / (1 − level) − 1 draws, which is 39 for 95 %.

    Returns
    -------
    dict of name to (low, high)
        Intervals, in the units of the parameters.

    Raises
    ------
    OptionError
        If an option is unknown or out of range, or `covariance` is not a covariance matrix of J levels.
    ModelError
        If the model has no noise at some level.
    MissingTheoryError
        If the covariance of a process is unknown.

    References
    ----------
    Guerrier, Skaloud, Stebler and Victoria-Feser (2013), JASA 108, 1021-1030, theorem 2.

    Examples
    --------
    >>> from gmwm import WN, RW, fit
    >>> x = (WN(sigma2=4.0) + RW(gamma2=1e-3)).simulate(20_000, 100.0, rng=1)
    >>> low, high = fit(WN() + RW(), x, rate=100.0).confidence_intervals()["WN.sigma2"]
    >>> low < 4.0 < high
    True
    """
    level = as_confidence(level, "level")
    one_of(method, "method", get_args(Method))
    seed = as_seed(rng) if method == "bootstrap" else 0
    if covariance is None:
        # The intervals are cached, because upper limits are slow, and a summary, a datasheet and a file all use them.
        key = (level, method, draws, seed)
        return dict(
            once_per_result(fit, "intervals", key, lambda: _intervals(fit, level, method, draws=draws, seed=seed))
        )
    return _intervals(fit, level, method, draws=draws, seed=seed, covariance=covariance)


def _intervals(
    fit: Fit, level: float, method: Method, draws: int, seed: int, covariance: Matrix | None = None
) -> dict[str, Interval]:
    two_sided: dict[str, Interval]
    if method == "bootstrap":
        if covariance is not None:
            raise OptionError(
                argument="covariance",
                expected="left out if the method is the bootstrap",
                advice="Leave {--covariance} out, or use {--method=asymptotic}.",
            )
        as_draws(draws, least_draws(level), f"an interval of {100 * level:g} %")
        drawn = bootstrap(fit, draws, seed)
        if not np.all(np.ptp(drawn.variances, axis=0) > 0):
            raise no_noise(fit.model.structure)
        two_sided = drawn.quantiles((1 - level) / 2, (1 + level) / 2)
    else:
        two_sided = _asymptotic(fit, level, covariance)
    intervals = {}
    z = NormalDist().inv_cdf((1 + level) / 2)
    for term, process in fit.model.by_term.items():
        for parameter in process.parameters:
            name = f"{term}.{parameter.name}"
            if process.is_fixed(parameter.name):
                continue
            if parameter.scale_power and process.shape_is_fixed and is_weak(fit, name, parameter, z):
                limit = upper_limit(fit, term, parameter, level)
                intervals[name] = (-limit if parameter.domain == "real" else 0.0, limit)
            else:
                intervals[name] = two_sided.get(name, (0.0, math.inf))
    return intervals


def with_quick_intervals(fit: Fit, level: float) -> Fit:
    """Return a fit with upper limits ĉ + z SE(ĉ), not iterated, for models of little weight in a comparison."""
    key, computed = ("intervals", (level, "asymptotic", DRAWS, 0)), fit.__dict__.get("_computed", {})
    if key in computed:
        return fit
    limits, z = _asymptotic(fit, level, None), NormalDist().inv_cdf((1 + level) / 2)
    errors = dict(zip(fit.sandwich.names, np.sqrt(np.diag(fit.sandwich.relative)).tolist(), strict=True))
    for term, process in fit.model.by_term.items():
        for parameter in process.parameters:
            name = f"{term}.{parameter.name}"
            if process.is_fixed(parameter.name):
                continue
            limits.setdefault(name, (0.0, math.inf))
            if parameter.scale_power and name in errors and process.shape_is_fixed and is_weak(fit, name, parameter, z):
                high = process.value_from(process.scale * (1 + z * (parameter.scale_power or 1.0) * errors[name]))
                limits[name] = (-high if parameter.domain == "real" else 0.0, high)
    quick = copy(fit)
    quick.__dict__["_computed"] = {**computed, key: limits}
    return quick


def is_weak(fit: Fit, name: str, parameter: Parameter, z: float = 1.96) -> bool:
    """Return whether a scale parameter is zero, or its scale coefficient is at most z standard errors above zero."""
    if fit.parameters[name] == 0:
        return True
    errors, power = fit.sandwich.sampling, parameter.scale_power or 1.0
    place = errors.names.index(name)
    return z * power * math.sqrt(errors.relative[place, place]) >= 1


def _asymptotic(fit: Fit, level: float, covariance: Matrix | None) -> dict[str, Interval]:
    errors = fit.sandwich
    if covariance is not None:
        errors = sandwich_of(
            fit.model, Design.of(fit.wavelet_variance), matrix=fit.weighting_matrix,
            wavelet=_as_covariance(fit, covariance), acts_as=fit.diagnostics.acts_as,
        )  # fmt: skip
    z = NormalDist().inv_cdf((1 + level) / 2)
    parameters, intervals = parameters_by_name(fit.model), {}
    squares = zip(np.diag(errors.relative), np.diag(errors.sampling.relative), strict=True)
    for name, value, ends in zip(errors.names, errors.values.tolist(), squares, strict=True):
        total, own = (z * math.sqrt(square) if square >= 0 else math.inf for square in ends)
        power, signed = parameters[name].scale_power, parameters[name].domain == "real"
        above = upper_reach(total, own, None if power is None or signed else 1 / power)
        low, high = (about(parameters[name], value, abs(value) * reach) for reach in (total, above))
        intervals[name] = (low[0], high[1])
    return intervals


def upper_reach(total: float, own: float, power: float | None) -> float:
    """Return the distance to the upper end of the logarithm of a `power` of a variance (None: of a shape), from z
    standard errors with and without the spread, which is a relative one of variances and not of their logarithms."""
    if power is None or total == own:
        return total
    return own + power * math.log((1 + total / power) / (1 + own / power))


def parameters_by_name(model: Model) -> dict[str, Parameter]:
    """Return the parameters of a model, by name."""
    return {
        f"{term}.{parameter.name}": parameter
        for term, process in model.by_term.items()
        for parameter in process.parameters
    }


def about(parameter: Parameter, value: float, reach: float) -> Interval:
    """Return an interval with half width `reach`, symmetric after a logarithm or artanh that respects the domain."""
    if parameter.domain == "real":
        return value - reach, value + reach
    if parameter.domain == "between":
        low, high = parameter.limits
        half, share = (high - low) / 2, (2 * value - low - high) / (high - low)
        centre, reach = math.atanh(share), reach / half / (1 - share * share)
        return low + half * (1 + math.tanh(centre - reach)), low + half * (1 + math.tanh(centre + reach))
    if reach / value > UNDETERMINED_HALF_WIDTH:
        return 0.0, math.inf
    factor = math.exp(reach / value)
    return value / factor, value * factor


def _as_covariance(fit: Fit, covariance: Matrix) -> Matrix:
    """Check that a covariance (J, J) of a wavelet variance is finite, symmetric and positive semidefinite."""
    # Tolerance of the correlations in a covariance of the user, which may have been written with 8 digits.
    rounding = 1e-8
    size = len(fit.wavelet_variance)
    try:
        array = np.asarray(covariance, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise _no_covariance(f"be a {size} x {size} matrix of numbers", covariance) from error
    if array.shape != (size, size):
        raise _no_covariance(f"be a {size} x {size} matrix; got shape {array.shape}", array.shape)
    if bad := int(np.count_nonzero(~np.isfinite(array))):
        raise _no_covariance(f"be finite; got {bad} NaN or infinite values", bad)
    diagonal = np.diag(array)
    if np.any(diagonal < 0):
        raise _no_covariance(f"have variances on its diagonal; got {diagonal.min():g}", float(diagonal.min()))
    scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    correlation = array / scale[:, None] / scale[None, :]
    if np.any(np.abs(correlation - correlation.T) > rounding):
        raise _no_covariance("be symmetric; it differs from its transpose", covariance)
    least, *_, largest = np.linalg.eigvalsh(correlation) if size > 1 else (correlation[0, 0],) * 2
    if least < -rounding * largest:
        raise _no_covariance(
            f"be positive semidefinite; its correlations have the eigenvalue {least:.2g}", float(least)
        )
    return np.asarray((array + array.T) / 2)


def _no_covariance(what: str, got: object) -> OptionError:
    return OptionError(
        f"covariance must {what}", argument="covariance", got=got,
        advice="Compute it with `empirical_covariance(x, rate)`.",
    )  # fmt: skip


def upper_limit(fit: Fit, term: str, parameter: Parameter, level: float) -> float:
    """Return the upper limit c = ĉ + z SE(c) of a scale, where a smaller estimate has the probability (1 − level)/2. c
    times the process's curve is at most each level's upper chi-square limit, at (1 − level)/(2J)."""
    wv = fit.wavelet_variance
    process = fit.model.by_term[term]
    name = f"{term}.{parameter.name}"
    z = NormalDist().inv_cdf((1 + level) / 2)
    shape = process.with_values(**{parameter.name: process.value_from(1.0)}).wavelet_variance(
        wv.levels, wv.rate, wv.filter
    )
    seen = (shape > 0) & (wv.variance > 0)
    # Heavy tails and outliers that a robust curve keeps are fewer degrees of freedom.
    freedom = 1 / (1 / wv.degrees_of_freedom + (0.0 if wv.excess is None else np.diag(wv.excess) / 2))
    _, ceiling = chi_square_limits(wv.variance, freedom, 1 - (1 - level) / len(wv))
    estimate = process.scale
    # A curve far below a model that does not fit must not put the limit below the estimate.
    largest = max(float(np.min(ceiling[seen] / shape[seen])), estimate)
    # Start from a scale that contributes at most 0.1 % of the fitted curve.
    scale = max(estimate, 1e-3 * float(np.min(fit.implied[seen] / shape[seen])))
    power, spread = parameter.scale_power or 1.0, _added_error(fit, name)
    tried: list[tuple[float, float]] = []
    # Every fit of tests/inference/test_inference_laws.py ends earlier, by the relative accuracy below.
    for _ in range(60):
        relative = _relative_error(fit, fit.model.with_values({name: process.value_from(scale)}), name)
        after = estimate + z * power * math.hypot(relative * scale, spread * estimate)
        if not after < largest:
            break
        # Limits are shown with four digits.
        if abs(after - scale) <= 1e-4 * after:
            return process.value_from(after)
        tried.append((math.log(scale), math.log(after)))
        scale = min(math.exp(_fixed_point(tried[-2:])), largest)
    return process.value_from(largest)


def _added_error(fit: Fit, name: str) -> float:
    """Return the relative standard error that the spread between recordings adds to a parameter in quadrature."""
    errors = fit.sandwich
    if errors.without_spread is None or name not in errors.names:
        return 0.0
    place = errors.names.index(name)
    return math.sqrt(max(errors.relative[place, place] - errors.without_spread.relative[place, place], 0.0))


def _fixed_point(tried: list[tuple[float, float]]) -> float:
    """Return the fixed point of the line through the last two (x, f(x)), or the last f(x) if it is too steep."""
    x, value = tried[-1]
    if len(tried) < 2 or tried[0][0] == x:
        return value
    slope = (value - tried[0][1]) / (x - tried[0][0])
    return x + (value - x) / (1 - slope) if slope < 0.95 else value


def _relative_error(fit: Fit, model: Model, name: str) -> float:
    """Return the relative standard error of the parameter `name` if `model` were the true model."""
    design = Design.of(fit.wavelet_variance)
    wavelet, for_weights = covariances(model, design, design.for_weights)
    if fit.weighting == "optimal":
        matrix = precision(for_weights)
    else:
        diagonal = fit.weighting in REWEIGHTED
        matrix = np.diag(reciprocal(np.diag(for_weights), model)) if diagonal else fit.weighting_matrix
    errors = sandwich_of(model, design, matrix=matrix, wavelet=wavelet, acts_as=fit.diagnostics.acts_as)
    place = errors.names.index(name)
    return math.sqrt(errors.relative[place, place])
