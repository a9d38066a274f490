"""Estimating the wavelet variance of a signal."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm import _core
from gmwm._arrays import Vector, as_rate, as_vector, require_finite
from gmwm.errors import DataError, OptionError
from gmwm.signals import MINIMUM_SAMPLES, Signal
from gmwm.variance.result import WaveletVariance


def wavelet_variance(
    x: Signal | ArrayLike,
    rate: float | None = None,
    *,
    filter: Literal["haar"] = "haar",
    transform: Literal["modwt"] = "modwt",
    levels: int | None = None,
    confidence: float = 0.95,
) -> WaveletVariance:
    """Haar MODWT wavelet variance of a signal at all dyadic scales, with chi-square limits.

    With the running sum P of the signal (its mean removed) and h = 2^(j−1), the coefficients of level j are
    W_{j,t} = (P_t − 2 P_{t−h} + P_{t−2h}) / 2^j, and ν̂_j² is the mean of their squares over the
    M_j = N − 2^j + 1 that need no sample outside the record. Twice ν̂_j² is the Allan variance at the
    averaging time τ_j / 2.

    Parameters
    ----------
    x : Signal, or (N,) array in any unit
        At least 8 finite samples without a gap.
    rate : float
        Samples per second (Hz); taken from a Signal.
    levels : int, optional
        Number of levels J; all floor(log2 N) by default.
    confidence : float
        Level of the limits, between 0 and 1.

    Returns
    -------
    WaveletVariance
        Levels, scales, variances in unit², limits and counts. A constant signal has variance 0 at every level.

    Raises
    ------
    DataError
        If the signal has gaps, NaN or infinities, or fewer than 8 samples.
    OptionError
        If an option is not one of those it may be, or `rate` contradicts the Signal's.

    References
    ----------
    Percival, D. P. (1995), On estimation of the wavelet variance, Biometrika 82, 619-631; equation 1 of
    Balamuta, Guerrier, Molinari and Yang.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(1).normal(size=4096)
    >>> wv = wavelet_variance(x, rate=100.0)
    >>> len(wv), bool(abs(wv.variance[0] - 0.5) < 0.05)
    (12, True)
    """
    if filter != "haar":
        raise OptionError(f"filter must be 'haar', got {filter!r}")
    if transform != "modwt":
        raise OptionError(f"transform must be 'modwt', got {transform!r}")
    signal = x if isinstance(x, Signal) else None
    if signal is None:
        values = as_vector(x, "x", finite=False)
        rate = as_rate(rate)
    else:
        values = _whole(signal)
        if rate is not None and rate != signal.rate:
            raise OptionError(f"rate={rate:g} contradicts the signal's {signal.rate:g} Hz; leave rate out")
        rate = signal.rate
    n = values.size
    if n < MINIMUM_SAMPLES:
        raise DataError(f"x must have at least {MINIMUM_SAMPLES} samples for a wavelet variance, got {n}")
    deepest = n.bit_length() - 1
    if levels is None:
        levels = deepest
    if isinstance(levels, bool) or not isinstance(levels, int | np.integer) or not 1 <= levels <= deepest:
        raise OptionError(f"levels must be an integer from 1 to {deepest} for {n} samples, got {levels!r}")

    half = n // 2
    with np.errstate(over="ignore", invalid="ignore"):
        first, second = float(values[:half].sum()), float(values[half:].sum())
    if not math.isfinite(first + second):
        require_finite(values, "x")
        raise DataError("x is too large to be summed in double precision; scale it down")
    # The two halves' means lie N/2 samples apart.
    slope = (second / (n - half) - first / half) / (n / 2)

    numbers = np.arange(1, levels + 1, dtype=np.int64)
    variance = _core.haar_variance(values, int(levels))
    counts = coefficient_counts(n, numbers)
    lower, upper = chi_square_limits(variance, counts, numbers, confidence)
    return WaveletVariance(
        numbers, variance, lower, upper, counts, rate, n,
        unit="" if signal is None else signal.unit,
        axis="" if signal is None else signal.axis,
        confidence=confidence, slope=slope,
    )  # fmt: skip


def _whole(signal: Signal) -> Vector:
    if len(signal.segments) > 1:
        sizes = ", ".join(str(b - a) for a, b in signal.segments[:5])
        raise DataError(
            f"{signal.axis or 'the signal'} has gaps: {len(signal.segments)} segments of {sizes}"
            f"{', …' if len(signal.segments) > 5 else ''} samples; segments are never glued. Use signal.longest() "
            "or read(..., gaps='longest')"
        )
    return signal.values


def coefficient_counts(samples: int, levels: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number M_j = N − 2^j + 1 of Haar MODWT coefficients that lie inside the record."""
    return samples - (np.int64(1) << levels) + 1


def chi_square_limits(
    variance: Vector, counts: NDArray[np.int64], levels: NDArray[np.int64], confidence: float
) -> tuple[Vector, Vector]:
    """Limits η ν̂² / χ²_η(1 ∓ …) with η = max(M_j / 2^j, 1) degrees of freedom (equation in theory: Percival 1995).

    Raises
    ------
    OptionError
        If `confidence` does not lie between 0 and 1.
    """
    from scipy.special import gammaincinv

    if not 0 < confidence < 1:
        raise OptionError(f"confidence must lie between 0 and 1, got {confidence!r}; 95 % is 0.95")
    half = np.maximum(counts / (np.int64(1) << levels), 1.0) / 2
    tail = (1 - confidence) / 2
    return variance * half / gammaincinv(half, 1 - tail), variance * half / gammaincinv(half, tail)
