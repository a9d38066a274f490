"""Which power-law noise rules a record at a cluster size: the lag 1 autocorrelation method and its stand-ins."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector
from gmwm.variance.phase import inner_product


@dataclass(frozen=True)
class NoiseType:
    """One type of noise in the words of two fields.

    Parameters
    ----------
    name : str
        The word of time keeping, where PM is noise of the phase and FM of its rate.
    exponent : int
        α of the spectral density h f^α of the rate.
    slope : float
        Slope of the Allan (from α = −3: Hadamard) deviation over the averaging time, both logarithmic.
    term : str
        The word for it in inertial sensors; "" where they have none.
    """

    name: str
    exponent: int
    slope: float
    term: str = ""


NOISE_TYPES = (
    NoiseType("white PM", 2, -1.0, "quantization noise"),
    NoiseType("flicker PM", 1, -1.0),
    NoiseType("white FM", 0, -0.5, "angle or velocity random walk"),
    NoiseType("flicker FM", -1, 0.0, "bias instability"),
    NoiseType("random walk FM", -2, 0.5, "rate random walk"),
    NoiseType("flicker walk FM", -3, 1.0),
    NoiseType("random run FM", -4, 1.5),
)
"""The noises, from the bluest to the reddest."""
DRIFT = NoiseType("drift", -2, 1.0, "rate ramp")
"""No noise: a linear change of the rate. Its limits are those of the reddest noise an Allan variance bears."""
UNDETERMINED = NoiseType("undetermined", 0, -0.5)
"""What a record without any variation has; its limits are those of white FM."""

AUTOCORRELATION = {
    2: {2: -0.6667, 0: -0.5, -1: -0.2169, -2: 0.25},
    3: {2: -0.75, 0: -0.6667, -1: -0.5348, -2: -0.3333, -3: -0.0354, -4: 0.3939},
}
"""Lag 1 autocorrelation of the d-th differences of the phase, d to α to value, for clusters of many samples."""

_BY_EXPONENT = {noise.exponent: noise for noise in NOISE_TYPES}
_BY_NAME = {noise.name: noise for noise in (*NOISE_TYPES, DRIFT, UNDETERMINED)}

LEAST_AUTOCORRELATION = 30
"""Values of the decimated phase from which on the lag 1 autocorrelation decides (Riley and Greenhall)."""
LEAST_RATIO = 10
"""Cluster means from which on the ratio B1 decides; below, the type of the next smaller cluster stands."""
LEAST_DRIFT = 16
"""Clusters in the record from which on a ramp can be told from a random walk."""
LEAST_PHASE_RATIO = 8
"""Cluster size from which on the modified Allan variance tells white from flicker PM."""
LEAST_FREQUENCY_RATIO = 64
"""Cluster size from which on that ratio tells white FM from flicker PM as well."""
MOST_VALUES = 1024
MOST_DIFFERENCES = 3


def noise_type(name: str) -> NoiseType:
    """The noise type with this name.

    >>> noise_type("white FM").term
    'angle or velocity random walk'
    """
    return _BY_NAME[name]


def noise_types(
    phase: Vector,
    clusters: NDArray[np.int64],
    variance: Vector,
    *,
    reddest: int,
    modified_ratio: Callable[[int], float],
) -> tuple[NoiseType, ...]:
    """The noise that rules at each cluster size.

    The phase is taken at every n-th sample, or of very many values 1024 in the middle. With 30 such values or more,
    the lag 1 autocorrelation r₁ of their d-th differences tells: δ = r₁/(1 + r₁), d is raised until δ < 1/4, and
    α = 2 − 2d − round(2δ); from d = 2 and n = 2 on, where cluster means are smoother than the fractional noise behind
    that rule, α is the one whose own r₁ is nearest. With 10 cluster means or more it is B1, their variance over their
    Allan variance. PM noise of n >= 8 is told white from flicker by the ratio of the modified to the plain Allan
    variance, which from n = 64 on also rules it out. With fewer means the type of the next smaller cluster stands.
    Where more than half of an Allan variance is due to the mean linear rise of the rate, it is drift.

    Parameters
    ----------
    phase : (N + 1,) array
        The phase, a line removed.
    clusters : (n,) int array
        Cluster sizes, ascending.
    variance : (n,) array
        What was measured at these cluster sizes.
    reddest : int
        The smallest exponent α for which the variance exists: −2 for Allan's, −4 for Hadamard's, which knows no
        drift.
    modified_ratio : callable
        From a cluster size to the ratio of the modified to the plain Allan variance.

    References
    ----------
    Riley, W. J. and Greenhall, C. A. (2004), Power law noise identification using the lag 1 autocorrelation,
    18th European Frequency and Time Forum. B1 and R(n): Riley, W. J., Handbook of Frequency Stability Analysis,
    NIST Special Publication 1065 (2008), section 5.5.
    """
    found = []
    last = UNDETERMINED
    for n, measured in zip(clusters.tolist(), variance.tolist(), strict=True):
        taken = phase[::n]
        means = taken.size - 1
        taken = _middle(taken)
        if reddest == DRIFT.exponent and means >= LEAST_DRIFT and _drift_variance(phase, n) > measured / 2:
            last = DRIFT
        elif taken.size >= LEAST_AUTOCORRELATION:
            last = _by_autocorrelation(taken, n, reddest) or last
        elif means >= LEAST_RATIO and last is not DRIFT:
            last = _by_ratio(taken, reddest) or last
        if last.exponent > 0 and n >= LEAST_PHASE_RATIO and means >= LEAST_RATIO:
            last = _by_modified_ratio(modified_ratio(n), n)
        found.append(last)
    return tuple(found)


def _middle(phase: Vector) -> Vector:
    """The phase, or of a long one the samples in its middle: the error of r₁ is about 0.03."""
    first = max(phase.size - MOST_VALUES, 0) // 2
    return np.ascontiguousarray(phase[first : first + MOST_VALUES])


def _drift_variance(phase: Vector, n: int) -> float:
    """The Allan variance of the mean linear rise: half its squared change of the rate from cluster to cluster."""
    # Phases at every n-th sample: the mean of their second differences telescopes to their ends.
    last = (phase.size - 1) // n * n
    change = (phase[last] - phase[last - n] - phase[n] + phase[0]) / (last // n - 1)
    return float(change / n) ** 2 / 2


def _by_autocorrelation(phase: Vector, n: int, reddest: int) -> NoiseType | None:
    z = phase
    for d in range(MOST_DIFFERENCES + 1):
        z = z - z.mean()
        squares = inner_product(z, z)
        if not squares > 0:
            return None
        r1 = inner_product(z[:-1], z[1:]) / squares
        delta = r1 / (1 + r1)
        if delta < 0.25 or d == MOST_DIFFERENCES:
            break
        z = np.diff(z)
    if d in AUTOCORRELATION and n > 1:
        known = AUTOCORRELATION[d]
        alpha = min(known, key=lambda exponent: abs(known[exponent] - r1))
    else:
        alpha = min(2, 2 - 2 * d - round(2 * delta))
    return _BY_EXPONENT[max(reddest, alpha)]


def b1_ratio(means: int, mu: int) -> float:
    """B1(N, μ): expected ratio of the variance of N cluster means to their Allan variance τ^μ, without dead time.

    >>> b1_ratio(10, -1), b1_ratio(10, 1)
    (1.0, 5.0)
    """
    if mu == 0:
        return means * math.log(means) / (2 * (means - 1) * math.log(2))
    return means * (1 - float(means) ** mu) / (2 * (means - 1) * (1 - 2.0**mu))


def _by_ratio(phase: Vector, reddest: int) -> NoiseType | None:
    rates = np.diff(phase)
    steps = np.diff(rates)
    allan = inner_product(steps, steps) / (2 * steps.size)
    if not allan > 0:
        return None
    ratio = float(rates.var(ddof=1)) / allan
    # Between two types, the geometric mean of their ratios is the border. Exponents −μ − 1, from PM noise up.
    mu = -2
    while mu < 2 and ratio > math.sqrt(b1_ratio(rates.size, mu) * b1_ratio(rates.size, mu + 1)):
        mu += 1
    return _BY_EXPONENT[2 if mu == -2 else max(reddest, -mu - 1)]


def _by_modified_ratio(ratio: float, n: int) -> NoiseType:
    """By R(n), modified over plain Allan variance: 1/n in white PM, 3.37/(1.04 + 3 ln n) in flicker PM, 1/2 in FM."""
    white, flicker, frequency = 1 / n, 3.37 / (1.04 + 3 * math.log(n)), 0.5
    if n >= LEAST_FREQUENCY_RATIO and ratio > math.sqrt(flicker * frequency):
        return _BY_EXPONENT[0]
    return _BY_EXPONENT[2 if ratio <= math.sqrt(white * flicker) else 1]
