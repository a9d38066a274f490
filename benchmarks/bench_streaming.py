"""Wavelet variance of a record in chunks, against the same record in memory and against `numpy.cumsum`."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import numpy as np

import gmwm
from benchmarks.harness import Case

RATE = 400.0
SIZE = 10**7


def streamed(x: np.ndarray, chunk: int, robust: bool = False) -> gmwm.WaveletVariance:
    """The wavelet variance from chunks."""
    live = gmwm.WaveletAccumulator(RATE, robust=robust)
    for k in range(0, x.size, chunk):
        live.update(x[k : k + chunk])
    return live.result(robust=robust)


def merged(parts: list[gmwm.WaveletAccumulator]) -> gmwm.WaveletVariance:
    """That of parts which were measured apart."""
    whole = parts[0]
    for part in parts[1:]:
        whole = whole.merge(part)
    return whole.result()


def cases() -> Iterable[Case]:
    """10^7 samples in chunks of many sizes; what a merge costs."""
    x, buffer = np.random.default_rng(1).normal(size=SIZE), np.empty(SIZE)
    cumsum, whole = partial(np.cumsum, x, out=buffer), partial(gmwm.wavelet_variance, x, RATE)
    for chunk in (10**3, 10**5, 10**6):
        name, ours = f"10^7 samples in chunks of {chunk}", partial(streamed, x, chunk)
        yield Case(name, ours, "in memory", whole, 7, 2.0, items=SIZE)
        yield Case(name, ours, "np.cumsum", cumsum, 7)
    one = partial(streamed, x, SIZE)
    yield Case("10^7 samples in chunks of 1000", partial(streamed, x, 10**3), "one chunk", one, 7, 1.5, items=SIZE)
    robust = partial(streamed, x, 10**6, True)
    yield Case("10^7 samples in chunks of 1000000, robust", robust, "in memory", whole, 5, items=SIZE)
    plain = partial(streamed, x, 10**6)
    yield Case("10^7 samples in chunks of 1000000, robust", robust, "in chunks", plain, 5, 5.0, items=SIZE)
    parts = []
    for k in range(0, SIZE, SIZE // 100):
        part = gmwm.WaveletAccumulator(RATE, start=k)
        part.update(x[k : k + SIZE // 100])
        part.result()
        parts.append(part)
    yield Case("100 parts of 10^5 samples merged", partial(merged, parts), "in memory", whole, 7)
