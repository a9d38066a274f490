"""Find bursts of large wavelet coefficients: knocks and motion, as opposed to noise with heavy tails.

Large coefficients of heavy tails are scattered; a knock has many neighbours with both signs, as the sensor returns.
Half a scale apart, a wrong sample or jump changes up to two, two wrong samples four, a simple pulse three or four."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base import _core
from gmwm.base.arrays import FrozenArrays, Vector, as_rate, as_vector, row_medians
from gmwm.base.documents import Documented
from gmwm.measuring.variance.biweight import NORMAL_QUARTILE
from gmwm.measuring.variance.open_segments import Panels, panel_length
from gmwm.recording.resolution import Sample, step_of
from gmwm.recording.signals import Signal

LARGE = 5.0
"""Size of a large coefficient, in local standard deviations (docs/validation/tails.md, as the next four constants)."""
FEWEST = 5  # smallest number of large coefficients in a burst
HUGE, FEW = 20.0, 3
"""Size of a coefficient that heavy tails cannot explain, and smallest number of large ones in a burst with it."""
APART = 8  # largest distance between neighbouring large coefficients of a burst, in half scales
MATERIAL = 0.01
"""Smallest share of the classical variance at which bursts matter. It changes a standard deviation by 0.5 %."""
RARE = 0.15  # Largest share of the time in bursts. A longer change is a state of the sensor, not a disturbance.
LONGEST = 10.0  # Longest scale (s) at which bursts are searched. At longer scales, a warm-up looks like a burst.
NEIGHBOURHOOD = 60.0
"""Time (s) over which a local standard deviation is measured: longer than knocks, shorter than changes of the noise."""
_SMALL, _FALSE = 3.5, 1e-4
"""For small bursts, the smallest size of a large coefficient, and the expected number of false bursts in a panel."""
_CHANCE = 0.01  # largest expected number of bursts in a panel that heavy tails explain
_ALONE, _BESIDE = 1.5, 32
"""For small bursts: largest spread of the noise beside (standard deviations), and smallest number of coefficients."""
_PIECES = 64  # smallest number of coefficients for a local standard deviation; its relative error is about 15 %
Indices = NDArray[np.int64]
Ranges = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Bursts(FrozenArrays, Documented):
    """Bursts of large wavelet coefficients at each of L levels.

    Attributes
    ----------
    tau : (L,) array
        Scales (s) at which bursts were searched, from level 1.
    energy : (L,) array
        Share of the classical wavelet variance that is due to large coefficients in bursts.
    time : (L,) array
        Share of the time in bursts.
    count : int
        Number of bursts at the level with the most bursts.
    """

    tau: Vector
    energy: Vector
    time: Vector
    count: int

    @property
    def material(self) -> NDArray[np.bool_]:
        """Whether rare bursts increase the variance of each level, an (L,) array."""
        return np.asarray((self.energy >= MATERIAL) & (self.time <= RARE))

    @property
    def found(self) -> bool:
        """Whether rare bursts increase the variance of at least one level."""
        return bool(np.any(self.material))


class BurstFinder:
    """Find bursts in samples that arrive in chunks; see `find_bursts`."""

    def __init__(self, rate: float) -> None:
        self.rate = as_rate(rate)
        self.panels = Panels(panel_length(self.rate))
        self.levels = _levels(self.rate)
        # Sums over panels by level: squares and those in bursts, coefficients and those in bursts, bursts.
        self._sums = np.zeros((5, self.levels))
        self._sample = Sample()
        self._step: float | None = None  # quantization step in this sample, once a panel is complete
        self._counted = 0  # samples from which the step was estimated

    def update(self, values: Vector) -> None:
        """Add the next samples of the segment."""
        self._sample.update(values)
        # Not anew for each of the short segments of a recording that loses many samples.
        if 8 * (self._sample.count - self._counted) > self._counted:
            self._step, self._counted = None, self._sample.count
        for panel in self.panels.divide(values):
            self._add(panel)

    def gap(self) -> None:
        """End the segment, because samples are missing before the next ones."""
        for panel in self.panels.end():
            self._add(panel)

    def result(self) -> Bursts:
        """Return the bursts of all samples."""
        self.gap()
        squares, within, count, occupied, bursts = self._sums
        reach = int(np.count_nonzero(count >= _PIECES / 2))
        energy = np.divide(within, squares, out=np.zeros(self.levels), where=squares > 0)[:reach]
        return Bursts(
            tau=np.ldexp(1.0, np.arange(1, reach + 1)) / self.rate, energy=energy,
            time=occupied[:reach] / count[:reach], count=int(np.max(bursts[:reach], initial=0.0)),
        )  # fmt: skip

    def _add(self, panel: Vector) -> None:
        if self._step is None:
            self._step = step_of(self._sample.values()) or 0.0
        for level in coefficients(panel, self.rate, self._step):
            bursts = _bursts(level, small=False)
            occupied, count = int(np.sum(bursts.last - bursts.first + 1)), bursts.first.size
            sums = level.energy, float(bursts.energy.sum()), level.size, occupied, count
            self._sums[:, level.number - 1] += sums


def find_bursts(x: Signal | ArrayLike, rate: float | None = None) -> Bursts:
    """Find bursts of large Haar wavelet coefficients in a signal.

    Parameters
    ----------
    x : Signal, or (N,) array
        Finite samples.
    rate : float, optional
        Sampling rate (Hz); needed only if `x` is an array.

    Raises
    ------
    DataError, OptionError
        If the samples or the rate cannot be used.

    Examples
    --------
    >>> x = np.random.default_rng(1).standard_t(5, size=100_000)
    >>> find_bursts(x, rate=100.0).found
    False
    >>> x[50_000:50_050] *= 20.0
    >>> find_bursts(x, rate=100.0).found
    True
    """
    segments = x.segment_values() if isinstance(x, Signal) else [as_vector(x, "x")]
    finder = BurstFinder(x.rate if isinstance(x, Signal) else as_rate(rate))
    for segment in segments:
        finder.update(segment)
        finder.gap()
    return finder.result()


class BurstCoefficients(NamedTuple):
    """The coefficients of a panel at one level, half a scale apart, and those of them that may be in a burst. `path` (n
    + 2,) are the sums of the samples up to each half scale; the coefficients are its second differences times `unit`.
    `at`, `w` and `ratio` (k,) are indices, values and absolute values in local standard deviations of the coefficients
    with a ratio beyond `_SMALL`. `piece` coefficients have the same local standard deviation `spread` (m,). `energy` is
    the sum of the squares of all."""

    number: int
    path: Vector
    unit: float
    at: Indices
    w: Vector
    ratio: Vector
    piece: int
    spread: Vector
    energy: float

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return self.path.size - 2

    def relative(self, at: Indices) -> Vector:
        """Return the absolute values of the coefficients `at` (any shape), in local standard deviations."""
        first, second, third = (self.path[at + k] for k in range(3))
        return _relative(np.abs((third - second) - (second - first)) * self.unit, at, self.spread, self.piece)


def _relative(size: Vector, at: Indices, spread: Vector, piece: int) -> Vector:
    """Return the sizes of coefficients `at` in local standard deviations."""
    return np.asarray(size / spread[np.minimum(at // piece, spread.size - 1)])


def coefficients(panel: Vector, rate: float, step: float) -> Iterator[BurstCoefficients]:
    """Yield the coefficients of a panel at each level searched for bursts; `step` is the quantization step or 0."""
    path = _core.running_sum(panel)
    for k in range(_levels(rate)):
        if path.size - 2 < _PIECES // 2:
            return
        unit, piece = 0.5 ** (k + 1), max(_PIECES, round(NEIGHBOURHOOD * rate / 2**k))
        # The standard deviation of the rounding error is step / √12.
        least = 12**-0.5 * step * 2.0 ** (-0.5 * (k + 1))
        at, w, spread, energy = _core.large_coefficients(path, unit, piece, least=least, limit=_SMALL)
        ratio = _relative(np.abs(w), at, spread, piece)
        yield BurstCoefficients(
            number=k + 1, path=path, unit=unit, at=at, w=w, ratio=ratio, piece=piece, spread=spread, energy=energy
        )  # fmt: skip
        path = np.ascontiguousarray(path[::2])


def burst_ranges(levels: Iterable[BurstCoefficients], *, small: bool = False) -> Ranges:
    """Return disjoint sample ranges (k, 2) of bursts; with `small`, also of coefficients below `LARGE`."""
    return _finest_ranges((level.number, _bursts(level, small)) for level in levels)


def pulse_ranges(levels: Iterable[BurstCoefficients], values: Vector, fewest: int) -> Ranges:
    """Return index ranges (k, 2) of the pulses in the samples of one panel, if a level has at least `fewest`."""
    return _finest_ranges((level.number, _pulses(level, values, fewest)) for level in levels)


def _finest_ranges(bursts_of_levels: Iterable[tuple[int, _LevelBursts]]) -> Ranges:
    """Return sample ranges of bursts, without those over bursts of finer levels, whose position is known better."""
    ranges = np.empty((0, 2), dtype=np.int64)
    for number, bursts in bursts_of_levels:
        if not bursts.first.size:
            continue
        new = np.stack([bursts.first << number - 1, (bursts.last + 2) << number - 1], axis=1)
        new = new[np.searchsorted(ranges[:, 0], new[:, 1]) == np.searchsorted(ranges[:, 1], new[:, 0], side="right")]
        ranges = np.concatenate([ranges, new])
        ranges = ranges[np.argsort(ranges[:, 0])]
    return ranges


def _levels(rate: float) -> int:
    """Return the number of levels at which bursts are searched."""
    reach = int(np.floor(np.log2(max(LONGEST * rate, 2.0))))
    return min(reach, int(np.log2(panel_length(rate) // _PIECES)))


class _LevelBursts(NamedTuple):
    """Bursts at one level of a panel: first and last large coefficient of each, and the sum of their squares."""

    first: Indices
    last: Indices
    energy: Vector


_NO_BURSTS = _LevelBursts(np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty(0))


def _bursts(level: BurstCoefficients, small: bool) -> _LevelBursts:
    """Return the bursts among the coefficients of one level of a panel."""
    at, w, ratio, large = level.at, level.w, level.ratio, LARGE
    # Hardly any level has so many neighbours, or a huge coefficient, and no other one has a burst.
    if not np.any(at[FEWEST - 1 :] - at[: 1 - FEWEST] <= APART * (FEWEST - 1)) and not np.any(ratio > HUGE):
        return _NO_BURSTS
    if small:
        # At this share of large coefficients, `FEWEST` of them are neighbours by chance in one panel of ten thousand.
        share = (_FALSE / (level.size * APART ** (FEWEST - 1))) ** (1 / FEWEST)
        ranked = np.append(np.sort(ratio)[::-1], _SMALL)
        large = min(LARGE, float(np.interp(share * (level.size - 1), np.arange(ranked.size), ranked)))
    chosen = ratio > large
    at, w, ratio = at[chosen], w[chosen], ratio[chosen]
    if at.size < FEW:
        return _NO_BURSTS
    begins = np.concatenate([[0], np.flatnonzero(np.diff(at) > APART) + 1])
    counts = np.diff(np.append(begins, at.size))
    positive = np.add.reduceat((w > 0).astype(np.int64), begins)
    huge = np.maximum.reduceat(ratio, begins) > HUGE
    by_chance = _largest_by_chance(int(np.count_nonzero(~huge)), level.size)
    chosen = (counts >= np.where(huge, FEW, FEWEST)) & (counts > by_chance) & (positive > 0) & (positive < counts)
    if small:
        chosen[chosen] = _beside(level, at[begins[chosen]], at[(begins + counts - 1)[chosen]] + 1) < _ALONE
    energy = np.add.reduceat(w**2, begins)
    return _LevelBursts(at[begins[chosen]], at[(begins + counts - 1)[chosen]], energy[chosen])


def _pulses(level: BurstCoefficients, values: Vector, fewest: int) -> _LevelBursts:
    """Return pulses: short changes of the mean, with few large coefficients (tests/outliers/test_pulses.py)."""
    from scipy.special import bdtrc

    at, w, ratio = level.at, level.w, level.ratio
    # Gaussian noise has no coefficient of 5.5 standard deviations. Between two blocks, a pulse is weak; such parts are
    # looked for once several pulses are known.
    limit = 5.5 if fewest > 1 else 4.5
    # Pulses of up to about 100 samples; longer ones are popcorn noise, if there are no knocks.
    if at.size < 2 * fewest or not 3 <= level.number <= (6 if fewest > 1 else 8) or not np.any(ratio > limit):
        return _NO_BURSTS
    begins = np.concatenate([[0], np.flatnonzero(np.diff(at) > APART) + 1])
    ends = np.append(begins[1:], at.size) - 1
    positive = np.add.reduceat((w > 0).astype(np.int64), begins)
    largest_ratio = np.maximum.reduceat(ratio, begins)
    returns = (positive > 0) & (positive <= ends - begins)
    if fewest == 1:  # a pulse at an end of the panel has one edge
        returns |= (at[begins] < 2) | (at[ends] > level.size - 3)
    chosen = returns & (largest_ratio > limit)
    for k in np.flatnonzero(chosen).tolist():
        first, last = int(at[begins[k]]), int(at[ends[k]])
        begin, end = first << level.number - 1, (last + 2) << level.number - 1
        part = values[begin:end] - row_medians(values[None, max(2 * begin - end, 0) : 2 * end - begin])
        # Heavy tails have large single samples, and up to three wrong samples in a row are found without a pulse.
        largest = part[np.argmax(np.abs(part))]
        wide = np.count_nonzero(np.abs(part / largest) > 0.5)
        chosen[k] = wide > (2 if np.sum(part) / largest > 2.5 else 3)
    # Beside a pulse, noise that is larger by chance does not hide it.
    most = np.maximum(_ALONE, largest_ratio / limit)
    chosen[chosen] = _beside(level, at[begins[chosen]], at[ends[chosen]] + 1) < most[chosen]
    # t noise with three degrees of freedom has (5.5/3.5)³ times as many beyond 3.5, and popcorn noise lasting changes.
    count, gaussian = np.count_nonzero(chosen), 4.7e-4 * level.size
    others = max(begins.size - round(gaussian + gaussian**0.5), count)
    if count < fewest or (fewest > 1 and bdtrc(count - 1, others, (_SMALL / 5.5) ** 3) > 0.003):
        return _NO_BURSTS
    return _LevelBursts(at[begins[chosen]], at[ends[chosen]], np.add.reduceat(w**2, begins)[chosen])


def _largest_by_chance(groups: int, size: int) -> float:
    """Return the largest number of large coefficients in a burst that heavy tails explain.

    A large sample makes two of them. With m samples large with probability p, runs with distances up to `APART` occur
    n·p·(2·APART·p)^(m−1) times. Groups with a huge one can be knocks, so they are not counted."""
    if groups == 0:
        return 0.0
    share = 2 * APART * groups / size
    return 2 * math.floor(1 + math.log(_CHANCE / groups) / math.log(share)) if share < 0.9 else math.inf


def _beside(level: BurstCoefficients, first: Indices, last: Indices) -> Vector:
    """Return the spread of the noise next to bursts (standard deviations); if the variance of the noise varies, it is
    larger there."""
    margin, spread = np.maximum(last - first, APART), np.zeros(first.size)
    length = np.maximum(margin, _BESIDE)
    for start in (first - margin - length, last + margin):
        begin, end = (np.clip(edge, 0, level.size) for edge in (start, start + length))
        for size in np.unique(end - begin).tolist():
            if size >= APART:
                rows = np.flatnonzero(end - begin == size)
                medians = row_medians(level.relative(begin[rows, None] + np.arange(size)))
                spread[rows] = np.maximum(spread[rows], medians)
    return spread / NORMAL_QUARTILE
