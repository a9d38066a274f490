"""Overlapping, nonoverlapping and modified Allan variances."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base import _core
from gmwm.measuring.variance.clusters import ClusterVariance, cluster_variance
from gmwm.measuring.variance.edf import degrees_of_freedom
from gmwm.measuring.variance.noise_type import exponents, noise_types
from gmwm.measuring.variance.phase import Clusters, Data, Progress, cluster_sizes, mean_squares, phase_of
from gmwm.recording.options import as_confidence, one_of
from gmwm.recording.signals import Signal


def allan_variance(
    x: Signal | ArrayLike, rate: float | None = None, *,
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
    x : Signal, or (N,) array in any unit
        At least 8 finite samples without a gap.
    rate : float
        Sampling rate (Hz); leave it out for a Signal.
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
    ClusterVariance
        Averaging times, variances, deviations, limits, degrees of freedom and noise types.

    Raises
    ------
    DataError
        If the signal has gaps that cannot be filled, NaN or infinities, or fewer than 8 samples.
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


def difference_counts(points: int, clusters: NDArray[np.int64], order: int, overlapping: bool) -> NDArray[np.int64]:
    """Count the differences of a phase at each cluster size n, which start at every value or every n-th value."""
    places = points - order * clusters
    return places if overlapping else (places - 1) // clusters + 1
