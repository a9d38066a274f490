"""Allan variances, the Hadamard variance, and the total variance of the recording extended beyond both ends."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base import _core
from gmwm.base.arrays import Integers, Vector
from gmwm.measuring.axis_results import ResultsByAxis, by_axis
from gmwm.measuring.variance.clusters import ClusterVariance, cluster_variance, over_segments
from gmwm.measuring.variance.noise_type import degrees_of_freedom, exponents, noise_types
from gmwm.measuring.variance.phase import Clusters, Data, Progress, cluster_sizes, mean_squares, phase_of
from gmwm.recording.options import as_confidence, one_of
from gmwm.recording.signals import Imu, Signal


@by_axis(lambda results: ResultsByAxis(results=results))
def allan_variance(
    x: Imu | Signal | ArrayLike, rate: float | None = None, *,
    kind: Literal["overlapping", "nonoverlapping", "modified"] = "overlapping",
    clusters: Clusters | ArrayLike = "octave", data: Data = "rate", confidence: float = 0.95,
    progress: Progress | None = None,
) -> ClusterVariance:  # fmt: skip
    """Estimate the Allan variance of a signal, half the mean squared difference of adjacent cluster means.

    With the phase p (running sum of the rate, times Δt) and clusters of n samples, τ = n Δt, it is the mean of
    (p_{i+2n} − 2 p_{i+n} + p_i)² / (2 τ²) over every i ("overlapping") or every n-th i ("nonoverlapping"). The
    "modified" variance averages the phase over n samples first, which distinguishes white from flicker phase noise.
    The overlapping variance at n = 2^(j−1) is twice the Haar wavelet variance of level j. For gyroscopes and
    accelerometers, which measure a rate, the phase is the angle or the velocity. A constant offset has no effect.

    The confidence limits use a noise type that is identified from the same data. At the longest averaging times the
    identification is uncertain: there the 95 % limits contain the true value for 87 to 90 % of recordings of white
    noise, and for 94 to 96 % of recordings of random walk or quantization noise.

    Parameters
    ----------
    x : Imu, Signal, (N,) array or (N, k) array in any unit
        At least 8 finite samples without a gap. The differences of all segments of a Signal are pooled, and none
        extends across a gap that is not filled.
    rate : float
        Sampling rate (Hz); leave it out for a Signal. Without it, an array has rate=1: times count samples.
    kind : "overlapping", "nonoverlapping" or "modified"
        Kind of Allan variance.
    clusters : "octave", "decade", "all", or (J,) int array
        Cluster sizes n (samples). "octave" means 1, 2, 4, 8, …, "decade" means 1, 2, 4, 10, 20, 40, …, and "all" means
        every size, which takes time proportional to N². An array must have ascending sizes up to N/2, or up to
        (N + 1)/3 for the modified variance.
    data : "rate" or "phase"
        Whether x contains samples of the rate or of its integral, in unit times second.
    confidence : float
        Confidence level of the limits, from 0.5 to below 1.
    progress : callable, optional
        Function progress(done, total), which is called before each cluster size and after the last one. Ctrl-C stops
        between two sizes.

    Returns
    -------
    ClusterVariance; for an Imu or several columns a mapping of axis, or "column_0", …, to ClusterVariance
        Averaging times, variances, deviations, limits, degrees of freedom and noise types.

    Raises
    ------
    DataError
        If the signal has NaN or infinities, or fewer than 8 samples without a gap.
    OptionError
        If an option has an invalid value, or `rate` contradicts the rate of the Signal.

    References
    ----------
    Riley, W. J. (2008), Handbook of Frequency Stability Analysis, NIST Special Publication 1065, equations 8, 11
    and 14; IEEE Std 952 for inertial sensors.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(1).normal(size=4096)
    >>> result = allan_variance(x, rate=100.0)
    >>> result.tau[:3], result.noise[0]
    (array([0.01, 0.02, 0.04]), 'white FM')
    >>> bool(abs(result.deviation[0] - 1) < 0.05)
    True
    """
    as_confidence(confidence)
    one_of(kind, "kind", ("overlapping", "nonoverlapping", "modified"))
    options: dict[str, Any] = {"rate": rate, "kind": kind, "data": data, "confidence": confidence, "progress": progress}
    divisor = 3 if kind == "modified" else 2
    pooled = over_segments(x, lambda part, sizes: allan_variance(part, clusters=sizes, **options), clusters, divisor)
    if pooled is not None:
        return pooled
    # All octaves are computed in the pass that sums the phase. The results are identical.
    at_octaves = kind == "overlapping" and isinstance(clusters, str) and clusters == "octave"
    phase = phase_of(x, rate, data, octaves=at_octaves)
    p = phase.values
    modified = kind == "modified"
    sizes = cluster_sizes(clusters, p.size // 3 if modified else phase.intervals // 2)
    if modified:
        counts = p.size - 3 * sizes + 1
        scale = sizes * sizes
        squares = mean_squares(lambda n: _core.moving_second_differences(p, n), sizes, counts, progress)
    else:
        counts, scale = difference_counts(p.size, sizes, 2, kind == "overlapping"), np.ones_like(sizes)
        octaves = phase.octaves
        if octaves is not None:
            squares = mean_squares(lambda n: float(octaves[n.bit_length() - 1]), sizes, counts, progress)
        else:
            step = 1 if kind == "overlapping" else 0
            squares = mean_squares(lambda n: _core.second_differences(p, n, step or n), sizes, counts, progress)
    variance = squares / (2.0 * scale * sizes * sizes)
    # Random walk FM (α = −2) is the reddest noise with a finite Allan variance (NIST SP 1065).
    noise = noise_types(p, sizes, variance, reddest=-2)
    freedom = degrees_of_freedom(
        exponents(noise), sizes, p.size, order=2, overlapping=kind != "nonoverlapping", modified=modified
    )
    values = {"clusters": sizes, "variance": variance, "counts": counts, "degrees_of_freedom": freedom}
    return cluster_variance(phase, noise, confidence, family="allan", kind=kind, **values)


def difference_counts(points: int, clusters: Integers, order: int, overlapping: bool) -> Integers:
    """Count the differences of a phase at each cluster size n, which start at every value or every n-th value."""
    places = points - order * clusters
    return places if overlapping else (places - 1) // clusters + 1


@by_axis(lambda results: ResultsByAxis(results=results))
def hadamard_variance(
    x: Imu | Signal | ArrayLike, rate: float | None = None, *,
    kind: Literal["overlapping", "nonoverlapping"] = "overlapping",
    clusters: Clusters | ArrayLike = "octave", data: Data = "rate", confidence: float = 0.95,
    progress: Progress | None = None,
) -> ClusterVariance:  # fmt: skip
    """Estimate the Hadamard variance of a signal, a sixth of the mean squared second difference of cluster means.

    With the phase p and clusters of n samples, τ = n Δt, it is the mean of (p_{i+3n} − 3 p_{i+2n} + 3 p_{i+n} − p_i)² /
    (6 τ²) over every i ("overlapping") or every n-th i ("nonoverlapping"). For white noise it equals the Allan
    variance. A linear change of the rate, such as during warm-up, has no effect on it.

    Parameters
    ----------
    x, rate, data, confidence, progress
        The same as for `allan_variance`.
    kind : "overlapping" or "nonoverlapping"
        Kind of Hadamard variance.
    clusters : "octave", "decade", "all", or (J,) int array
        The same as for `allan_variance`, but at most N/3.

    Returns
    -------
    ClusterVariance; for an Imu or several columns a mapping of axis, or "column_0", …, to ClusterVariance
        Averaging times, variances, deviations, limits, degrees of freedom and noise types.

    Raises
    ------
    DataError, OptionError
        The same as for `allan_variance`.

    References
    ----------
    Riley, W. J. (2008), Handbook of Frequency Stability Analysis, NIST Special Publication 1065, equations 16-20.

    Examples
    --------
    >>> import numpy as np
    >>> ramp = np.arange(64) / 8
    >>> bool(hadamard_variance(ramp, rate=1.0).variance.max() < 1e-25)
    True
    """
    as_confidence(confidence)
    one_of(kind, "kind", ("overlapping", "nonoverlapping"))
    options: dict[str, Any] = {"rate": rate, "kind": kind, "data": data, "confidence": confidence, "progress": progress}
    pooled = over_segments(x, lambda part, sizes: hadamard_variance(part, clusters=sizes, **options), clusters, 3)
    if pooled is not None:
        return pooled
    phase = phase_of(x, rate, data, straighten=True)
    p = phase.values
    overlapping = kind == "overlapping"
    sizes = cluster_sizes(clusters, phase.intervals // 3)
    counts = difference_counts(p.size, sizes, 3, overlapping)
    step = 1 if overlapping else 0
    squares = mean_squares(lambda n: _core.third_differences(p, n, step or n), sizes, counts, progress)
    variance = squares / (6.0 * sizes * sizes)
    # Random run FM (α = −4) is the reddest noise with a finite Hadamard variance (NIST SP 1065).
    noise = noise_types(p, sizes, variance, reddest=-4)
    freedom = degrees_of_freedom(exponents(noise), sizes, p.size, order=3, overlapping=overlapping)
    values = {"clusters": sizes, "variance": variance, "counts": counts, "degrees_of_freedom": freedom}
    return cluster_variance(phase, noise, confidence, family="hadamard", kind=kind, **values)


# Constants (b, c, a) of Howe and Greenhall by α: edf b T/τ − c, and expectation (1 − a τ/T) σ²(τ) over T.
_FREQUENCY_NOISE = {
    0: (1.5, 0.0, 0.0),
    -1: (24 * np.log(2) ** 2 / np.pi**2, 0.222, 1 / (3 * np.log(2))),
    -2: (140 / 151, 0.358, 0.75),
}
# a for phase noise, whose end values are in many differences: exact for white PM (each of 2n differences beyond an end
# has 10 σ² instead of 6 σ²), simulated for flicker PM.
_PHASE_BIAS = {2: -4 / 3, 1: -1.0}


@by_axis(lambda results: ResultsByAxis(results=results))
def total_variance(
    x: Imu | Signal | ArrayLike, rate: float | None = None, *,
    clusters: Clusters | ArrayLike = "octave", data: Data = "rate",
    confidence: float = 0.95, progress: Progress | None = None,
) -> ClusterVariance:  # fmt: skip
    """Estimate the total variance, an Allan variance with more degrees of freedom at long averaging times.

    The phase is extended beyond both ends by point reflection at the end values, and (p_{i+n} − 2 p_i + p_{i−n})² /
    (2 τ²) is averaged over all inner i of the recording. For white noise its expectation is the Allan variance. For
    flicker noise and a random walk it is smaller by the factor 1 − a τ/T, with a = 0.481 and 0.75, where T is the
    duration of the recording. For quantization noise it is larger by up to two thirds at the last octave. The estimate
    is not corrected for this bias. The confidence limits are corrected for it; they are limits of the Allan variance.

    Parameters
    ----------
    x, rate, data, confidence, progress
        The same as for `allan_variance`.
    clusters : "octave", "decade", "all", or (J,) int array
        The same as for `allan_variance`, but the names include sizes up to N/2, for which the theory of the limits
        holds; an array may have sizes up to N − 1.

    Returns
    -------
    ClusterVariance; for an Imu or several columns a mapping of axis, or "column_0", …, to ClusterVariance
        Averaging times, variances, deviations, limits, degrees of freedom and noise types.

    Raises
    ------
    DataError, OptionError
        The same as for `allan_variance`.

    References
    ----------
    Howe, D. A. (2000), The total deviation approach to long-term characterization of frequency stability, IEEE
    Transactions UFFC 47, 1102-1110; Greenhall, Howe and Percival (1999), Total variance, an estimator of long-term
    frequency stability, IEEE Transactions UFFC 46, 1183-1191; NIST Special Publication 1065, equations 25-26.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(1).normal(size=1024)
    >>> total_variance(x, rate=1.0).degrees_of_freedom[-1].round(1)
    np.float64(3.0)
    """
    as_confidence(confidence)
    options: dict[str, Any] = {"rate": rate, "data": data, "confidence": confidence, "progress": progress}
    pooled = over_segments(x, lambda part, sizes: total_variance(part, clusters=sizes, **options), clusters, 2)
    if pooled is not None:
        return pooled
    phase = phase_of(x, rate, data)
    p = phase.values
    sizes = cluster_sizes(clusters, p.size - 2, phase.intervals // 2)
    counts = np.full(sizes.size, p.size - 2)
    squares = mean_squares(lambda n: _core.reflected_second_differences(p, n), sizes, counts, progress)
    variance = squares / (2.0 * sizes * sizes)
    noise = noise_types(p, sizes, variance, reddest=-2)
    alphas = exponents(noise)
    freedom = total_degrees_of_freedom(alphas, sizes, p.size)
    a = np.array([_PHASE_BIAS[alpha] if alpha > 0 else _FREQUENCY_NOISE[alpha][2] for alpha in alphas.tolist()])
    bias = 1 - a * np.minimum(sizes / phase.intervals, 0.5)
    values = {"clusters": sizes, "variance": variance, "counts": counts, "degrees_of_freedom": freedom}
    return cluster_variance(phase, noise, confidence, bias=bias, family="total", kind="overlapping", **values)


def total_degrees_of_freedom(alphas: Integers, clusters: Integers, points: int) -> Vector:
    """Compute the edf of the total variance, ≥ 1: b T/τ − c for rate noise (Howe and Greenhall).

    Few samples per cluster reduce them as for the overlapping Allan variance. White PM has 72 (1 + 4/(3r))² / (64/r² +
    (320/r + 140)/N), r = T/τ, derived for gmwm to leading orders; 64/r² is from end values. Flicker PM has those of the
    Allan variance up to τ = T/4, then ∝ T/τ (simulations)."""
    # Number of samples per cluster that represents a recording in continuous time.
    fine = 1024
    intervals = points - 1
    r = intervals / clusters
    many = 1 + intervals * fine
    result = np.empty(clusters.size)
    for alpha in np.unique(alphas).tolist():
        where = alphas == alpha
        n, ratio, exponent = clusters[where], r[where], alphas[where]
        if alpha == 2:
            result[where] = 72 * (1 + 4 / (3 * ratio)) ** 2 / (64 / ratio**2 + (320 / ratio + 140) / intervals)
        elif alpha == 1:
            within = np.clip(n, 1, max(intervals // 4, 1))
            allan = degrees_of_freedom(exponent, within, points, order=2, overlapping=True)
            result[where] = allan * np.minimum(within / n, 1.0)
        else:
            b, c, _ = _FREQUENCY_NOISE[alpha]
            short = np.minimum(n, max(intervals // 4, 1))
            sampled = degrees_of_freedom(exponent, short, points, order=2, overlapping=True)
            smooth = degrees_of_freedom(exponent, short * fine, many, order=2, overlapping=True)
            result[where] = (b * ratio - c) * np.minimum(sampled / smooth, 1.0)
    return np.maximum(result, 1.0)
