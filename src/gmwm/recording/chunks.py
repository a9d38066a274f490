"""Consecutive samples of a recording: as they are read from a file, or those of a recording in memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

from gmwm.base.arrays import Vector
from gmwm.base.remarks import Remark
from gmwm.base.time_base import TimeBase

if TYPE_CHECKING:
    from gmwm.recording.signals import Imu

MINIMUM_SAMPLES = 8
"""Smallest number of samples of a segment that is read, for three wavelet levels. Pinned by tests/test_cuts.py."""


@dataclass(frozen=True, eq=False)
class Chunk:
    """Consecutive samples of a recording without a gap between them, delivered at one time.

    Attributes
    ----------
    values : mapping of axis name to (n,) array
        Samples of each axis (rad/s or m/s²).
    first : int
        Number of the first sample in the recording, from 0.
    segment : int
        Number of the segment of the samples, from 0. It increases if there is a gap between the previous chunk and this
        one.
    start : float
        Time of the first sample (s), on the clock of the recording.
    temperature : (n,) array or None
        Temperature (°C), if the recording has one.
    """

    values: Mapping[str, Vector]
    first: int
    segment: int
    start: float
    temperature: Vector | None = None

    def __len__(self) -> int:
        return int(next(iter(self.values.values())).size)

    def __getitem__(self, axis: str) -> Vector:
        return self.values[axis]


@dataclass(frozen=True, eq=False)
class Samples:
    """Consecutive samples of a recording, with the gaps between them."""

    values: Mapping[str, Vector]  # samples of each axis (rad/s or m/s²)
    rate: float  # samples per second (Hz)
    first: int  # number of the first sample in the recording, from 0
    segment: int  # number of the segment of the first sample, from 0
    # number and time (s) of each segment's first sample; the first segment may have begun before `first`
    runs: tuple[tuple[int, float], ...]
    temperature: Vector | None = None  # (n,) temperature (°C), if the recording has one

    def __len__(self) -> int:
        return int(next(iter(self.values.values())).size)

    @property
    def continues(self) -> bool:
        """Whether no sample is missing before the first one."""
        return self.runs[0][0] < self.first

    def ranges(self) -> Iterator[tuple[int, int, float]]:
        """Yield for each segment its half-open range of indices in `values`, and the time of its first sample (s)."""
        places = [max(sample - self.first, 0) for sample, _ in self.runs]
        for (begin, end), (sample, time) in zip(pairwise([*places, len(self)]), self.runs, strict=True):
            yield begin, end, time + (self.first + begin - sample) / self.rate

    def chunks(self, size: int) -> Iterator[Chunk]:
        """Divide the samples at gaps, and into chunks of at most `size` samples."""
        for k, ((begin, end, _), (sample, time)) in enumerate(zip(self.ranges(), self.runs, strict=True)):
            for a in range(begin, end, size):
                part = slice(a, min(a + size, end))
                yield Chunk(
                    {axis: values[part] for axis, values in self.values.items()},
                    first=self.first + a,
                    segment=self.segment + k,
                    start=time + (self.first + a - sample) / self.rate,
                    temperature=None if self.temperature is None else self.temperature[part],
                )


def samples_of(imu: Imu, axes: Sequence[str]) -> Samples:
    """Return the samples of some axes of a recording in memory."""
    first = imu.signals[axes[0]]
    runs = tuple((begin, time) for (begin, _), time in zip(first.segments, first.starts, strict=True))
    values = {axis: imu.signals[axis].values for axis in axes}
    return Samples(values, imu.rate, first=0, segment=0, runs=runs, temperature=imu.temperature)


def with_samples(imu: Imu, part: Samples, base: TimeBase, remarks: Sequence[Remark]) -> Imu:
    """Return a recording with other samples and additional remarks."""
    first, (begins, ends, starts) = imu.signals[next(iter(part.values))], zip(*part.ranges(), strict=True)
    signals = {
        axis: replace(
            imu.signals[axis], values=values, rate=part.rate, start=starts[0], starts=starts, filled=0,
            segments=tuple(zip(begins, ends, strict=True)), gaps_known=first.gaps_known or len(first.segments) == 1,
        )
        for axis, values in part.values.items()
    }  # fmt: skip
    return replace(imu, signals=signals, remarks=(*imu.remarks, *remarks), time_base=base, temperature=part.temperature)


def time_base_of(imu: Imu) -> TimeBase:
    """Return the time base of a recording in memory."""
    return imu.time_base or TimeBase(imu.rate, start=imu.signals[imu.axes[0]].start)
