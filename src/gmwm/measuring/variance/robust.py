"""Robust wavelet variance, the M-estimate of scale of the coefficients at each level.

Newton's method starts at the median of a sample; two or three passes over all coefficients refine its roots."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base import _core
from gmwm.base.arrays import Matrix, Vector, as_vector
from gmwm.measuring.variance.biweight import NORMAL_QUARTILE, Biweight, Criterion, biweight, newton, root_beyond, scan
from gmwm.measuring.variance.coefficients import SAMPLED_COEFFICIENTS, CoefficientSource, PlainCoefficients

LOG_TOLERANCE = 1e-11  # predicted error of log σ² below which a level has converged
MEAN_SQUARE_COUNT = 2
"""Largest number of coefficients for which the variance is the mean square, because no outlier can be identified."""

LARGE_SHARE = 0.25
"""Share of unrejected outliers from which a robust curve must not be used (tests/variance/test_unrejected.py)."""

Outcome: TypeAlias = Literal["root", "mad", "mean", "zero"]
"""Method of a level: "root", "mad" without one: (MAD / 0.67449)², "mean" of 1–2 squares, "zero" if most are 0."""


@dataclass
class _RootSearch:
    """State of the search at one level. `place` is log σ² minus log `start`."""

    start: float = 0.0
    place: float = 0.0
    zeros: float = 0.0
    outcome: Outcome | None = None
    rooted: bool = False
    peaks: list[float] = field(default_factory=list)
    iterations: int = 0
    passes: int = 0

    @property
    def variance(self) -> float:
        return self.start * math.exp(self.place)


@dataclass(frozen=True)
class RobustVariances:
    """Robust variances (J,), whether outliers are isolated, and lists by level: "outcome", "start" (σ²), "iterations"
    on a sample, "passes" over all, and "zeros", the share of zero coefficients."""

    variance: Vector
    diagnostics: Mapping[str, list[Any]]
    isolated: bool = False


def robust_variances(source: CoefficientSource, efficiency: float = 0.6) -> RobustVariances:
    """Compute the M-estimate of σ² by level, the root of mean ρ(W/σ) = a with a falling left side, from (MAD /
    0.67449)². If the MAD is 0, as at fine levels of quantized signals, it starts at the median of nonzero |W|."""
    tuning = biweight(efficiency)
    levels = [_first(source, k, tuning) for k in range(len(source.counts))]
    _polish(source, levels, tuning)
    for k, level in enumerate(levels):
        if level.outcome is None:
            _settle(source, k, level, tuning)
    diagnostics: dict[str, list[Any]] = {
        name: [getattr(level, name) for level in levels]
        for name in ("outcome", "start", "iterations", "passes", "zeros")
    }
    variance = np.array([level.variance for level in levels])
    return RobustVariances(variance, diagnostics, isolated=_isolated(source, variance))


def _isolated(source: CoefficientSource, variance: Vector) -> bool:
    """Return whether there are isolated outliers: beyond 5 standard deviations, their share of the coefficients is 4
    times as large at level 3 as at level 1. That of knocks and of white noise with heavy tails hardly grows."""
    if variance.size < 3 or not np.all(variance[:3] > 0):
        return False

    def beyond(k: int) -> int:
        limit = 5 * math.sqrt(variance[k])
        return int(source.counts[k]) - source.between(k, limit, limit)[0]

    first = beyond(0)
    return first >= 10 and beyond(2) / int(source.counts[2]) > 2.5 * first / int(source.counts[0])


def unrejected(
    estimate: RobustVariances, classical: Vector, freedom: Vector, efficiency: float
) -> tuple[list[float], Matrix] | None:  # fmt: skip
    """Estimate the share (J,) of isolated outliers that robust variances do not reject, and its relative covariance.

    Such outliers are white, so they add (ν̂₁² − ν̃₁²) 2^{1−j} to level j of ν̂². The share b_j is the excess of ν̃²
    over the rest of ν̂². The error u_j of the first level acts like undetected outliers; both double by level beside
    strong quantization. None if no outliers matter; `freedom` (J,) is that of the classical curve."""
    robust = estimate.variance
    if not (estimate.isolated and np.all(robust > 0) and np.all(freedom > 0)):
        return None
    # Relative error of the difference between an efficient and a robust estimate (Hausman 1978, Econometrica 46, 1251).
    spread = np.sqrt((1 / efficiency - 1) * 2 / freedom)
    first = classical[0] / robust[0] - 1
    white = robust[0] / robust * 2.0 ** -np.arange(robust.size)
    # A robust variance can also be too small, if it rejects coefficients of the noise beside the outliers.
    share = np.minimum(np.abs(1 - classical / robust + first * white), 1.0)
    # Beside noise that is nearly white, the power of the outliers is not known well enough for a smaller share.
    clear = (share > 2 * spread) & (freedom > 30) & ((white > 4) | (share > 0.75))
    share, error = np.where(clear, share, 0.0), np.where(freedom > 30, np.minimum(spread[0] * white, 1.0), 0.0)
    if first <= 3 * spread[0] or max(np.max(share), np.max(error)) < 0.05:
        return None
    # Standard errors of the logarithm: a variance of which the share b are outliers is 1/(1 − b) times too large.
    bias = -np.log1p(-np.minimum(share, 0.95))
    return share.tolist(), np.outer(bias, bias) + np.outer(error, error)


def robust_variance(coefficients: ArrayLike, efficiency: float = 0.6) -> float:
    """Compute the squared biweight M-estimate of scale of coefficients (M,)."""
    plain = PlainCoefficients([as_vector(coefficients, "coefficients")], [0.0])
    return float(robust_variances(plain, efficiency).variance[0])


def _first(source: CoefficientSource, k: int, tuning: Biweight) -> _RootSearch:
    """Search the root of a level on a sample of its coefficients. The result is final if the sample has all of them."""
    sample = source.sample(k, SAMPLED_COEFFICIENTS)
    count, resolution = int(source.counts[k]), source.resolution(k)
    complete = sample.size == count
    level = _RootSearch(zeros=float(np.count_nonzero(sample <= resolution)) / sample.size)
    if not complete and level.zeros > 0.4:
        # Near one half, or if the sample may have missed the few nonzero coefficients, count all of them.
        level.zeros = source.between(k, resolution, resolution)[0] / count
    if level.zeros == 1:
        level.outcome = "zero"
    elif count <= MEAN_SQUARE_COUNT:
        level.start, level.outcome = float(np.mean(sample**2)), "mean"
    else:
        _search(level, sample, resolution=resolution, complete=complete, tuning=tuning)
    return level


def _search(level: _RootSearch, sample: Vector, resolution: float, complete: bool, tuning: Biweight) -> None:
    """Find a root on the sample by Newton's method, started at the MAD. If this fails, scan the range around it."""
    middle = float(np.median(sample))
    # More than half of the sample can be zero although less than half of all coefficients are.
    if _mad_is_zero(level) or middle <= resolution:
        nonzero = sample[sample > resolution]
        if nonzero.size == 0:
            return
        # The median of the nonzero coefficients is the quantile (1 + share of zeros) / 2 of |W|.
        start = float(np.median(nonzero)) / NormalDist().inv_cdf((3 + level.zeros) / 4)
    else:
        start = middle / NORMAL_QUARTILE
    level.start = start**2
    # Beyond, the limit and the ratios of the criterion lose their digits or overflow, and the MAD is used.
    if not 1e-280 < level.start < 1e280:
        return
    criterion = _on_sample(level, sample, tuning)
    tolerance = LOG_TOLERANCE / 10 if complete else 1e-3
    root, level.iterations = (None, 0) if _mad_is_zero(level) else newton(criterion, tolerance)
    if root is None:
        result = scan(criterion, tolerance)
        root, level.iterations = result.root, level.iterations + result.evaluations
        if root is None and not complete:
            # The mean of ρ on the sample is off by 4 % of a, so near roots may be roots of all coefficients.
            near = [(abs(place), place) for place, value in result.peaks if value > -0.15 * tuning.a]
            level.peaks = [place for _, place in sorted(near)]
    if root is not None:
        level.place, level.rooted = root, True
        level.outcome = "root" if complete else None


