"""A fast test for noise that axes share: it uses block means of long recordings, as a part of each calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from gmwm.applications.several.cross import tested
from gmwm.applications.several.matrices import measured, product_moment, units_of
from gmwm.applications.several.pairs import pairs_of
from gmwm.applications.several.result import SharedNoise
from gmwm.applications.several.streamed import Curves
from gmwm.applications.several.synchronous import synchronous_signals
from gmwm.base.arrays import Vector, freeze
from gmwm.base.errors import DataError, GmwmError
from gmwm.base.threads import in_threads
from gmwm.recording.signals import MINIMUM_SAMPLES, Signal

MOST = 1 << 20
"""Largest number of block means. The test of the 15 pairs of six axes then takes less than 5 % of the time of a
calibration: 0.32 s of 16.8 s for 6·10⁶ samples, and 0.22 s of 5.0 s for 10⁶ (measured once, on one core).
tests/calibration/test_shared_noise.py checks the rate of false alarms."""


def shared_noise(
    signals: Mapping[str, Signal], *, size: float = 0.05, threads: int | None = None
) -> tuple[SharedNoise, ...]:
    """Return the scales at which two axes share noise according to the test of `cross`, sorted by p-value.

    Of more than `MOST` samples, the means of blocks of 2^k samples are tested, with the smallest sufficient k; the k
    finest scales are then not tested. Linear trends are removed first, because two axes with unrelated drifts are
    correlated at the largest scales. Axes without noise at some scale are left out."""
    try:
        filled = synchronous_signals(signals, None)
        k = max(0, (len(next(iter(filled.values()))) - 1).bit_length() - MOST.bit_length() + 1)
        means = in_threads(lambda _, signal: _detrended(block_means(signal, k)), filled, threads=threads)
        own = in_threads(lambda _, signal: measured(signal, False, 0.6), means, threads=threads)
        own = {axis: wv for axis, wv in own.items() if np.all(wv.variance > 0)}
        unit = units_of(own)
        pairs = {" and ".join(pair): pair for pair in pairs_of(list(own))}
        if not pairs:
            return ()
        products = in_threads(lambda _, pair: product_moment(means, own, unit, pair=pair), pairs, threads=threads)
        moments = {pair: products[name] for name, pair in pairs.items()}
        found = tested(Curves(own, moments, {}), robust=False, efficiency=0.6, size=size, confidence=0.95)
    except GmwmError:
        return ()  # for example, there are too few samples without a gap; the calibration reports this
    return tuple(replace(one, level=one.level + k) for one in found.shared)


def block_means(signal: Signal, k: int) -> Signal:
    """Return the means of blocks of 2^k samples. The samples after the last whole block of a segment are dropped."""
    if k == 0:
        return signal
    size = 1 << k
    weight = np.full(size, 1 / size)
    parts: list[Vector] = []
    for values in signal.segment_values():
        count = values.size >> k
        if count >= MINIMUM_SAMPLES:
            parts.append(values[: count << k].reshape(count, size) @ weight)
    if not parts:
        raise DataError("every segment is too short")
    ends = np.cumsum([0, *(part.size for part in parts)]).tolist()
    values = freeze(np.concatenate(parts))
    segments = list(pairwise(ends))
    return Signal(values, signal.rate / size, signal.unit, signal.axis, segments=segments, filled=signal.filled >> k)


def _detrended(signal: Signal) -> Signal:
    """Subtract the least-squares line from a signal."""
    count = len(signal)
    time = np.arange(count) - (count - 1) / 2
    values = signal.values - signal.values.mean()
    values -= np.multiply(time, float(time @ values) / (count * (count**2 - 1) / 12), out=time)
    return replace(signal, values=freeze(values))
