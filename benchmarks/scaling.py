"""What things cost as the record, the model and the number of axes grow: seconds of single calls, a curve a method."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import allantools
import numpy as np
from numpy.typing import NDArray

import gmwm
from benchmarks.bench_wavelet_variance import pyramid, stationary
from benchmarks.harness import seconds

Array = NDArray[np.float64]
Along = Literal["samples", "terms", "axes"]

RATE = 100.0
BLOCK = 10**6
"""Samples that a stream hands over at a time, drawn once: what is timed is not the drawing of noise."""
LONGEST_CALL = 3.0
"""A curve of many lengths ends after a call of so many seconds, one of a stream excepted."""
BUDGET, MOST = 0.25, 25
"""Calls of one point: for so many seconds, at most so many, the first one not counted where there are more."""
TENTHS = (1, 3)

WALK = "GM(beta=0.5, sigma2=3e-8) + WN(sigma2=1e-6) + RW(gamma2=1e-12)"
AXES = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
BETAS = (20.0, 4.0, 0.8, 0.16, 0.032)


@dataclass(frozen=True)
class Curve:
    """One method: `seconds[k]` is the least time of a call at `at[k]` samples, terms or axes."""

    along: Along
    name: str
    at: tuple[int, ...]
    seconds: tuple[float, ...]


def curves(largest: int = 10**9, in_memory: int = 10**8) -> Iterator[Curve]:
    """Every curve; records of up to `largest` samples in a stream, up to `in_memory` at once."""
    yield from along_samples(largest, in_memory)
    yield from along_terms(min(in_memory, 10**6))
    yield from along_axes(min(in_memory, 10**6))


def lengths(largest: int, smallest: int = 1000) -> list[int]:
    """1, 3, 10, 30 … thousand, up to `largest`."""
    decades = range(len(str(smallest)) - 1, len(str(largest)))
    return [digit * 10**power for power in decades for digit in TENTHS if smallest <= digit * 10**power <= largest]


def least(call: Callable[[], object]) -> float:
    """Least time of several calls (s), the first left out; what disturbs a call only adds to it."""
    took = [seconds(call)]
    begin = time.perf_counter()
    while took[0] < LONGEST_CALL and len(took) <= MOST and (len(took) < 2 or time.perf_counter() - begin < BUDGET):
        took.append(seconds(call))
    return min(took[1:] or took)


# --- the length of the record -----------------------------------------------------------------------------------------


def along_samples(largest: int, in_memory: int) -> Iterator[Curve]:
    """Ours and what everyone has, on white noise; fits on a Gauss-Markov process, white noise and a walk."""
    noise = np.random.default_rng(1).standard_normal(in_memory)
    buffer = noise.copy()  # not empty: pages are given when they are first written
    whole = lengths(in_memory)
    powers = [2**k for k in range(10, in_memory.bit_length())]
    yield _curve("copy (np.copyto)", whole, lambda n: partial(np.copyto, buffer[:n], noise[:n]))
    yield _curve("np.cumsum", whole, lambda n: partial(np.cumsum, noise[:n], out=buffer[:n]))
    yield _curve("wavelet variance, in memory", whole, lambda n: partial(gmwm.wavelet_variance, noise[:n], RATE))
    yield _curve(
        "robust wavelet variance", whole, lambda n: partial(gmwm.wavelet_variance, noise[:n], RATE, robust=True)
    )
    yield _curve("NumPy pyramid", whole, lambda n: partial(pyramid, noise[:n], n.bit_length() - 1))
    yield _curve(
        "allantools.oadev", whole,
        lambda n: partial(allantools.oadev, noise[:n], rate=RATE, data_type="freq", taus="octave"),
    )  # fmt: skip
    yield _curve("pywt.swt", powers, lambda n: partial(stationary, noise[:n], n.bit_length() - 1))
    block = noise[:BLOCK].copy()
    yield _curve("wavelet variance, in chunks", lengths(largest), lambda n: partial(streamed, block, n), np.inf)
    model = gmwm.Model.parse(WALK)
    record = model.simulate(min(in_memory, 10**7), RATE, np.random.default_rng(1))
    fit = partial(gmwm.fit, model.structure)
    yield _curve("certified fit from the samples", lengths(record.size), lambda n: partial(fit, record[:n], RATE))


def streamed(block: Array, samples: int) -> gmwm.WaveletVariance:
    """The wavelet variance of a record that never is in memory: blocks handed over until there are enough samples."""
    live = gmwm.WaveletAccumulator(RATE)
    for k in range(0, samples, block.size):
        live.update(block[: samples - k])
    return live.result()


def _curve(
    name: str, at: Iterable[int], call: Callable[[int], Callable[[], object]], longest: float = LONGEST_CALL
) -> Curve:
    points: list[tuple[int, float]] = []
    for n in at:
        points.append((n, least(call(n))))
        if points[-1][1] > longest:
            break
    return Curve("samples", name, tuple(n for n, _ in points), tuple(took for _, took in points))


# --- the model, the axes ----------------------------------------------------------------------------------------------


def nested(terms: int) -> gmwm.Model:
    """So many Gauss-Markov processes, each five times as slow as the one before, and white noise."""
    processes = (f"GM(beta={beta}, sigma2={0.1 * (beta / BETAS[0]) ** 0.5})" for beta in BETAS[:terms])
    return gmwm.Model.parse(" + ".join((*processes, "WN(sigma2=1.0)")))


def along_terms(samples: int) -> Iterator[Curve]:
    """From a wavelet variance: the fit with and without certificate, the covariance, the choice of a model."""
    at = tuple(range(1, len(BETAS) + 1))
    models = [nested(k) for k in at]
    data = [gmwm.wavelet_variance(m.simulate(samples, RATE, np.random.default_rng(1)), RATE) for m in models]
    pairs = list(zip(models, data, strict=True))
    found: dict[str, Sequence[Callable[[], object]]] = {
        "certified fit": [partial(gmwm.fit, m.structure, wv) for m, wv in pairs],
        "fit without certificate": [partial(gmwm.fit, m.structure, wv, certify=False) for m, wv in pairs],
        "exact covariance": [partial(gmwm.covariance.wavelet_covariance, m, samples, RATE) for m in models],
        "choice within k GM + WN + QN + RW + DR": [
            partial(gmwm.select, f"{k}*GM + WN + QN + RW + DR", wv) for k, wv in zip(at[:4], data[:4], strict=True)
        ],
    }
    for name, calls in found.items():
        yield Curve("terms", name, at[: len(calls)], tuple(least(call) for call in calls))


def along_axes(samples: int) -> Iterator[Curve]:
    """Calibration of one to six axes within GM + WN + RW, on one thread and on two."""
    imu = gmwm.simulate(dict.fromkeys(AXES, WALK), rate=RATE, samples=samples, rng=1)
    at = (1, 2, 3, 4, 6)
    for threads, name in ((1, "calibration, one thread"), (2, "calibration, two threads")):
        calls = [partial(gmwm.calibrate, imu, "GM + WN + RW", axes=AXES[:k], threads=threads) for k in at]
        yield Curve("axes", name, at, tuple(least(call) for call in calls))
