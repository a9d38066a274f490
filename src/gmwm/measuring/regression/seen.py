"""Collect from a recording that is not in memory what a regression needs: times, temperature, and sums over blocks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.threads import in_threads
from gmwm.measuring.regression.blocks import Clock
from gmwm.measuring.streaming.passes import curves_of, measure, shown
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.batches import Batch, Segments, Streamed, batches
from gmwm.recording.signals import Signal


@dataclass(frozen=True, eq=False)
class Seen:
    """Times, temperature (°C) and block sums of a recording that was read once in batches.

    `clock` is a signal with the segments and times of the recording. `sums` are over blocks of `length` samples, after
    outlying samples were clipped. `curves` are wavelet variances, if requested, with the effect of the conditions.
    """

    recording: Streamed
    clock: Signal
    temperature: Vector | None
    length: int
    sums: Mapping[str, Vector]
    curves: Mapping[str, WaveletVariance]

    @classmethod
    def of(cls, recording: Streamed, length: int, *, curves: bool = False, threads: int | None = None) -> Seen:
        """Read a recording and sum it over blocks of `length` samples. With `curves`, also measure its wavelet
        variances.

        Raises ReadError or DataError if `read` would refuse the recording.
        """
        segments, parts = Segments(), list[Vector]()
        sums = {axis: np.zeros(0) for axis in recording.axes}
        measured = curves_of(recording, recording.axes, robust=False) if curves else {}

        def see(batch: Batch) -> None:
            segments.update(batch)
            if batch.temperature is not None:
                parts.append(batch.temperature)
            clock = Clock.of(recording.rate, tuple(segments.ranges), tuple(segments.starts), length=length)
            own = clock.part(batch.first, batch.stop)
            for axis, signal in batch.signals.items():
                added = own.sums(signal.values, clipped=True)
                added[: sums[axis].size] += sums[axis]
                sums[axis] = added

        measure(shown(batches(recording), see), measured, threads)
        temperature = np.concatenate(parts) if parts else None
        count = segments.ranges[-1][1]
        values = np.zeros(count) if temperature is None else temperature
        like = Signal(values, recording.rate, segments=segments.ranges, starts=segments.starts)
        found = in_threads(lambda _, one: one.classical(), measured, threads=threads)
        return cls(recording, like, temperature, length=length, sums=sums, curves=found)

    def means(self, clock: Clock) -> dict[str, Vector]:
        """Return the block means of all axes. For a clock with blocks of another length, the recording is read again."""
        sums = self.sums if clock.length == self.length else Seen.of(self.recording, clock.length).sums
        return {axis: clock.mean_of(own) for axis, own in sums.items()}
