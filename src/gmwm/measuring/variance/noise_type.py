"""Identification of the dominant power-law noise at a cluster size, by the lag 1 autocorrelation, B1 and R(n)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm.base import _core
from gmwm.base.arrays import Vector
from gmwm.measuring.variance.phase import inner_product


@dataclass(frozen=True)
class NoiseType:
    """Type of power-law noise, with its name in time keeping (PM: noise of the phase, FM: noise of its rate).
    `exponent` is α of the spectral density f^α of the rate, `slope` the slope of the Allan deviation (Hadamard
    deviation for α ≤ −3) over the averaging time on logarithmic axes, and `term` the name in inertial sensing or ""."""

    name: str
    exponent: int
    slope: float
    term: str = ""


NOISE_TYPES = (
    NoiseType("white PM", 2, -1.0, "quantization noise"), NoiseType("flicker PM", 1, -1.0),
    NoiseType("white FM", 0, -0.5, "angle or velocity random walk"),
    NoiseType("flicker FM", -1, 0.0, "bias instability"), NoiseType("random walk FM", -2, 0.5, "rate random walk"),
    NoiseType("flicker walk FM", -3, 1.0), NoiseType("random run FM", -4, 1.5),
)  # fmt: skip
"""The noise types in descending order of α."""
DRIFT = NoiseType("drift", -2, 1.0, "rate ramp")
"""A linear change of the rate. Its limits are computed for α = −2, the smallest α with a finite Allan variance."""
UNDETERMINED = NoiseType("undetermined", 0, -0.5)
"""The type of a constant recording. Confidence limits are computed as for white FM."""

AUTOCORRELATION = {
    2: {2: -0.6667, 0: -0.5, -1: -0.2169, -2: 0.25},
    3: {2: -0.75, 0: -0.6667, -1: -0.5348, -2: -0.3333, -3: -0.0354, -4: 0.3939},
}
"""Lag 1 autocorrelation of the phase differences of order d for large clusters, by d and then by α."""

_BY_EXPONENT = {noise.exponent: noise for noise in NOISE_TYPES}
_BY_NAME = {noise.name: noise for noise in (*NOISE_TYPES, DRIFT, UNDETERMINED)}


def noise_type(name: str) -> NoiseType:
    """Return the noise type with this name."""
    return _BY_NAME[name]


def exponents(noise: Sequence[NoiseType]) -> NDArray[np.int64]:
    """Return the exponents α of noise types."""
    return np.array([kind.exponent for kind in noise], dtype=np.int64)


def noise_types(
    phase: Vector, clusters: NDArray[np.int64], variance: Vector, *, reddest: int,
) -> tuple[NoiseType, ...]:  # fmt: skip
    """Identify the dominant noise at each cluster size, from the phase without a straight line and its `variance`.

    The phase is decimated to every n-th sample. If more than 1024 values remain, the 1024 values in the middle are
    used. The method depends on the number of values:

    - For at least 30 values, the lag 1 autocorrelation r₁ of their differences of order d is used. With
      δ = r₁/(1 + r₁), d increases until δ < 1/4, and α = 2 − 2d − round(2δ). For d ≥ 2 and n ≥ 2, cluster means are
      smoother than the fractional noise of this rule, so the α with the nearest theoretical r₁ is used.
    - For at least 10 cluster means, B1 is used, the ratio of their variance to their Allan variance.
    - For fewer cluster means, the type of the next smaller cluster is used.

    For n ≥ 8, the ratio of the modified to the overlapping Allan variance (`modified_ratio` of n) distinguishes white
    from flicker PM; for n ≥ 64 it can also reject PM. If the mean linear rise of the rate causes more than half of an
    Allan variance, the type is drift. `reddest` is the smallest α for which the variance is finite: −2 for the Allan
    variance, and −4 for the Hadamard variance, which a drift does not affect.

    Source: Riley and Greenhall (2004), Power law noise identification using the lag 1 autocorrelation, 18th EFTF. B1
    and R(n): NIST Special Publication 1065 (2008), section 5.5.
    """
    types = []
    last = UNDETERMINED
    for n, measured in zip(clusters.tolist(), variance.tolist(), strict=True):
        taken = phase[::n]
        means = taken.size - 1
        taken = _middle(taken)
        # With fewer than 16 clusters, a drift cannot be distinguished from a random walk.
        if reddest == DRIFT.exponent and means >= 16 and _drift_variance(phase, n) > measured / 2:
            last = DRIFT
        elif taken.size >= 30:
            last = _by_autocorrelation(taken, n, reddest) or last
        elif means >= 10 and last is not DRIFT:
            last = _by_ratio(taken, reddest) or last
        if last.exponent > 0 and n >= 8 and means >= 10:
            last = _by_modified_ratio(modified_ratio(phase, n), n)
        types.append(last)
    return tuple(types)


def _middle(phase: Vector) -> Vector:
    """Return the phase, or the middle 1024 values of a longer phase, which are enough to estimate r₁ to about 0.03."""
    first = max(phase.size - 1024, 0) // 2
    return np.ascontiguousarray(phase[first : first + 1024])


def _drift_variance(phase: Vector, n: int) -> float:
    """Compute the Allan variance of the mean linear rise, which is half the squared change of the rate per cluster."""
    # The mean of the second differences at every n-th sample telescopes to the differences at both ends.
    last = (phase.size - 1) // n * n
    change = (phase[last] - phase[last - n] - phase[n] + phase[0]) / (last // n - 1)
    return float(change / n) ** 2 / 2


def _by_autocorrelation(phase: Vector, n: int, reddest: int) -> NoiseType | None:
    z = phase
    for d in range(4):
        z = z - np.add.reduce(z) / z.size
        squares = inner_product(z, z)
        if not squares > 0:
            return None
        r1 = inner_product(z[:-1], z[1:]) / squares
        delta = r1 / (1 + r1)
        if delta < 0.25 or d == 3:
            break
        z = z[1:] - z[:-1]
    if d in AUTOCORRELATION and n > 1:
        expected = AUTOCORRELATION[d]
        alpha = min(expected, key=lambda exponent: abs(expected[exponent] - r1))
    else:
        alpha = min(2, 2 - 2 * d - round(2 * delta))
    return _BY_EXPONENT[max(reddest, alpha)]


def b1_ratio(means: int, mu: int) -> float:
    """Compute B1(N, μ), the expected ratio of the variance of N cluster means to their Allan variance, which is ∝ τ^μ.

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
    # The threshold between two types is the geometric mean of their ratios. Exponents −μ − 1, starting from PM noise.
    mu = -2
    while mu < 2 and ratio > math.sqrt(b1_ratio(rates.size, mu) * b1_ratio(rates.size, mu + 1)):
        mu += 1
    return _BY_EXPONENT[2 if mu == -2 else max(reddest, -mu - 1)]


def modified_ratio(phase: Vector, n: int) -> float:
    """Return the ratio of the modified to the overlapping Allan variance; 1 if the phase is too short for it."""
    if 3 * n > phase.size:
        return 1.0
    modified = _core.moving_second_differences(phase, n) / (phase.size - 3 * n + 1) / n**2
    plain = _core.second_differences(phase, n) / (phase.size - 2 * n)
    return modified / plain if plain > 0 else 1.0


def _by_modified_ratio(ratio: float, n: int) -> NoiseType:
    """Return the noise type for R(n): in theory 1/n for white PM, 3.37/(1.04 + 3 ln n) for flicker PM, ½ for white
    FM."""
    white, flicker, frequency = 1 / n, 3.37 / (1.04 + 3 * math.log(n)), 0.5
    if n >= 64 and ratio > math.sqrt(flicker * frequency):
        return _BY_EXPONENT[0]
    return _BY_EXPONENT[2 if ratio <= math.sqrt(white * flicker) else 1]
