"""Confidence intervals of the parameters of a fit; upper limits of what the data do not show."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import TYPE_CHECKING, Literal

import numpy as np

from gmwm._arrays import Matrix
from gmwm.covariance import Setting
from gmwm.covariance import covariance as covariance_of
from gmwm.errors import OptionError
from gmwm.estimation.reweighting import REWEIGHTED, implied_weights
from gmwm.inference.asymptotic import sandwich_of
from gmwm.inference.bootstrap import DRAWS, bootstrap
from gmwm.processes.base import Process
from gmwm.processes.model import Model
from gmwm.processes.parameter import Parameter
from gmwm.variance.limits import chi_square_limits

if TYPE_CHECKING:
    from gmwm.estimation.result import Fit

Method = Literal["asymptotic", "bootstrap"]
Interval = tuple[float, float]

_ROUNDS = 60
_SETTLED = 1e-4


def confidence_intervals(
    fit: Fit,
    level: float = 0.95,
    method: Method = "asymptotic",
    *,
    covariance: Matrix | None = None,
    draws: int = DRAWS,
    seed: int = 0,
) -> dict[str, Interval]:
    """Confidence interval (low, high) of every parameter that was estimated, by name.

    Variances and correlation times have θ̂ exp(±z SE/θ̂), on the scale of their logarithm, so that they stay positive;
    φ the same on the scale of artanh φ; a drift, which may have either sign, ω̂ ± z SE. A white noise, walk or drift
    that is zero, or so weak that zero cannot be excluded, has the interval from 0 to an upper limit, a drift from −
    limit to limit: as nothing lies below zero, the limit of an interval of 95 % holds at 97.5 %. What these data do not
    determine has (0, inf): the correlation time and scale of a repeated term that is estimated as zero, or acts as
    another process.

    Parameters
    ----------
    level : float
        Confidence level, 0.95 by default.
    method : "asymptotic" or "bootstrap"
        From the exact covariance of the wavelet variance, or quantiles of estimates from `draws` simulated records.
    covariance : (J, J) array, optional
        V to be used instead of the fitted model's, as from `empirical_covariance`; method="asymptotic" only.
    draws, seed : int
        Of the bootstrap.

    Returns
    -------
    mapping of name to (low, high)

    Raises
    ------
    OptionError
        If an option is not one of those it may be.
    MissingTheoryError
        If the covariance of a process is not known.

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
    level = as_level(level)
    if method not in ("asymptotic", "bootstrap"):
        raise OptionError(f"method must be 'asymptotic' or 'bootstrap', got {method!r}")
    two_sided: dict[str, Interval]
    if method == "bootstrap":
        if covariance is not None:
            raise OptionError("covariance= belongs to method='asymptotic'; leave it out, or take that method")
        two_sided = bootstrap(fit, draws, seed).quantiles((1 - level) / 2, (1 + level) / 2)
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


def as_level(level: float) -> float:
    """A confidence level: a number between 0 and 1."""
    if not isinstance(level, int | float | np.floating) or not 0 < level < 1:
        raise OptionError(f"level must be between 0 and 1, got {level!r}; 95 % is 0.95")
    return float(level)


def _asymptotic(fit: Fit, level: float, covariance: Matrix | None) -> dict[str, Interval]:
    found = fit.sandwich
    if covariance is not None:
        found = sandwich_of(
            fit.model, Setting.of(fit.wavelet_variance), fit.weighting_matrix, _as_covariance(fit, covariance),
            fit.diagnostics.acts_as,
        )  # fmt: skip
    z = NormalDist().inv_cdf((1 + level) / 2)
    parameters = parameters_by_name(fit.model)
    return {
        name: _interval(parameters[name], value, z * abs(value) * math.sqrt(square))
        for name, value, square in zip(found.names, found.values.tolist(), np.diag(found.relative), strict=True)
    }


def parameters_by_name(model: Model) -> dict[str, Parameter]:
    """What each parameter of a model is, by its label."""
    return {
        f"{term}.{parameter.name}": parameter
        for term, process in zip(model.terms, model.processes, strict=True)
        for parameter in process.parameters
    }


def _interval(parameter: Parameter, value: float, reach: float) -> Interval:
    """value ± reach on the scale that keeps the ends inside the parameter's domain."""
    if parameter.domain == "real":
        return value - reach, value + reach
    if parameter.domain == "unit":
        centre, reach = math.atanh(value), reach / (1 - value * value)
        return math.tanh(centre - reach), math.tanh(centre + reach)
    factor = math.exp(min(reach / value, 700.0))
    return value / factor, value * factor if math.isfinite(reach) else math.inf


def _as_covariance(fit: Fit, covariance: Matrix) -> Matrix:
    array = np.asarray(covariance, dtype=np.float64)
    size = len(fit.wavelet_variance)
    if array.shape != (size, size) or not np.all(np.isfinite(array)):
        raise OptionError(f"covariance must be a {size} x {size} matrix of finite numbers, got shape {array.shape}")
    return array


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
    for _ in range(_ROUNDS):
        relative = _relative_error(fit, fit.model.with_values({name: process.value_from(scale)}), name)
        before, scale = scale, estimate + z * (parameter.scale_power or 1.0) * relative * scale
        if not scale < largest:
            break
        if abs(scale - before) <= _SETTLED * scale:
            return process.value_from(scale)
    return process.value_from(largest)


def _relative_error(fit: Fit, model: Model, name: str) -> float:
    """Relative standard error of a parameter if `model` were true."""
    setting = Setting.of(fit.wavelet_variance)
    matrix = implied_weights(fit.weighting, model, setting) if fit.weighting in REWEIGHTED else fit.weighting_matrix
    found = sandwich_of(model, setting, matrix, covariance_of(model, setting), fit.diagnostics.acts_as)
    place = found.names.index(name)
    return math.sqrt(found.relative[place, place])