def _mad_is_zero(level: _RootSearch) -> bool:
    return level.zeros > 0.5


def _on_sample(level: _RootSearch, sample: Vector, tuning: Biweight) -> Criterion:
    def criterion(place: float) -> tuple[float, float]:
        cubed, fourth = _core.biweight_sums(sample, tuning.c**2 * level.start * math.exp(place))
        return tuning.criterion(cubed, fourth, float(sample.size))

    return criterion


def criterion_of(source: CoefficientSource, k: int, origin: float, tuning: Biweight) -> Criterion:
    """Return the criterion of level k + 1 on all coefficients as a function of log σ² relative to log `origin`."""
    limits = np.zeros(len(source.counts))

    def criterion(place: float) -> tuple[float, float]:
        limits[k] = tuning.c**2 * origin * math.exp(place)
        cubed, fourth, count = source.sums(limits)
        return tuning.criterion(float(cubed[k]), float(fourth[k]), float(count[k]))

    return criterion


def _polish(source: CoefficientSource, levels: Sequence[_RootSearch], tuning: Biweight) -> None:
    """Refine the sample roots of all levels by Newton's method on all coefficients, pass by pass."""
    # First, one Newton step uses an eighth of the recording, if it has more independent coefficients than the sample.
    stride = 8
    active = np.array([level.rooted and level.outcome is None for level in levels])
    start = np.array([level.start for level in levels])
    place = np.array([level.place for level in levels])
    before: tuple[Vector, Vector, Vector] | None = None
    # Coefficients less than 2^j apart are strongly correlated, so N coefficients count as N / 2^j independent ones.
    fine = active & (source.counts / stride >= SAMPLED_COEFFICIENTS * 2.0 ** np.arange(1, len(levels) + 1))
    # Two or three passes are typical. `_settle` solves a level that has not converged.
    for number in range(-int(fine.any()), 8):
        if not active.any():
            return
        limits = np.where(fine if number < 0 else active, tuning.c**2 * start * np.exp(place), 0.0)
        cubed, fourth, count = source.sums(limits, stride if number < 0 else 1)
        value, slope = tuning.criterion(cubed, fourth, np.maximum(count, 1.0))
        falls = active & (slope < 0)
        step = np.where(falls, -value, 0.0) / np.where(falls, slope, 1.0)
        falls &= np.abs(step) < 0.5
        if number < 0:
            place = place + np.where(falls, step, 0.0)
            continue
        here = (place, value, slope)
        step, error = (step, 10 * step**2) if before is None else _interpolate(before, here, step)
        before, place = here, place + np.where(falls, step, 0.0)
        done = falls & (error < LOG_TOLERANCE)
        for k, level in enumerate(levels):
            if active[k]:
                level.passes, level.place = number + 1, float(place[k])
                level.outcome = "root" if done[k] else None
        active = falls & ~done


