"""Confidence intervals of the parameters of a fit; upper limits of what the data do not show."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import TYPE_CHECKING, Literal

import numpy as np

from gmwm._arrays import Matrix
from gmwm.covariance import Design
from gmwm.covariance import covariance as covariance_of
from gmwm.errors import OptionError
from gmwm.estimation.reweighting import REWEIGHTED, implied_weights
from gmwm.inference.asymptotic import no_noise, sandwich_of
from gmwm.inference.bootstrap import DRAWS, as_draws, bootstrap, least_draws
from gmwm.options import as_confidence
from gmwm.processes.base import Process
from gmwm.processes.model import Model
from gmwm.processes.parameter import Parameter
from gmwm.processes.validation import as_seed
from gmwm.variance.limits import chi_square_limits

if TYPE_CHECKING:
    from gmwm.estimation.result import Fit

Method = Literal["asymptotic", "bootstrap"]
Interval = tuple[float, float]

ROUNDING = 1e-8
"""What a correlation may be off by, in a covariance that was computed elsewhere."""
_UNKNOWN = 14.0
"""Half of an interval, on the logarithm of a parameter, that is as good as none: a factor of a million."""
_ROUNDS = 60
_SETTLED = 1e-4


def confidence_intervals(
    fit: Fit,
    level: float = 0.95,
    method: Method = "asymptotic",
    *,
    covariance: Matrix | None = None,
    draws: int = DRAWS,
    rng: int | np.random.Generator = 0,
) -> dict[str, Interval]:
    """Confidence interval of every estimated parameter: see `Fit.confidence_intervals`."""
    level = as_confidence(level, "level")
    if method not in ("asymptotic", "bootstrap"):
        raise OptionError(f"method must be 'asymptotic' or 'bootstrap', got {method!r}")
    seed = as_seed(rng) if method == "bootstrap" else 0
    if covariance is None:
        # Upper limits take their time, and a summary, a datasheet and a file ask for the same ones.
        kept: dict[tuple[object, ...], dict[str, Interval]] = fit.__dict__.setdefault("_intervals", {})
        key = (level, method, draws, seed)
        if key not in kept:
            kept[key] = _intervals(fit, level, method=method, covariance=None, draws=draws, seed=seed)
        return dict(kept[key])
    return _intervals(fit, level, method=method, covariance=covariance, draws=draws, seed=seed)


def _intervals(
    fit: Fit, level: float, method: Method, covariance: Matrix | None, draws: int, seed: int
) -> dict[str, Interval]:
    two_sided: dict[str, Interval]
    if method == "bootstrap":
        if covariance is not None:
            raise OptionError("covariance= belongs to method='asymptotic'; leave it out, or take that method")
        as_draws(draws, least_draws(level), f"an interval of {100 * level:g} %")
        drawn = bootstrap(fit, draws, seed)
        if not np.all(np.ptp(drawn.variances, axis=0) > 0):
            raise no_noise(fit.model)
        two_sided = drawn.quantiles((1 - level) / 2, (1 + level) / 2)
    else:
        two_sided = _asymptotic(fit, level, covariance)
    intervals = {}
    z = NormalDist().inv_cdf((1 + level) / 2)
    for term, process in zip(fit.model.terms, fit.model.processes, strict=True):
        for parameter in process.parameters:
            name = f"{term}.{parameter.name}"
            if process.is_fixed(parameter.name):
                continue
            if parameter.scale_power and not free_shape(process) and is_weak(fit, name, parameter, z):
                limit = upper_limit(fit, term, parameter, level)
                intervals[name] = (-limit if parameter.domain == "real" else 0.0, limit)
            else:
                intervals[name] = two_sided.get(name, (0.0, math.inf))
    return intervals


def free_shape(process: Process) -> bool:
    """Whether the shape of a process was to be estimated as well as its scale."""
    return any(not process.is_fixed(parameter.name) for parameter in process.nonlinear_parameters())


def is_weak(fit: Fit, name: str, parameter: Parameter, z: float = 1.96) -> bool:
    """Whether a scale parameter is zero, or its scale coefficient less than z standard errors from it."""
    if fit.parameters[name] == 0:
        return True
    found, power = fit.sandwich, parameter.scale_power or 1.0
    place = found.names.index(name)
    return z * power * math.sqrt(found.relative[place, place]) >= 1


def _asymptotic(fit: Fit, level: float, covariance: Matrix | None) -> dict[str, Interval]:
    found = fit.sandwich
    if covariance is not None:
        found = sandwich_of(
            fit.model,
            Design.of(fit.wavelet_variance),
            matrix=fit.weighting_matrix,
            wavelet=_as_covariance(fit, covariance),
            acts_as=fit.diagnostics.acts_as,
        )
    z = NormalDist().inv_cdf((1 + level) / 2)
    parameters = parameters_by_name(fit.model)
    return {
        name: about(parameters[name], value, float(z * abs(value) * math.sqrt(square)))
        for name, value, square in zip(found.names, found.values.tolist(), np.diag(found.relative), strict=True)
    }


def parameters_by_name(model: Model) -> dict[str, Parameter]:
    """What each parameter of a model is, by its label."""
    return {
        f"{term}.{parameter.name}": parameter
        for term, process in zip(model.terms, model.processes, strict=True)
        for parameter in process.parameters
    }


def about(parameter: Parameter, value: float, reach: float) -> Interval:
    """value ± reach on the scale that keeps the ends inside the parameter's domain."""
    if parameter.domain == "real":
        return value - reach, value + reach
    if parameter.domain == "between":
        low, high = parameter.limits
        half, share = (high - low) / 2, (2 * value - low - high) / (high - low)
        centre, reach = math.atanh(share), reach / half / (1 - share * share)
        return low + half * (1 + math.tanh(centre - reach)), low + half * (1 + math.tanh(centre + reach))
    if reach / value > _UNKNOWN:
        return 0.0, math.inf
    factor = math.exp(reach / value)
    return value / factor, value * factor


