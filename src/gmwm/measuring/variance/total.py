"""Total variance, which is an Allan variance of the recording after it is extended beyond both ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base import _core
from gmwm.base.arrays import Vector
from gmwm.measuring.variance.clusters import ClusterVariance, cluster_variance
from gmwm.measuring.variance.edf import degrees_of_freedom
from gmwm.measuring.variance.noise_type import exponents, noise_types
from gmwm.measuring.variance.phase import Clusters, Data, Progress, cluster_sizes, mean_squares, phase_of
from gmwm.recording.options import as_confidence
from gmwm.recording.signals import Signal

# The constants (b, c, a) of Howe and Greenhall by noise exponent α. The degrees of freedom are b T/τ − c, and the
# expectation is (1 − a τ/T) σ²(τ), with the Allan variance σ² and the duration T of the recording.
_FREQUENCY_NOISE = {
    0: (1.5, 0.0, 0.0),
    -1: (24 * np.log(2) ** 2 / np.pi**2, 0.222, 1 / (3 * np.log(2))),
    -2: (140 / 151, 0.358, 0.75),
}
# The constant a for phase noise, for which an end value contributes to many differences. For white PM it is exact: each
# of the 2n differences that extend beyond an end has a variance of 10 σ² instead of 6 σ². For flicker PM it was
# determined by simulations.
_PHASE_BIAS = {2: -4 / 3, 1: -1.0}


def total_variance(
    x: Signal | ArrayLike, rate: float | None = None, *, clusters: Clusters | ArrayLike = "octave", data: Data = "rate",
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
    ClusterVariance
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
    phase = phase_of(x, rate, data)
    p = phase.values
    sizes = cluster_sizes(clusters, p.size - 2, phase.intervals // 2)
    counts = np.full(sizes.size, p.size - 2)
    squares = mean_squares(lambda n: _core.reflected_second_differences(p, n), sizes, counts, progress)
    variance = squares / (2.0 * sizes * sizes)
    noise = noise_types(p, sizes, variance, reddest=-2)
    freedom = total_degrees_of_freedom(exponents(noise), sizes, p.size)
    bias = 1 - _bias(exponents(noise)) * np.minimum(sizes / phase.intervals, 0.5)
    values = {"clusters": sizes, "variance": variance, "counts": counts, "degrees_of_freedom": freedom}
    return cluster_variance(phase, noise, confidence, bias=bias, family="total", kind="overlapping", **values)


def _bias(alphas: NDArray[np.int64]) -> Vector:
    """Return the constant a of the expected ratio 1 − a τ/T of the total variance to the Allan variance."""
    return np.array([_PHASE_BIAS[a] if a > 0 else _FREQUENCY_NOISE[a][2] for a in alphas.tolist()])


def total_degrees_of_freedom(alphas: NDArray[np.int64], clusters: NDArray[np.int64], points: int) -> Vector:
    """Compute the equivalent degrees of freedom of the total variance, at least 1. For white, flicker and random-walk
    noise of the rate they are b T/τ − c (Howe and Greenhall). For few samples per cluster, they are reduced by the same
    factor as those of the overlapping Allan variance. For white PM they are 72 (1 + 4/(3r))² / (64/r² + (320/r +
    140)/N) to leading orders in τ/T, with r = T/τ; this formula was derived for gmwm, and its term 64/r² comes from the
    end values. For flicker PM, simulations support the degrees of freedom of the overlapping Allan variance up to τ =
    T/4, and proportionality to T/τ beyond."""
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
