"""Covariance of the estimates, Cov θ̂ = B V Bᵀ, with B = (DᵀΩD)⁻¹DᵀΩ, D = ∂ν²/∂θ and the exact covariance V of ν̂².

Derivatives are by logarithms of the parameters, which differ by many powers of ten, unlike their relative errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.arrays import FrozenArrays, Matrix, Vector, freeze
from gmwm.base.text import Named
from gmwm.fitting.estimation.linearised import columns_of, relative_covariance, relative_jacobian, sizes_of
from gmwm.fitting.estimation.recordings import spread_of_mean
from gmwm.fitting.estimation.weighting import no_noise
from gmwm.measuring.covariance import Design, covariance
from gmwm.measuring.covariance.robust import rounding_bias
from gmwm.theory.processes.model import Model

if TYPE_CHECKING:
    from gmwm.fitting.estimation.result import Fit


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Sandwich(FrozenArrays):
    """Covariance of the estimates, without parameters that are fixed, zero or at an end of their domain.

    Attributes
    ----------
    names : tuple of str
        Names of the p parameters.
    values : (p,) array
        Estimates of the parameters.
    relative : (p, p) array
        Covariance of the relative errors of the estimates. The variance is infinite if the data do not determine a
        parameter.
    wavelet : (J, J) array, in unit⁴
        Covariance V of the wavelet variance under the fitted model. For several recordings, it includes the spread of
        the parameters between them.
    without_spread : Sandwich or None
        For several recordings, the covariance without the spread between them, which shows whether a term can be zero.
        None for a single recording.
    """

    names: tuple[str, ...]
    values: Vector
    relative: Matrix
    wavelet: Matrix
    without_spread: Sandwich | None = None

    def __repr__(self) -> str:
        return f"Sandwich({', '.join(self.names)}, {len(self.wavelet)} levels)"

    @property
    def sampling(self) -> Sandwich:
        """Covariance without the spread between recordings."""
        return self if self.without_spread is None else self.without_spread

    @property
    def covariance(self) -> Matrix:
        """Covariance Cov θ̂ (p, p) of the estimates."""
        return freeze(self.relative * np.outer(self.values, self.values))

    @property
    def errors(self) -> dict[str, float]:
        """Standard error of each parameter, in the unit of the parameter."""
        errors = np.sqrt(np.diag(self.relative)) * np.abs(self.values)
        return dict(zip(self.names, errors.tolist(), strict=True))


def sandwich(fit: Fit) -> Sandwich:
    """Covariance of the estimates by the sandwich formula.

    The object also has the names of the estimated parameters, their relative standard errors, and the covariance V
    of the wavelet variance.

    Raises
    ------
    ModelError
        If the model has no noise at some level.
    MissingTheoryError
        If the covariance of a process is unknown.
    """
    design, acts_as = Design.of(fit.wavelet_variance), fit.diagnostics.acts_as
    bias = rounding_bias(fit.model, design) * fit.implied  # counts as a standard error
    wavelet = noise_covariance(fit.model, design) + np.outer(bias, bias)
    result = sandwich_of(fit.model, design, matrix=fit.weighting_matrix, wavelet=wavelet, acts_as=acts_as)
    if len(fit.wavelet_variance.recordings) < 2:
        return result
    total = wavelet + spread_of_mean(fit)
    both = sandwich_of(fit.model, design, matrix=fit.weighting_matrix, wavelet=total, acts_as=acts_as)
    return replace(both, without_spread=result)


def noise_covariance(model: Model, design: Design) -> Matrix:
    """Return the covariance V (J, J); raise ModelError if the model has no noise at some level."""
    wavelet = covariance(model, design)
    if not np.all(np.diag(wavelet) > 0):
        raise no_noise(model.structure)
    return wavelet


def sandwich_of(
    model: Model, design: Design, matrix: Matrix, wavelet: Matrix, acts_as: Mapping[str, str] | None = None
) -> Sandwich:
    """Compute the covariance of estimates from Ω = `matrix` and V = `wavelet`, without terms that act as another. The
    scale of a term estimated as zero is free, as its true value may be positive; other errors are then conservative."""
    columns, reported = columns_of(model, acts_as or {})
    values = sizes_of(model, columns)
    slopes = np.column_stack([relative_jacobian(model, design, columns), *_unseen(model, design)])
    relative = relative_covariance(slopes, matrix, wavelet)[: len(columns), : len(columns)]
    places = [k for k, name in enumerate(columns) if name in reported]
    return Sandwich(
        names=tuple(columns[k] for k in places), values=values[places], relative=relative[np.ix_(places, places)],
        wavelet=wavelet,
    )  # fmt: skip


def _unseen(model: Model, design: Design) -> list[Vector]:
    """Return the wavelet variances (J,), for scale coefficient 1, of terms that are zero and have no free shape."""
    return [
        process.moments(process.nonlinear.reshape(1, -1), design.levels, design.rate, design.filter)[0]
        for process in model.processes
        if process.scale == 0 and not process.is_fixed(process.scale_parameter().name) and process.shape_is_fixed
    ]


def standard_errors(fit: Fit) -> dict[str, float]:
    """Standard error of each estimated parameter, by name, in the unit of the parameter.

    A parameter that is fixed, zero or at an end of its domain has no standard error. Looking it up raises a
    KeyError that states the reason. Raises the errors of `sandwich`.
    """
    errors = fit.sandwich.errors
    return Named(errors, "standard error of", why_no_error(fit.model, errors, fit.diagnostics.acts_as))


def why_no_error(model: Model, errors: Mapping[str, float], acts_as: Mapping[str, str]) -> dict[str, str]:
    """Return the reason why each parameter that is not in `errors` has no standard error."""
    why = {}
    for term, process in model.by_term.items():
        for parameter in process.parameters:
            name = f"{term}.{parameter.name}"
            if name in errors:
                continue
            if process.is_fixed(parameter.name):
                reason = "it is fixed at its value"
            elif term in acts_as:
                reason = f"{term} acts as {acts_as[term]}, so the data do not determine its parameters one by one"
            elif process.scale == 0 and parameter.scale_power is None:
                reason = f"{term} is estimated as zero, so the parameter has no meaning"
            elif any(not process.is_fixed(other.name) for other in process.nonlinear_parameters()):
                reason = "it is zero, the end of its domain, and the data give it no limit while the shape is free"
            else:
                reason = "it is zero, the end of its domain; its upper limit is in confidence_intervals()"
            why[name] = f"{name} has no standard error: {reason}"
    return why
