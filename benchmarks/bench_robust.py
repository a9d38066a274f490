"""The robust wavelet variance of 10^6 samples at 19 levels against `numpy.cumsum`, for signals of several kinds."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import numpy as np
from numpy.typing import NDArray

import gmwm
from benchmarks.harness import Case

SAMPLES = 10**6


def signals() -> dict[str, NDArray[np.float64]]:
    """What sensors give: smooth, coarse, wandering and spoilt."""
    rng = np.random.default_rng(1)
    white = rng.standard_normal(SAMPLES)
    walk = np.cumsum(1e-3 * rng.standard_normal(SAMPLES))
    spoilt = white.copy()
    spoilt[rng.choice(SAMPLES, SAMPLES // 1000, replace=False)] *= 1000
    return {
        "white noise": white,
        "white noise in steps of 1 σ": np.round(white),
        "white noise in steps of 3 σ": np.round(white / 3),
        "white noise on a random walk": white + walk,
        "the same in steps of 2 σ": np.round((white + walk) / 2),
        "1 outlier in 1000": spoilt,
    }


def cases() -> Iterable[Case]:
    """Each signal at efficiency 0.6, the first one at 0.9 too."""
    buffer = np.empty(SAMPLES)
    for name, x in signals().items():
        for efficiency in (0.6, 0.9) if name == "white noise" else (0.6,):
            run = partial(gmwm.wavelet_variance, x, 1.0, robust=True, efficiency=efficiency)
            cumsum = partial(np.cumsum, x, out=buffer)
            yield Case(f"robust, efficiency {efficiency}: {name}", run, "np.cumsum of 10^6", cumsum, 15, 10.0)