def _interpolate(
    before: tuple[Vector, Vector, Vector], here: tuple[Vector, Vector, Vector], step: Vector
) -> tuple[Vector, Vector]:
    """Return the step to the root of the cubic log σ² through two points and slopes, and the product of squared
    distances. It is a Newton step if the later criterion is not below a tenth of the earlier."""
    (x0, y0, d0), (x1, y1, d1) = before, here
    usable = (np.abs(y1) < 0.1 * np.abs(y0)) & (d0 < 0) & (d1 < 0)
    span = np.where(usable, y1 - y0, 1.0)
    m0, m1 = (span / np.where(usable, d, 1.0) for d in (d0, d1))
    # The following is in units of the span: the root lies at u = -y1 / span beyond the later point.
    u = -y1 / span
    rise = x1 - x0
    cubic = u * m1 + u**2 * (m0 + 2 * m1 - 3 * rise) + u**3 * (m0 + m1 - 2 * rise)
    moved = np.where(usable, cubic, step)
    error = np.where(usable, 10 * (moved * (rise + moved)) ** 2, 10 * moved**2)
    return moved, error


def _settle(source: CoefficientSource, k: int, level: _RootSearch, tuning: Biweight) -> None:
    """Solve a level that did not converge on its sample by a scan of all, or take the MAD without a root."""
    criterion = criterion_of(source, k, level.start, tuning)
    root: float | None = None
    if level.rooted:
        result = scan(criterion, LOG_TOLERANCE)
        root, level.passes = result.root, level.passes + result.evaluations
    for peak in level.peaks:
        root, count = root_beyond(criterion, peak, LOG_TOLERANCE)
        level.passes += count
        if root is not None:
            break
    if root is not None:
        level.place, level.outcome = root, "root"
        return
    level.place = 0.0
    if _mad_is_zero(level):
        level.start, level.outcome = 0.0, "zero"
    else:
        level.start, level.outcome = (source.median(k) / NORMAL_QUARTILE) ** 2, "mad"
