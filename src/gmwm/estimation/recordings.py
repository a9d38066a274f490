"""Differences between the recordings of a pooled fit: in its parameters, near its estimate, where its curve is linear.

The curve of recording r differs from the fitted curve by z_r. With V_r its covariance under the fitted model and D_r
the derivatives of the curve with respect to the logarithms of the parameters, the deviation of its parameters is

    δ_r = (D_rᵀ V_r⁻¹ D_r)⁻¹ D_rᵀ V_r⁻¹ z_r,   Cov δ_r = (D_rᵀ V_r⁻¹ D_r)⁻¹.

It is one step of a fit to this recording alone. V_r never comes from a fit to recording r alone: a recording that is
low by chance would then have too large a weight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gmwm._arrays import Matrix, Vector, freeze
from gmwm.covariance import Design, covariance
from gmwm.estimation.linearised import columns_of, parameter_gain, relative_jacobian, unexplained
from gmwm.estimation.weighting import precision, square_root
from gmwm.processes.parameter import Parameter
from gmwm.random_effects import Effects, confidence_of_mean, effects

if TYPE_CHECKING:
    from gmwm.estimation.result import Fit

LEAST_FREEDOM = 3.0
"""Degrees of freedom above which a level is used, as in the goodness-of-fit test (docs/validation/recordings.md)."""
SURE = 0.002
"""p-value below which recordings differ beyond their parameters, as for the error of a model in `selection.search`."""
SMALLEST = 1e-6
"""Smallest relative difference: the relative standard error of ν̂² in 10¹² samples."""
_HALVINGS = 40
LONGEST = 5.0
"""Largest step of the logarithm of a shape parameter. A recording that needs a larger step does not determine the
parameter."""
LEVEL = 0.95
"""Confidence level at which the covariance has the same width as the t distribution."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Deviations:
    """The deviations of the recordings from a pooled fit, and the test that all recordings have the same parameters.

    Attributes
    ----------
    recordings : tuple of str
        Names of the R recordings.
    names : tuple of str
        The p parameters that the data determine.
    values : (R, p) array
        δ_r, relative to the estimate; NaN if a recording does not determine a parameter.
    covariances : (R, p, p) array
        Covariance of δ_r without a spread between recordings; infinite variance for NaN.
    model_error : float
        Relative difference of the recordings at each level that no parameters describe; it enters the weights of the
        deviations and their covariances, and not the test.
    statistic : float
        H: the statistic of the goodness-of-fit test of a fit with the same parameters for all recordings, minus the
        sum of the statistics of fits with separate parameters for each recording.
    df : int
        Its degrees of freedom.
    """

    recordings: tuple[str, ...]
    names: tuple[str, ...]
    values: Matrix
    covariances: Matrix
    model_error: float
    statistic: float
    df: int

    def __post_init__(self) -> None:
        freeze(self.values)
        freeze(self.covariances)

    @property
    def pvalue(self) -> float:
        """p-value of H; 1 without a degree of freedom."""
        from scipy.special import gammaincc

        return float(gammaincc(self.df / 2, self.statistic / 2)) if self.df > 0 else 1.0

    @property
    def variances(self) -> Matrix:
        """Variances of δ_r (R, p)."""
        return np.diagonal(self.covariances, axis1=1, axis2=2)

    @property
    def effects(self) -> Effects:
        """Mean and spread of each parameter over the recordings."""
        return effects(self.values.T, self.variances.T)

    @property
    def correlation(self) -> Matrix:
        """Correlation (p, p) of the deviations over the recordings."""
        with np.errstate(invalid="ignore"):
            apart = np.nan_to_num(self.values - self.effects.mean)
        length = np.linalg.norm(apart, axis=0)
        found = (apart / np.where(length > 0, length, 1.0)).T @ (apart / np.where(length > 0, length, 1.0))
        np.fill_diagonal(found, 1.0)
        return np.asarray(found)

    @property
    def of_mean(self) -> Matrix:
        """Return the part of the covariance (p, p) of the pooled estimate that the spread between recordings adds.

        It gives the width of the interval that includes the uncertainty of τ̂, whether a test finds a spread or not.
        With equally accurate recordings, this is at least the t interval of their mean, which holds for any spread:
        four times as wide as without a spread for two equal recordings, twice for three, and 1.3 times for five
        (docs/validation/recordings.md).
        """
        information = np.sum(np.where(np.isfinite(self.values), 1 / self.variances, 0.0), axis=0)
        known = information > 0
        half = half_widths(self.values.T[known], self.variances.T[known])
        added = np.zeros(known.size)
        width2 = (half / NormalDist().inv_cdf((1 + LEVEL) / 2)) ** 2
        added[known] = np.sqrt(np.maximum(width2 - 1 / information[known], 0.0))
        return np.asarray(self.correlation * np.outer(added, added))


def half_widths(x: Matrix, s2: Matrix) -> Vector:
    """Return half widths of the 95 % confidence intervals of the means of samples (m, n) with a spread; see
    `of_mean`."""
    alone = effects(x, s2, spread2=np.zeros(len(x)))
    half = NormalDist().inv_cdf((1 + LEVEL) / 2) * alone.error
    several = alone.count > 1
    if np.any(several):
        low, high = confidence_of_mean(x[several], s2[several], LEVEL)
        half[several] = np.maximum(half[several], (high - low) / 2)
    return np.asarray(half)


def deviations(fit: Fit) -> Deviations:
    """Compute the deviations of the recordings from a pooled fit; the result is stored with the fit.

    Parameters
    ----------
    fit : Fit
        A fit to several recordings, `fit.wavelet_variance.recordings`.
    """
    if "_deviations" not in fit.__dict__:
        fit.__dict__["_deviations"] = _deviations(fit)
    found: Deviations = fit.__dict__["_deviations"]
    return found


