"""Estimate the wavelet variance of a signal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base import _core
from gmwm.base.arrays import Matrix, Vector, as_vector, require_finite, require_rate
from gmwm.base.errors import DataError, OptionError
from gmwm.measuring.axis_results import by_axis, chi_square_limits, rate_of_array
from gmwm.measuring.variance.biweight import require_robust
from gmwm.measuring.variance.coefficients import (
    CoefficientSource,
    HaarCoefficients,
    PlainCoefficients,
    PooledCoefficients,
)
from gmwm.measuring.variance.phase import SCALE_DOWN, TOO_LARGE
from gmwm.measuring.variance.result import WaveletVariance, WaveletVariances
from gmwm.measuring.variance.rise import RiseSums
from gmwm.measuring.variance.robust import RobustVariances, robust_variances, unrejected
from gmwm.measuring.variance.transform import (
    Transform,
    as_level_count,
    coefficient_counts,
    deepest_level,
    inner_coefficients,
    loss_factor,
    pooled_counts,
    variances,
)
from gmwm.recording.chunks import MINIMUM_SAMPLES
from gmwm.recording.options import as_confidence, one_of
from gmwm.recording.signals import Imu, Signal
from gmwm.theory.filters import HAAR, WaveletFilter, find_filter


@by_axis(lambda curves: WaveletVariances(curves=curves))
def wavelet_variance(
    x: Imu | Signal | ArrayLike, rate: float | None = None, *, filter: str | WaveletFilter = "haar",
    transform: Transform = "modwt", levels: int | None = None, robust: bool = False, efficiency: float = 0.6,
    confidence: float = 0.95, fill_gaps: bool = True,
) -> WaveletVariance:  # fmt: skip
    """Estimate the wavelet variance of a signal, or of each axis of a recording, with chi-square confidence limits.

    The classical estimate ν̂_j² is the mean square of the coefficients W_{j,t} = Σ_l h_{j,l} X_{t−l} of level j, over
    the M_j = N − L_j + 1 coefficients that only use samples of the recording, where L_j is the length of the filter at
    level j. The decimated transform uses every 2^j-th of them. Both estimates are unbiased; the decimated one has the
    larger variance.

    For the Haar filter W_{j,t} = (P_t − 2 P_{t−h} + P_{t−2h}) / 2^j, where P is the running sum of the signal and
    h = 2^(j−1). Then M_j = N − 2^j + 1, and twice ν̂_j² is the Allan variance at the averaging time τ_j / 2.

    The robust estimate is the M-estimate of scale of the same coefficients: the σ² for which the mean of ρ(W/σ) equals
    its expectation under N(0, 1), with Tukey's biweight ρ(r) = r²(1 − r²/c²)⁴ for |r| ≤ c, else 0. Outliers beyond
    c σ have no influence. A bad sample affects 2^j coefficients of level j: 1 % of bad samples has little effect on
    the first levels, but makes levels with 2^j > 25 useless. As the share of large outliers among the coefficients
    grows, ν̂² is biased downwards (by 21 % at a share of 10 %, efficiency 0.6). Above a share of 26 % (42 % at
    efficiency 0.8, 56 % at 0.9) the estimate is (MAD / 0.67449)², where MAD is the median of |W|.

    Parameters
    ----------
    x : Imu, Signal, (N,) array or (N, k) array in any unit
        Finite samples, at least 8 without a gap. For a Signal with gaps that are not filled, the coefficients of all
        segments are pooled, and no coefficient extends across a gap: ν̂_j² = Σ_s M_sj ν̂_sj² / Σ_s M_sj.
    rate : float
        Sampling rate (Hz); leave it out for an Imu or a Signal. Without it, an array has rate=1: times count samples.
    filter : str
        Wavelet filter, such as "haar", "d4" or "la8"; see `gmwm.filters.find_filter`. A filter with two or more
        vanishing moments removes a drift.
    transform : "modwt" or "dwt"
        Maximal-overlap or decimated transform.
    levels : int, optional
        Number of levels J; by default all levels that have a coefficient, floor(log2 N) for the Haar filter.
    robust : bool
        Whether to use the robust estimate.
    efficiency : float
        Efficiency of the robust estimate under Gaussian noise, from 0.3 to 0.99; higher values are closer to the
        classical estimate and less robust. A value other than 0.6 requires `robust=True`.
    confidence : float
        Confidence level of the limits, from 0.5 to below 1.
    fill_gaps : bool
        Whether to fill the gaps of a Signal that are short compared with the samples around them, see
        `Signal.fill_gaps`. The confidence limits account for the missing information.

    Returns
    -------
    WaveletVariance, or WaveletVariances for an Imu or several columns
        Levels, scales, variances (unit²), limits and counts; for an Imu or several columns a mapping of axis, or
        "column_0", …, to WaveletVariance. A constant signal has variance 0 at every level.

        For a robust estimate `diagnostics["robust"]["outcome"]` has the method of each level: "root", the solution of
        the equation; "mad", (MAD / 0.67449)², if there is no solution; "mean", the mean square of one or two
        coefficients; "zero", if more than half of the coefficients are zero and there is no solution, as at the fine
        levels of a coarsely quantised signal. The limits use the degrees of freedom times the efficiency. They are
        conservative, because the variance of a robust estimate is larger by a factor of 1 / efficiency at most.

    Raises
    ------
    DataError
        If the signal contains NaN or infinities, or its longest segment has fewer than 8 samples or fewer samples
        than the filter has taps.
    OptionError
        If an option has an invalid value, or `rate` contradicts the rate of the Signal.

    References
    ----------
    Percival, D. P. (1995), On estimation of the wavelet variance, Biometrika 82, 619-631; equation 1 of
    Balamuta, Guerrier, Molinari and Yang. Robust: Guerrier, Molinari, Victoria-Feser and Xu (2022), Robust two-step
    wavelet-based inference for time series models, JASA 117, 1996-2013.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(1).normal(size=4096)
    >>> wv = wavelet_variance(x, rate=100.0)
    >>> len(wv), bool(abs(wv.variance[0] - 0.5) < 0.05)
    (12, True)
    >>> x[::500] = 1000.0
    >>> bool(abs(wavelet_variance(x, rate=100.0, robust=True).variance[0] - 0.5) < 0.05)
    True
    >>> from gmwm import Imu
    >>> wavelet_variance(Imu.from_arrays({"gyro_x": x, "gyro_y": x}, rate=100.0))
    WaveletVariances(gyro_x, gyro_y: haar, 12 levels, 4096 samples at 100 Hz)
    """
    as_confidence(confidence)
    wavelet = find_filter(filter)
    one_of(transform, "transform", ("modwt", "dwt"))
    require_robust(robust, efficiency)
    signal = x if isinstance(x, Signal) else None
    if signal is None:
        segments = [as_vector(cast(ArrayLike, x), "x", finite=False)]
        rate = rate_of_array(rate)
    else:
        require_rate(rate, signal.rate)
        signal = signal.fill_gaps() if fill_gaps else signal
        segments = signal.segment_values()
        rate = signal.rate
    lengths = tuple(segment.size for segment in segments)
    n = max(lengths)
    if n < MINIMUM_SAMPLES:
        raise DataError(
            f"a wavelet variance needs at least {MINIMUM_SAMPLES} samples without a gap; got {n}", argument="x", got=n
        )
    deepest = deepest_level(n, wavelet, transform)
    if deepest < 1:
        raise DataError(
            f"the filter {wavelet.name} needs at least {wavelet.length} samples without a gap; got {n}", argument="x",
            got=n, advice="Use {--filter=haar}, or a longer recording.",
        )  # fmt: skip
    levels = as_level_count(levels, deepest, n)

    numbers = wavelet.numbers(levels)
    if wavelet.lags:
        _require_lags(wavelet, transform, robust=robust, longest=n)
    counts, eta = pooled_counts(lengths, numbers, wavelet, transform)
    diagnostics: dict[str, Any] = {}
    excess: Matrix | None = None
    if robust:
        slope = _slope(segments)  # raises an error if a value is not finite
        estimate = _robust(segments, wavelet, transform=transform, levels=levels, efficiency=efficiency)
        variance, diagnostics["robust"] = estimate.variance, dict(estimate.diagnostics)
        if estimate.isolated:
            classical = _classical(segments, wavelet, transform, levels)[0]
            if (lost := unrejected(estimate, classical, eta, efficiency)) is not None:
                diagnostics["robust"]["unrejected"], excess = lost
        clipped = [_clip(segment) for segment in segments]
        if any(part is not segment for part, segment in zip(clipped, segments, strict=True)):
            slope = _slope(clipped)
        eta = eta * efficiency
    else:
        variance, rises = _classical(segments, wavelet, transform, levels)
        slope = _slope(segments, rises)
    if not np.all(np.isfinite(variance)):
        raise DataError(TOO_LARGE, argument="x", advice=SCALE_DOWN)
    filled = 0 if signal is None else signal.filled
    lower, upper = chi_square_limits(variance, eta / loss_factor(filled, sum(lengths)), confidence)
    return WaveletVariance(
        levels=numbers, variance=variance, lower=lower, upper=upper, counts=counts, rate=rate, samples=sum(lengths),
        unit="" if signal is None else signal.unit, axis="" if signal is None else signal.axis, confidence=confidence,
        filter=wavelet.name, transform=transform, robust=robust, efficiency=efficiency if robust else None, slope=slope,
        diagnostics=diagnostics, excess=excess, segments=lengths if len(lengths) > 1 else (), filled=filled,
        rise=None if signal is None or len(lengths) == 1 else RiseSums.of(signal).slope(),
    )  # fmt: skip


def variances_alone(
    segments: Sequence[Vector], filter: WaveletFilter, transform: Transform, levels: int, efficiency: float | None
) -> Vector:
    """Estimate the wavelet variances of levels 1 … J, robust if an efficiency is given, without limits and remarks."""
    if efficiency is None:
        return _classical(segments, filter, transform, levels)[0]
    return _robust(segments, filter, transform=transform, levels=levels, efficiency=efficiency).variance


def _classical(
    segments: Sequence[Vector], filter: WaveletFilter, transform: Transform, levels: int
) -> tuple[Vector, list[float]]:
    """Compute mean squares by level, and the mean rises of segments from the Haar kernel."""
    if filter.lags:
        variance, rises = _classical(segments, HAAR, transform, levels)
        scales = filter.numbers(levels)[len(filter.lags) :]
        return np.concatenate([lag_moments(segments, filter.lags[::-1]), variance[scales - 1]]), rises
    numbers = np.arange(1, levels + 1, dtype=np.int64)
    estimates, rises = [], []
    for segment, reach in _reaching(segments, filter, transform, levels):
        if _by_running_sum(filter, transform):
            variance, rise = _core.haar_variance(segment, reach)
            rises.append(rise)
        else:
            variance = variances(segment, filter, transform, reach)
        estimates.append((variance, coefficient_counts(segment.size, numbers[:reach], filter, transform)))
    if len(segments) == 1:
        return estimates[0][0], rises
    total, counts = np.zeros(levels), np.zeros(levels)
    for variance, numbers_used in estimates:
        total[: numbers_used.size] += numbers_used * variance
        counts[: numbers_used.size] += numbers_used
    return np.asarray(total / counts), rises


def _require_lags(filter: WaveletFilter, transform: Transform, *, robust: bool, longest: int) -> None:
    """Raise OptionError if the moments at lags cannot be estimated."""
    if robust or transform != "modwt":
        raise OptionError(
            argument="filter", expected="without lags for a robust estimate and for the decimated transform",
            got=filter.name,
            advice="Take outliers out of the signal before, with `gmwm.outliers.cleaned`, or leave the lags out.",
        )  # fmt: skip
    if longest < filter.lags[-1] + 2:
        raise OptionError(
            argument="filter", expected=f"lags up to {longest - 2}, because {longest} samples are without a gap",
            got=filter.name,
        )  # fmt: skip


def lag_moments(segments: Sequence[Vector], lags: Sequence[int]) -> Vector:
    """Compute the mean squares (L,) of (W_{1,t} + W_{1,t−l})/√2 at lags l, with Haar coefficients W_1 of level 1."""
    squares, counts = np.zeros(len(lags)), np.zeros(len(lags))
    for segment in segments:
        coefficients = np.diff(segment) / 2.0
        for k, lag in enumerate(lags):
            if coefficients.size > lag:
                both = coefficients[lag:] + coefficients[:-lag]
                squares[k] += both @ both / 2.0
                counts[k] += both.size
    return squares / counts


def _robust(
    segments: Sequence[Vector], filter: WaveletFilter, transform: Transform, levels: int, efficiency: float
) -> RobustVariances:
    """Compute robust estimates from all coefficients of all segments, with one estimating equation for each level."""
    sources: list[CoefficientSource] = [
        HaarCoefficients(segment, reach)
        if _by_running_sum(filter, transform)
        else _plain(segment, filter, transform, reach)
        for segment, reach in _reaching(segments, filter, transform, levels)
    ]
    return robust_variances(sources[0] if len(sources) == 1 else PooledCoefficients(sources), efficiency)


def _reaching(
    segments: Sequence[Vector], filter: WaveletFilter, transform: Transform, levels: int
) -> Iterator[tuple[Vector, int]]:
    """Yield the segments with at least one coefficient, and the number of levels of each."""
    for segment in segments:
        reach = min(levels, deepest_level(segment.size, filter, transform))
        if reach > 0:
            yield segment, reach


def _by_running_sum(filter: WaveletFilter, transform: Transform) -> bool:
    return filter is HAAR and transform == "modwt"


def _plain(values: Vector, filter: WaveletFilter, transform: Transform, levels: int) -> PlainCoefficients:
    """Return the coefficients as one array per level. Their rounding error is proportional to the filter length."""
    rounding = float(np.finfo(float).eps * np.abs(values).max() * filter.length)
    return PlainCoefficients(inner_coefficients(values, filter, transform, levels), [rounding] * levels)


def _slope(segments: Sequence[Vector], rises: Sequence[float] = ()) -> float:
    """Return the mean slope (unit per sample), weighted by squared lengths of segments, between those for a random walk
    and for white noise. `rises` are slopes from the kernel, not finite if a value or a sum is not (DataError)."""
    long = [segment for segment in segments if segment.size > 1]
    kernel_rises = rises or [math.nan] * len(long)
    slopes = [rise if math.isfinite(rise) else _rise(values) for rise, values in zip(kernel_rises, long, strict=True)]
    if len(long) == 1:
        return slopes[0]
    return float(np.average(slopes, weights=[float(segment.size) ** 2 for segment in long]))


def _rise(values: Vector) -> float:
    """Return the mean slope of one segment, from the means of its two halves."""
    half = values.size // 2
    with np.errstate(over="ignore", invalid="ignore"):
        first, second = float(values[:half].sum()), float(values[half:].sum())
    if not math.isfinite(first + second):
        require_finite(values, "x")
        raise DataError(TOO_LARGE, argument="x", advice=SCALE_DOWN)
    # The means of the two halves are N/2 samples apart.
    return (second / (values.size - half) - first / half) / (values.size / 2)


def _clip(values: Vector) -> Vector:
    """Clip values to 10 MAD from the median, so that outliers do not determine the slope."""
    sample = values[:: values.size // 4096 + 1]
    middle = float(np.median(sample))
    spread = float(np.median(np.abs(sample - middle)))
    low, high = middle - 10 * spread, middle + 10 * spread
    return values if spread == 0 or (values.min() >= low and values.max() <= high) else np.clip(values, low, high)