def _as_covariance(fit: Fit, covariance: Matrix) -> Matrix:
    """A covariance of the fit's wavelet variance (J, J): finite, symmetric, and not negative in any direction."""
    size, hint = len(fit.wavelet_variance), "as empirical_covariance(x, rate) gives one"
    try:
        array = np.asarray(covariance, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise OptionError(f"covariance must be a {size} x {size} matrix of numbers, {hint}; {error}") from error
    if array.shape != (size, size) or not np.all(np.isfinite(array)):
        raise OptionError(
            f"covariance must be a {size} x {size} matrix of finite numbers, {hint}; got shape {array.shape}"
            f"{' with NaN or infinite ones' if array.shape == (size, size) else ''}"
        )
    diagonal = np.diag(array)
    if np.any(diagonal < 0):
        raise OptionError(f"covariance must have variances on its diagonal, {hint}; got {diagonal.min():g}")
    scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    correlation = array / scale[:, None] / scale[None, :]
    if np.any(np.abs(correlation - correlation.T) > ROUNDING):
        raise OptionError(f"covariance must be symmetric, {hint}; this one differs from its transpose")
    least, *_, largest = np.linalg.eigvalsh(correlation) if size > 1 else (correlation[0, 0],) * 2
    if least < -ROUNDING * largest:
        raise OptionError(
            f"covariance must be positive semidefinite, {hint}; correlations here have the eigenvalue {least:.2g}"
        )
    return np.asarray((array + array.T) / 2)


def upper_limit(fit: Fit, term: str, parameter: Parameter, level: float) -> float:
    """The value of a scale parameter at which an estimate as small as this one would have probability (1 − level)/2.

    Its scale coefficient c solves c = ĉ + z SE(c). The scatter grows with c, so it is that of a model with this value
    and not of the fitted one. Whatever it is, no process is stronger than all there is: c times its wavelet variance is
    at most the upper chi-square limit of each of the J levels, at (1 − level)/(2J).
    """
    wv = fit.wavelet_variance
    process = fit.model.processes[fit.model.terms.index(term)]
    name = f"{term}.{parameter.name}"
    z = NormalDist().inv_cdf((1 + level) / 2)
    shape = process.with_values(**{parameter.name: process.value_from(1.0)}).wavelet_variance(
        wv.levels, wv.rate, wv.filter
    )
    seen = (shape > 0) & (wv.variance > 0)
    _, ceiling = chi_square_limits(wv.variance, wv.degrees_of_freedom, 1 - (1 - level) / len(wv))
    largest = float(np.min(ceiling[seen] / shape[seen]))
    estimate = process.scale
    # From so small that it does not matter.
    scale = max(estimate, 1e-3 * float(np.min(fit.implied[seen] / shape[seen])))
    tried: list[tuple[float, float]] = []
    for _ in range(_ROUNDS):
        relative = _relative_error(fit, fit.model.with_values({name: process.value_from(scale)}), name)
        after = estimate + z * (parameter.scale_power or 1.0) * relative * scale
        if not after < largest:
            break
        if abs(after - scale) <= _SETTLED * after:
            return process.value_from(after)
        tried.append((math.log(scale), math.log(after)))
        scale = min(math.exp(_fixed_point(tried[-2:])), largest)
    return process.value_from(largest)


def _fixed_point(tried: list[tuple[float, float]]) -> float:
    """Where the line through the last two (x, f(x)) says that f(x) = x; f(x) itself where it is too steep to say."""
    x, value = tried[-1]
    if len(tried) < 2 or tried[0][0] == x:
        return value
    slope = (value - tried[0][1]) / (x - tried[0][0])
    return x + (value - x) / (1 - slope) if slope < 0.95 else value


def _relative_error(fit: Fit, model: Model, name: str) -> float:
    """Relative standard error of a parameter if `model` were true."""
    design = Design.of(fit.wavelet_variance)
    matrix = implied_weights(fit.weighting, model, design) if fit.weighting in REWEIGHTED else fit.weighting_matrix
    found = sandwich_of(
        model, design, matrix=matrix, wavelet=covariance_of(model, design), acts_as=fit.diagnostics.acts_as
    )
    place = found.names.index(name)
    return math.sqrt(found.relative[place, place])
