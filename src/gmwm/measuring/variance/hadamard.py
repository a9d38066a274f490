"""Hadamard variance, which a linear change of the rate does not affect."""

from __future__ import annotations

from typing import Literal

from numpy.typing import ArrayLike

from gmwm.base import _core
from gmwm.measuring.variance.allan import difference_counts
from gmwm.measuring.variance.clusters import ClusterVariance, cluster_variance
from gmwm.measuring.variance.edf import degrees_of_freedom
from gmwm.measuring.variance.noise_type import exponents, noise_types
from gmwm.measuring.variance.phase import Clusters, Data, Progress, cluster_sizes, mean_squares, phase_of
from gmwm.recording.options import as_confidence, one_of
from gmwm.recording.signals import Signal


def hadamard_variance(
    x: Signal | ArrayLike, rate: float | None = None, *, kind: Literal["overlapping", "nonoverlapping"] = "overlapping",
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
    ClusterVariance
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
