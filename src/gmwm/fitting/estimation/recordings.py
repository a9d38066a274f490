"""Deviations of the parameters of single recordings from a fit to all of them, by linearisation near the estimate.

The logarithms of recording r, whose curve differs by z_r, deviate by δ_r = (D_rᵀ V_r⁻¹ D_r)⁻¹ D_rᵀ V_r⁻¹ z_r, Cov δ_r =
(D_rᵀ V_r⁻¹ D_r)⁻¹. V_r comes from the common fit: low variances would get too large weights."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gmwm.base.arrays import FrozenArrays, Matrix, Vector
from gmwm.base.lazy import scipy
from gmwm.base.statistics import Effects, confidence_of_mean, effects
from gmwm.fitting.estimation.linearised import columns_of, parameter_gain, relative_jacobian, square_of_rest, usable_in
from gmwm.fitting.estimation.weighting import precision, square_root
from gmwm.measuring.covariance import Design, covariance
from gmwm.theory.processes.parameter import Parameter

if TYPE_CHECKING:
    from gmwm.fitting.estimation.result import Fit

DIFFERENCE_PVALUE = 0.002
"""p-value of a difference that the parameters do not describe; the same as for the error in `selection.search`."""
LONGEST_STEP = 5.0
"""Largest relative step of a parameter; recordings with a larger step of a shape, or error, do not determine it."""
EQUAL_WIDTH_LEVEL = 0.95
"""Confidence level at which both kinds of intervals for the mean of recordings have the same width."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Deviations(FrozenArrays):
    """Relative deviations δ_r (R, p) from a pooled fit, and the test that recordings have the same parameters.

    `covariances` (infinite if undetermined) exclude a spread but include `model_error`, the relative difference beyond
    parameters. `statistic` is that of equal minus those of separate parameters, with `df` degrees of freedom."""

    recordings: tuple[str, ...]
    names: tuple[str, ...]
    values: Matrix
    covariances: Matrix
    model_error: float
    statistic: float
    df: int

    @property
    def pvalue(self) -> float:
        """p-value of the test; 1 if there is no degree of freedom."""
        return float(scipy.special.gammaincc(self.df / 2, self.statistic / 2)) if self.df > 0 else 1.0

    @property
    def variances(self) -> Matrix:
        """Variances (R, p) of the deviations δ_r."""
        return np.diagonal(self.covariances, axis1=1, axis2=2)

    @property
    def known(self) -> Matrix:
        """Deviations (R, p) of the parameters that the recordings determine; NaN for the others."""
        return np.where(np.isfinite(self.variances), self.values, np.nan)

    @property
    def effects(self) -> Effects:
        """Mean and spread of each parameter over the recordings."""
        return effects(self.known.T, self.variances.T)

    @property
    def correlation(self) -> Matrix:
        """Correlation (p, p) of the deviations of the parameters across the recordings."""
        with np.errstate(invalid="ignore"):
            apart = np.nan_to_num(self.known - self.effects.mean)
        length = np.linalg.norm(apart, axis=0)
        correlation = (apart / np.where(length > 0, length, 1.0)).T @ (apart / np.where(length > 0, length, 1.0))
        np.fill_diagonal(correlation, 1.0)
        return np.asarray(correlation)

    @property
    def of_mean(self) -> Matrix:
        """Covariance (p, p) of the mean by the spread, whether significant or not. Without one, intervals are 4 (two
        recordings), 2 (three) or 1.3 (five) times as wide (docs/validation/recordings.md)."""
        information = np.sum(1 / self.variances, axis=0)
        informed = information > 0
        half = half_widths(self.known.T[informed], self.variances.T[informed])
        added = np.zeros(informed.size)
        width2 = (half / NormalDist().inv_cdf((1 + EQUAL_WIDTH_LEVEL) / 2)) ** 2
        added[informed] = np.sqrt(np.maximum(width2 - 1 / information[informed], 0.0))
        return np.asarray(self.correlation * np.outer(added, added))


def half_widths(x: Matrix, s2: Matrix) -> Vector:
    """Return half widths (m,) of 95 % intervals of means of samples `x` (m, n) with variances `s2`.

    A value with a larger error than the most precise one hardly informs about the spread. So its deviation also counts
    in units of its error, except for what exceeds z errors, and the narrower interval holds
    (tests/replicates/test_replicates.py)."""
    alone = effects(x, s2, spread2=np.zeros(len(x)))
    z = NormalDist().inv_cdf((1 + EQUAL_WIDTH_LEVEL) / 2)
    half = z * alone.error
    if np.any(several := alone.count > 1):
        x, s2 = x[several], np.where(np.isfinite(x), s2, np.inf)[several]
        low, high = confidence_of_mean(x, s2, EQUAL_WIDTH_LEVEL)
        s, least = np.sqrt(s2), np.sqrt(s2.min(axis=-1, keepdims=True))
        off = x - alone.mean[several, None]
        near = off * (least / s) + np.sign(off) * np.maximum(np.abs(off) - z * s, 0.0) * (1 - least / s)
        many = np.sum(1 / s2, axis=-1) ** 2 / np.sum(s2**-2, axis=-1)  # as many equal errors give the same total
        nearest, farthest = confidence_of_mean(near, np.broadcast_to(least**2, x.shape), EQUAL_WIDTH_LEVEL, many - 1)
        scale = np.sqrt(alone.count[several] / many)
        half[several] = np.maximum(half[several], np.minimum(high - low, scale * (farthest - nearest)) / 2)
    return np.asarray(half)


