"""Upper limits from the measured wavelet variance, for numbers that the covariance of the estimates leaves open."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from gmwm.base.arrays import Matrix, Vector
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.walk import RW


def variance_limit(
    wv: WaveletVariance, processes: Iterable[Process], of: Callable[[Process], float | Matrix]
) -> Matrix:
    """Return an upper limit of the variance that `of` computes, for any strengths of the processes.

    Let the processes p have the wavelet variances ν_p and the variances f_p at the same strength. At each level, the
    sum of c_p ν_p is at most the upper confidence limit of the measured variance, so that the sum of c_p f_p is at most
    this limit times max f_p/ν_p. The smallest of these bounds is the result. A random walk is always one of the
    processes, because slow noise of unknown correlation time looks like it.
    """
    seen = wv.variance > 0  # A variance of zero is due to the coarse resolution of the output.
    parts = [p for p in (*map(at_some_strength, processes), RW(gamma2=1.0)) if p.scale > 0]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ratios = [
            np.multiply.outer(1 / p.wavelet_variance(wv.levels, wv.rate, wv.filter)[seen], np.asarray(of(p)))
            for p in parts
        ]
        steepest = np.nanmax(np.array(ratios), axis=0)
    upper = wv.upper[seen].reshape((-1,) + (1,) * (steepest.ndim - 1))
    return np.asarray((upper * steepest).min(axis=0, initial=np.inf))


def strength_limit(wv: WaveletVariance, process: Process) -> float:
    """Return the largest factor of the variance of a process at which its wavelet variance exceeds the upper confidence
    limit of the measured one at no more than two levels, because two levels can be low by chance."""
    implied = process.wavelet_variance(wv.levels, wv.rate, wv.filter)
    seen = (wv.variance > 0) & (implied > 0)
    return float(np.sort(wv.upper[seen] / implied[seen])[:3].max(initial=0.0)) or float("inf")


def allan_limit(wv: WaveletVariance, process_ratio: Vector) -> float:
    """Return the upper limit of the Allan variance near the minimum of its measured curve: the largest of the upper
    confidence limits at the lowest level and its neighbours. `process_ratio` is the Allan variance over the wavelet
    variance of the model at the levels."""
    high = (process_ratio * wv.upper)[(wv.variance > 0) & np.isfinite(process_ratio)]
    if not high.size:
        return float("inf")
    k = int(np.argmin(high))
    return float(high[max(k - 1, 0) : k + 2].max())


def at_some_strength(process: Process) -> Process:
    """Return a process, with a scale of 1 if it is zero."""
    scale = process.scale_parameter()
    return process if process.scale > 0 else process.with_values(**{scale.name: process.value_from(1.0)})
