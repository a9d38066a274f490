"""Choosing among the 79 models within 4·GM + WN + QN + RW + DR, against `numpy.cumsum` of 10^6 numbers."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import numpy as np

import gmwm
from benchmarks.bench_fit import RATE, TRUTH
from benchmarks.harness import Case

GENERAL = "4*GM + WN + QN + RW + DR"


def cases() -> Iterable[Case]:
    """One recording of 10^6 samples, 19 levels: from its wavelet variance, and from the samples."""
    x = TRUTH.simulate(10**6, RATE, np.random.default_rng(1))
    buffer = np.empty_like(x)
    cumsum = partial(np.cumsum, x, out=buffer)
    wv = gmwm.wavelet_variance(x, RATE)
    yield Case(
        "selection from a wavelet variance", partial(gmwm.select, GENERAL, wv), "np.cumsum of 10^6", cumsum, 7, 300.0
    )
    yield Case("from 10^6 samples", partial(gmwm.select, GENERAL, x, RATE), "np.cumsum of 10^6", cumsum, 7, 300.0)
