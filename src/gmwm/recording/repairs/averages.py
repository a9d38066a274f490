"""Recognise a log whose noise lies far below its sampling rate, and average it to a lower rate."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gmwm.base.arrays import Vector, freeze
from gmwm.base.lazy import scipy
from gmwm.base.remarks import Fact, Quantity, Remark
from gmwm.base.threads import in_threads
from gmwm.base.time_base import TimeBase
from gmwm.recording.batches import Batch, Streamed
from gmwm.recording.chunks import Samples, samples_of, time_base_of, with_samples
from gmwm.recording.repairs.moving_average import moving_average
from gmwm.recording.repairs.stage import Stage
from gmwm.recording.resolution import step_of
from gmwm.recording.signals import Imu
from gmwm.recording.time_ranges import cut_base

_LENGTH, _MOST = 4096, 128  # length of the periodograms, and largest number of them
_FAST, _SLOW = (0.1, 0.45), (0.002, 0.01)  # frequencies, relative to the rate, whose spectral densities are compared
_EMPTY = 1e-4
"""Ratio of these densities below which the output of the sensor passed a steep filter. A random walk has 1e-3, and one
pole at 0.5 % of the rate 2e-3 (tests/recording/test_averages.py)."""
_PASSES, _BAND = 0.5, 0.03
"""Densities, relative to the slow one, down to which the noise passes the filter, and down to which it is fitted."""
_SHAPES = {1e3: (2, 3, 4, 6, 8, 12, 16), 1.0: (4, 6, 8, 12, 16), 3.0: (2,)}
"""Powers p of the shapes 1 / (1 + (f/b)^p / k)^k of a density by k: 1000, the limit of large k, is for averages and
windows (p = 2) and sharp edges (larger p), 1 for Butterworth filters of order p/2, and 3 for three equal poles."""
_OF_RATE = 3.0
"""Twice this frequency over the rate after averaging. The memory is far below a mean's length, so its error (7 % after
20 minutes) is small beside that of N; with 2, 95 % intervals of N cover in 88 % (validation/faults.py, cic)."""
_SLOWER, _FALLS, _SHORT = (0.0007, 0.0015), 100.0, 8
"""Lower frequencies, relative to the rate; ratio of their density to that of `_SLOW` above which the noise ends in
between, because a random walk has 36; and number of samples that are averaged to look there."""
_FALLS_ABOVE_ROUNDING = 4.0
"""The same ratio if the fast density is that of rounding. The steepness is then examined after averaging."""
_BLOCKS, _ROUNDING, _FAR, _STEEP = 5, 2.0, 8.0, 0.008
"""Least periodograms; fast density over that of rounding below it; multiple of the band for a comparison with its end;
and largest ratio: a walk has 0.016, two poles with a step of one standard deviation 0.007
(tests/recording/test_averages.py)."""
_FEWEST = 256  # smallest number of means


class SteepFilter(NamedTuple):
    """A filter far below the rate: samples to average (1: none), and its memory, the mean |τ| by autocovariance."""

    length: int = 1
    memory: float = 0.0


def steep_filters(batch: Batch) -> dict[str, SteepFilter]:
    """Return the steep filter of each axis."""
    most = max(len(batch) // _FEWEST, 1)
    filters = in_threads(
        lambda _, signal: _of_axis(list(signal.segment_values()), _rounding(signal.values)), batch.signals
    )
    return {axis: steep._replace(length=min(steep.length, most)) for axis, steep in filters.items()}


def averaged(recording: Imu | Streamed, length: int, memories: Mapping[str, float]) -> Imu | Streamed:
    """Return means of `length` samples, without incomplete ones before a gap. A filter's memory m correlates means,
    density 1 − d + d cos ω, d = m / length; a first-order recursion undoes it."""
    if not isinstance(recording, Imu):
        return _AveragedStream(recording, length, memories)
    averages = _Averages(length, recording.rate, memories)
    (part,) = averages.of([samples_of(recording, recording.axes)])
    base = averages.time_base(time_base_of(recording))
    return with_samples(recording, part, base, _remarks(recording.axes, length, recording.rate))


class _Averages:
    """Means of consecutive samples, from samples in any portions."""

    def __init__(self, length: int, rate: float, memories: Mapping[str, float]) -> None:
        self._length, self._old_rate, self._rate = length, rate, rate / length
        self._correlations = {axis: _correlation(memory / length) for axis, memory in memories.items()}
        self._states: dict[str, Vector] = {}
        self._starts, self._sizes = list[float](), list[int]()
        self._carry: dict[str, Vector] = {}
        self._begin: float | None = None  # time of the first sample of a run that has no mean yet

    def of(self, samples: Iterable[Samples]) -> Iterator[Samples]:
        """Yield the means."""
        for chunk in samples:
            yield from self._of_chunk(chunk)

    def time_base(self, base: TimeBase) -> TimeBase:
        """Return the time base of the means. Call it after the last samples."""
        return cut_base(replace(base, rate=self._rate), self._starts, self._sizes, base.left)

    def _of_chunk(self, chunk: Samples) -> Iterator[Samples]:
        columns = dict(chunk.values)
        if chunk.temperature is not None:
            columns["temperature"] = chunk.temperature
        means: dict[str, list[Vector]] = {name: [] for name in columns}
        runs, before = list[tuple[int, float]](), sum(self._sizes)
        for k, (begin, end, time) in enumerate(chunk.ranges()):
            if k or not chunk.continues:
                self._carry, self._states, self._begin = {}, {}, time
            joined = {
                name: np.concatenate([self._carry.get(name, np.empty(0)), x[begin:end]]) for name, x in columns.items()
            }
            count = (end - begin + next(iter(self._carry.values()), np.empty(0)).size) // self._length
            for name, x in joined.items():
                part = x[: count * self._length].reshape(-1, self._length).mean(axis=1)
                means[name].append(self._uncorrelated(name, part))
                self._carry[name] = x[count * self._length :].copy()
            if not count:
                continue
            if self._begin is not None:
                self._starts.append(self._begin + (self._length - 1) / 2 / self._old_rate)
                self._sizes.append(0)
                runs.append((sum(self._sizes), self._starts[-1]))
                self._begin = None
            elif not runs:
                runs.append((before - self._sizes[-1], self._starts[-1]))
            self._sizes[-1] += count
        if runs:
            values = {name: freeze(np.concatenate(parts)) for name, parts in means.items()}
            heat = values.pop("temperature", None)
            segment = len(self._sizes) - len(runs)
            yield Samples(values, self._rate, first=before, segment=segment, runs=tuple(runs), temperature=heat)

    def _uncorrelated(self, name: str, means: Vector) -> Vector:
        """Return means whose white noise is not correlated, from those of the filter."""
        theta = self._correlations.get(name, 0.0)
        if not theta or not means.size:
            return means
        state = self._states.get(name, -theta * means[:1])
        values, self._states[name] = scipy.signal.lfilter([1 + theta], [1, theta], means, zi=state)
        return np.asarray(values)


class _AveragedStream(Stage):
    """A recording in a file whose samples are averaged while they are read."""

    def __init__(self, stream: Streamed, length: int, memories: Mapping[str, float]) -> None:
        super().__init__(stream, every=length)
        self._length, self._memories, self._remarks = length, memories, _remarks(stream.axes, length, stream.rate)

    def samples(self) -> Iterator[Samples]:
        """Iterate over the means."""
        averages = _Averages(self._length, self._stream.rate, self._memories)
        yield from averages.of(self._stream.samples())
        self._base = averages.time_base(self._stream.time_base)


def _remarks(axes: Iterable[str], length: int, rate: float) -> tuple[Remark, ...]:
    facts: dict[str, Fact] = {"count": length, "rate": Quantity(rate / length, "Hz"), "log": Quantity(rate, "Hz")}
    return tuple(Remark.of("fault-undone", axis, case="filtered", **facts) for axis in axes)


def _rounding(values: Vector) -> float:
    """Return the variance of the rounding of an output; 0 if it is coarse, or has no quantization step."""
    sample = values[: 8 * _LENGTH]
    step = step_of(sample)
    return 0.0 if step is None or step > 2 * np.std(sample) else step**2 / 12


def _falls_steeply(smooth: Vector, passes: float) -> bool:
    """Return whether a smoothed density falls faster above the band `passes` than that of a random walk."""
    near, far = round(passes * _LENGTH / 8) - 1, round(_FAR * passes * _LENGTH / 8)
    return far < smooth.size and bool(np.median(smooth[far : far + 8]) < _STEEP * smooth[near])


def _correlation(share: float) -> float:
    """Return the coefficient θ of the moving average with the correlation (share/2) / (1 − share) of neighbours."""
    correlation = min(share / 2 / (1 - min(share, 0.5)), 0.45)
    return (1 - math.sqrt(1 - 4 * correlation**2)) / (2 * correlation) if correlation > 0 else 0.0


def _of_axis(pieces: Sequence[Vector], rounding: float = 0.0) -> SteepFilter:
    """Return the steep filter of an axis, from the samples of each segment and the variance of their rounding."""
    long = [x for x in pieces if x.size >= _LENGTH]
    if not long:
        return SteepFilter()
    rows = [np.lib.stride_tricks.sliding_window_view(x, _LENGTH)[:: _LENGTH // 2] for x in long]
    every = max(sum(map(len, rows)) // _MOST, 1)
    blocks = rows[0][::every] if len(rows) == 1 else np.concatenate(rows)[::every]
    spreads = np.var(blocks, axis=1)
    blocks = blocks[spreads <= 16 * np.median(spreads)]  # without motion, as in the inspection
    window, density = np.hanning(_LENGTH), np.zeros(_LENGTH // 2 + 1)
    for part in np.array_split(blocks, max(len(blocks) // 16, 1)):  # whose spectra fit in the cache of a processor
        spectra = np.fft.rfft((part - part.mean(axis=1, keepdims=True)) * window)
        density += np.sum(spectra.real**2 + spectra.imag**2, axis=0) / len(blocks)
    frequency = np.arange(density.size) / _LENGTH
    fast, slow, slower = (
        float(np.median(density[(frequency >= low) & (frequency < high)])) for low, high in (_FAST, _SLOW, _SLOWER)
    )
    is_rounding = len(blocks) >= _BLOCKS and fast < _ROUNDING * rounding * float(window @ window)
    if slower > (_FALLS_ABOVE_ROUNDING if is_rounding else _FALLS) * slow > 0:
        # The noise ends at a lower frequency, which shorter means show.
        means = [x[: x.size - x.size % _SHORT].reshape(-1, _SHORT).mean(axis=1) for x in pieces]
        steep = _of_axis(means, math.inf if is_rounding else 0.0)
        return SteepFilter(_SHORT * steep.length, _SHORT * steep.memory) if steep.length > 1 else SteepFilter()
    # The highest frequency up to which most of the noise passes, from densities smoothed over 8 frequencies.
    smooth = density[: density.size // 8 * 8].reshape(-1, 8).mean(axis=1)
    passing = np.flatnonzero(smooth > _PASSES * slow)
    if not passing.size:
        return SteepFilter()
    passes = float(passing[-1] + 1) * 8 / _LENGTH
    is_steep = 0 < fast < _EMPTY * slow or (is_rounding and _falls_steeply(smooth, passes))
    if not is_steep:
        return SteepFilter()
    # A model describes an average. Rounding hides the zeros that tell one from a longer filter.
    if not is_rounding and moving_average(density, 2.0 * len(blocks)) is not None:
        return SteepFilter()
    # The memory is ∫ (1 − S(f)/S(0)) / (πf)² df, with the fitted S in the band and 0 above half the rate.
    beyond = np.flatnonzero(smooth[passing[-1] :] <= _BAND * slow)
    end = 8 * int(passing[-1] + beyond[0]) if beyond.size else density.size
    band = slice(max(round(passes * _LENGTH / 8), 3), end)
    fitted = _fitted(frequency, np.log(density[band]), band, passes)
    fitted *= np.mean(density[band] / fitted[band])  # the fit of logarithms lies below the mean density
    share = np.append(fitted[1:end], density[end:]) / fitted[0]
    memory = (float(np.sum((1 - share) / frequency[1:] ** 2)) / _LENGTH + 2) / np.pi**2
    return SteepFilter(max(round(_OF_RATE / (2 * passes)), 1), max(memory, 0.0))


def _fitted(frequency: Vector, logs: Vector, band: slice, passes: float) -> Vector:
    """Return exp(a) / (1 + (f/b)^p / k)^k, fitted in a band to the logarithms of a density; a mean over the shapes,
    weighted by their likelihoods. Neighbouring frequencies of a Hann window are worth half of independent ones."""
    x = frequency[: band.stop] / (passes * np.geomspace(0.2, 1.5, 60)[:, None])
    curves, losses = list[Vector](), list[float]()
    for k, powers in _SHAPES.items():
        for power in powers:
            shapes = -k * np.log1p(x**power / k)
            variances = np.var(logs - shapes[:, band], axis=1)
            best = int(np.argmin(variances))
            curves.append(np.exp(shapes[best] + np.mean(logs - shapes[best, band])))
            losses.append(float(variances[best]))
    return np.asarray(np.average(curves, axis=0, weights=(min(losses) / np.array(losses)) ** (logs.size / 4)))