class _Part(NamedTuple):
    """The usable levels (K,) of one recording.

    Attributes
    ----------
    place : int
        Number of the recording.
    curve, left, apart : (K,) arrays
        The fitted curve, and the difference of the recording from it and from the mean of all recordings.
    scatter : (K, K) array
        V_r.
    slopes : (K, p) array
        D_r.
    """

    place: int
    curve: Vector
    left: Vector
    apart: Vector
    scatter: Matrix
    slopes: Matrix

    def root(self, error: float) -> Matrix:
        """L with LᵀL = (V_r + error² diag ν⁴)⁻¹."""
        return square_root(precision(self.scatter + np.diag((error * self.curve) ** 2)))


def _deviations(fit: Fit) -> Deviations:
    names, _ = columns_of(fit.model, fit.diagnostics.acts_as)
    parts = _parts(fit, names)
    shape = len(fit.wavelet_variance.recordings), len(names)
    values, covariances = np.full(shape, np.nan), np.zeros((*shape, shape[1]))
    covariances[:, np.arange(shape[1]), np.arange(shape[1])] = np.inf
    error = _error_between(parts)
    for part in parts:
        root = part.root(error)
        gain, lost = parameter_gain(root @ part.slopes)
        values[part.place] = np.where(lost, np.nan, gain @ root @ part.left)
        found = gain @ gain.T
        found[lost] = found[:, lost] = 0.0
        found[lost, lost] = np.inf
        covariances[part.place] = found
    roots = [part.root(0.0) for part in parts]
    lefts = [root @ part.left for root, part in zip(roots, parts, strict=True)]
    slopes = [root @ part.slopes for root, part in zip(roots, parts, strict=True)]
    own = [unexplained(left, slope) for left, slope in zip(lefts, slopes, strict=True)]
    together, rank = unexplained(np.concatenate(lefts), np.concatenate(slopes)) if lefts else (0.0, 0)
    return Deviations(
        recordings=tuple(fit.wavelet_variance.recordings), names=tuple(names), values=values, covariances=covariances,
        model_error=error, statistic=together - sum(one[0] for one in own), df=sum(one[1] for one in own) - rank,
    )  # fmt: skip


def _parts(fit: Fit, names: list[str]) -> list[_Part]:
    """Return the recordings that have usable levels."""
    known: dict[object, tuple[Vector, Matrix, Matrix]] = {}
    parts = []
    for k, wv in enumerate(fit.wavelet_variance.recordings.values()):
        design = Design.of(wv)
        used = (design.degrees_of_freedom > LEAST_FREEDOM) & (wv.levels <= len(fit.wavelet_variance))
        design = design.only(used)
        if not np.any(used):
            continue
        key = (design.lengths, design.filled, design.strides, used.size, None if wv.excess is None else k)
        if key not in known:
            curve = fit.model.wavelet_variance(design.levels, design.rate, design.filter)
            known[key] = curve, covariance(fit.model, design), relative_jacobian(fit.model, design, names)
        curve, scatter, slopes = known[key]
        mean = fit.wavelet_variance.variance[: design.levels.size]
        variance = wv.variance[used]
        parts.append(_Part(k, curve, left=variance - curve, apart=variance - mean, scatter=scatter, slopes=slopes))
    return parts


def _error_between(parts: list[_Part]) -> float:
    """Relative difference τ of the recordings at each level beyond their scatter and other parameters; 0 by default.

    If the recordings differ in a way that the parameters do not describe, for example in the shape of the noise at high
    frequencies, the precise first levels would decide about all parameters. τ is estimated as the relative error of a
    model is: the statistic of what the parameters do not describe equals its degrees of freedom.
    """
    from scipy.special import gammaincc

    if len(parts) < 2:
        return 0.0

    def rest(error: float) -> tuple[float, float]:
        total, freedom = 0.0, 0.0
        for part in parts:
            root = part.root(error)
            more, rank = unexplained(root @ part.apart, root @ part.slopes)
            total, freedom = total + more, freedom + part.curve.size - rank
        return total, freedom * (1 - 1 / len(parts))

    statistic, freedom = rest(0.0)
    if freedom <= 0 or gammaincc(freedom / 2, statistic / 2) >= SURE:
        return 0.0
    low, high = SMALLEST, 1.0
    for _ in range(_HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if rest(middle)[0] > freedom else (low, middle)
    return high


def spread_of_mean(fit: Fit) -> Matrix:
    """Return the part of the covariance of the wavelet variance (J, J), in unit⁴, that the spread between recordings
    adds.

    The spread is in the parameters: it moves the curve in the directions of its derivatives. The goodness-of-fit test
    does not depend on it.
    """
    found = deviations(fit)
    slopes = relative_jacobian(fit.model, Design.of(fit.wavelet_variance), found.names)
    return np.asarray(slopes @ found.of_mean @ slopes.T)


def stepped(parameter: Parameter, value: float, share: float) -> float:
    """Return a value after a relative step, inside the domain of its parameter.

    >>> from gmwm import WN
    >>> stepped(WN.parameters[0], 4.0, 0.25), stepped(WN.parameters[0], 4.0, -1.5)
    (5.0, 0.0)
    """
    if parameter.scale_power is not None and parameter.domain != "real":
        return value * max(1.0 + share, 0.0)
    if parameter.domain == "real":
        return value * (1.0 + share)
    if parameter.domain == "between":
        low, high = parameter.limits
        half, place = (high - low) / 2, (2 * value - low - high) / (high - low)
        return low + half * (1 + math.tanh(math.atanh(place) + share * value / half / (1 - place * place)))
    return value * math.exp(max(min(share, LONGEST), -LONGEST))
