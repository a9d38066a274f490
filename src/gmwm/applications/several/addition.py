"""The test for noise that the axes of a recording share, from means over blocks, as an addition to a calibration."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from gmwm.applications.several.cross import Curves, cross_covariance
from gmwm.applications.several.matrices import measure, pairs_of, product_moment, units_of
from gmwm.applications.several.result import SharedNoise
from gmwm.applications.several.synchronous import synchronous_signals
from gmwm.base.arrays import Vector, freeze
from gmwm.base.errors import DataError, GmwmError
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.threads import in_threads
from gmwm.calibration.additions import RecordingAddition
from gmwm.calibration.findings import TEST_SIZE
from gmwm.calibration.recording_findings import pairs_facts
from gmwm.recording.chunks import MINIMUM_SAMPLES
from gmwm.recording.signals import Signal

if TYPE_CHECKING:
    from gmwm.recording.signals import Signal

MOST_BLOCK_MEANS = 1 << 20
"""Largest number of block means. The test then takes less than 5 % of the time of a calibration (0.32 s of 16.8 s)."""


def shared_noise(
    signals: Mapping[str, Signal], *, size: float = 0.05, threads: int | None = None, fill: bool = True
) -> tuple[SharedNoise, ...]:
    """Return the scales at which two axes share noise according to the test of `cross`, sorted by p-value. Of more than
    `MOST_BLOCK_MEANS` samples, the means of blocks of 2^k samples are tested, with the smallest sufficient k; the k
    finest scales are then not tested. Linear trends are removed first, because two axes with unrelated drifts are
    correlated at the largest scales. Axes without noise at some scale are left out. With `fill`, short gaps are filled
    first."""
    try:
        filled = synchronous_signals(signals, None, fill=fill)
        k = max(0, (len(next(iter(filled.values()))) - 1).bit_length() - MOST_BLOCK_MEANS.bit_length() + 1)
        means = in_threads(lambda _, signal: _detrend(block_means(signal, k)), filled, threads=threads)
        curves = in_threads(lambda _, signal: measure(signal, False, 0.6), means, threads=threads)
        curves = {axis: wv for axis, wv in curves.items() if np.all(wv.variance > 0)}
        unit = units_of(curves)
        pairs = {" and ".join(pair): pair for pair in pairs_of(list(curves))}
        if not pairs:
            return ()
        products = in_threads(lambda _, pair: product_moment(means, curves, unit, pair=pair), pairs, threads=threads)
        moments = {pair: products[name] for name, pair in pairs.items()}
        result = cross_covariance(Curves(curves, moments, {}), robust=False, efficiency=0.6, size=size, confidence=0.95)
    except GmwmError:
        return ()  # for example, there are too few samples without a gap; the calibration reports this
    return tuple(replace(noise, level=noise.level + k) for noise in result.shared)


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


def _detrend(signal: Signal) -> Signal:
    """Subtract the least-squares line from a signal."""
    count = len(signal)
    time = np.arange(count) - (count - 1) / 2
    values = signal.values - signal.values.mean()
    values -= np.multiply(time, float(time @ values) / (count * (count**2 - 1) / 12), out=time)
    return replace(signal, values=freeze(values))


class SharedNoiseAddition(RecordingAddition):
    """The scales at which two axes of a recording share noise."""

    def needs(self, axes: Sequence[str]) -> bool:
        """Return whether there are at least two axes."""
        return len(axes) > 1

    def of_recording(self, signals: Mapping[str, Signal], *, threads: int | None = None) -> tuple[SharedNoise, ...]:
        """Test all pairs of axes."""
        return shared_noise(signals, threads=threads, fill=False)

    def remarks(self, finding: Sequence[SharedNoise], axes: Collection[str], size: float) -> Iterator[Remark]:
        """Yield one remark if any of these axes share noise at this significance level. Axes with remaining motion or
        knocks must be left out. These affect several axes at once without being shared noise."""
        pairs = [pair for pair in finding if pair.pvalue <= size and set(pair.axes) <= set(axes)]
        if pairs:
            pairs.sort(key=lambda pair: -abs(pair.correlation))
            strongest = pairs[0]
            first, second = strongest.axes
            yield Remark.of(
                "noise-shared", case="calibration",
                **pairs_facts(tuple(dict.fromkeys("/".join(pair.axes) for pair in pairs))),
                first=first, second=second, correlation=strongest.correlation, tau=Quantity(strongest.tau, "s"),
                size=TEST_SIZE,
            )  # fmt: skip