def deviations(fit: Fit) -> Deviations:
    """Compute the deviations of the recordings from a pooled fit; the result is stored with the fit."""
    if "_deviations" not in fit.__dict__:
        fit.__dict__["_deviations"] = _deviations(fit)
    result: Deviations = fit.__dict__["_deviations"]
    return result


class _RecordingData(NamedTuple):
    """Usable levels of recording r: difference from the fitted (`left`) and pooled curve (`apart`), V_r and D_r."""

    place: int
    curve: Vector
    left: Vector
    apart: Vector
    scatter: Matrix
    slopes: Matrix

    def root(self, error: float) -> Matrix:
        """Return L with LᵀL = (V_r + error² diag ν⁴)⁻¹, where ν² is the fitted curve."""
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
        spread = gain @ gain.T
        lost |= np.diag(spread) > LONGEST_STEP**2
        spread[lost] = spread[:, lost] = 0.0
        spread[lost, lost] = np.inf
        covariances[part.place] = spread
    roots = [part.root(0.0) for part in parts]
    lefts = [root @ part.left for root, part in zip(roots, parts, strict=True)]
    slopes = [root @ part.slopes for root, part in zip(roots, parts, strict=True)]
    fits = [square_of_rest(residual, slope) for residual, slope in zip(lefts, slopes, strict=True)]
    together, rank = square_of_rest(np.concatenate(lefts), np.concatenate(slopes)) if lefts else (0.0, 0)
    return Deviations(
        recordings=tuple(fit.wavelet_variance.recordings), names=tuple(names), values=values, covariances=covariances,
        model_error=error, statistic=together - sum(square for square, _ in fits),
        df=sum(count for _, count in fits) - rank,
    )  # fmt: skip


def _parts(fit: Fit, names: list[str]) -> list[_RecordingData]:
    """Return the data of the recordings that have usable levels; `names` are the parameters."""
    cache: dict[object, tuple[Vector, Matrix, Matrix]] = {}
    parts = []
    for k, wv in enumerate(fit.wavelet_variance.recordings.values()):
        design = Design.of(wv)
        used = usable_in(design) & (wv.levels <= len(fit.wavelet_variance))
        design = design.only(used)
        if not np.any(used):
            continue
        key = (design.lengths, design.filled, design.strides, used.size, None if wv.excess is None else k)
        if key not in cache:
            curve = fit.model.wavelet_variance(design.levels, design.rate, design.filter)
            cache[key] = curve, covariance(fit.model, design), relative_jacobian(fit.model, design, names)
        curve, scatter, slopes = cache[key]
        mean = fit.wavelet_variance.variance[: design.levels.size]
        variance = wv.variance[used]
        parts.append(
            _RecordingData(k, curve, left=variance - curve, apart=variance - mean, scatter=scatter, slopes=slopes)
        )
    return parts


def _error_between(parts: list[_RecordingData]) -> float:
    """Return the relative difference between the recordings at each level that the parameters do not describe; 0 unless
    a test finds one. Without it, the precise first levels would determine the deviations of all parameters."""
    if len(parts) < 2:
        return 0.0

    def rest(error: float) -> tuple[float, float]:
        total, freedom = 0.0, 0.0
        for part in parts:
            root = part.root(error)
            more, rank = square_of_rest(root @ part.apart, root @ part.slopes)
            total, freedom = total + more, freedom + part.curve.size - rank
        return total, freedom * (1 - 1 / len(parts))

    statistic, freedom = rest(0.0)
    if freedom <= 0 or scipy.special.gammaincc(freedom / 2, statistic / 2) >= DIFFERENCE_PVALUE:
        return 0.0
    # Smallest relative difference between recordings, which is the relative standard error of ν̂² from 10¹² samples.
    low, high = 1e-6, 1.0
    for _ in range(40):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if rest(middle)[0] > freedom else (low, middle)
    return high


def spread_of_mean(fit: Fit) -> Matrix:
    """Return the covariance (J, J), in unit⁴, that the spread between recordings adds: it moves the curve in the
    directions of its derivatives, so the goodness-of-fit test does not depend on it."""
    result = deviations(fit)
    slopes = relative_jacobian(fit.model, Design.of(fit.wavelet_variance), result.names)
    return np.asarray(slopes @ result.of_mean @ slopes.T)


def step_parameter(parameter: Parameter, value: float, share: float) -> float:
    """Return the value of a parameter after a relative step `share`; the result is in the domain of the parameter.

    >>> from gmwm import WN
    >>> step_parameter(WN.parameters[0], 4.0, 0.25), step_parameter(WN.parameters[0], 4.0, -1.5)
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
    return value * math.exp(max(min(share, LONGEST_STEP), -LONGEST_STEP))
