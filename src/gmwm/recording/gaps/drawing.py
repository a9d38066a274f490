"""Draw lost samples from their conditional distribution given the others, without a model of the noise.

A sample is a level (mean of w samples on each side), a linear prediction of its deviation from 32 neighbours on each
side, by the autocovariance about the level, and a residual: that of a random known place, with random sign. w has the
smallest prediction error. Beyond 64 samples the level is a straight line, and only ends are predicted.

With the best linear prediction, second moments are those without losses, so the wavelet variance is unbiased; a mean
would make it too small at short scales, an interpolation too large at long ones (tests/filling). Journel, A. G. (1974),
Geostatistics for conditional simulation of ore bodies, Economic Geology 69, 673-687."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix, Vector, runs_of

Places = NDArray[np.int64]
Range = tuple[int, int]

# All constants here are measured in tests/filling.
PREDICTING_NEIGHBOURS = 32  # number of neighbours on each side that predict a lost sample
LONGEST_PREDICTED_SAMPLES = 64  # longest gap (samples) that is predicted from neighbours
WIDEST_MEAN_SAMPLES = 1 << 16  # largest width w of the means on both sides of a gap (samples)
_RIDGE = 1e-3  # relative white noise in the autocovariance; it limits weights of neighbours of smooth signals
_TRAINING, _WINDOWS = 1 << 14, 1 << 12  # numbers of positions from which width and autocovariance are estimated
_CLEAN = 8  # number of samples that must also be known on each side of the position from which a residual is taken
_TRIALS = 64  # largest number of trials to find such a position
_SWEEPS, _GROUPS = 3, 4  # draws of each sample, as lost neighbours depend on each other, and groups drawn in turn


def drawn(values: Vector, present: NDArray[np.bool_], *, seed: int = 0, cuts: Sequence[int] = ()) -> Vector:
    """Replace samples (N,) that are not `present` by draws from their conditional distribution given the others.

    With equal losses and seed, residuals are from the same positions, which keeps the covariance of two axes. No gap
    extends over `cuts`, the first samples of ranges."""
    ranges = list(pairwise([0, *cuts, values.size]))
    if not all(np.any(present[first:last]) for first, last in ranges):
        raise ValueError("no sample is present")
    if np.all(present):
        return values
    rng = np.random.default_rng(seed)
    middle = [values[first:last][present[first:last]].mean() for first, last in ranges]
    x = np.zeros(values.size)
    for (first, last), level in zip(ranges, middle, strict=True):
        np.subtract(values[first:last], level, out=x[first:last], where=present[first:last])
    neighbours = _Known.of(x, present)
    prediction = _Prediction.of(neighbours, ranges, rng)
    for (first, last), level in zip(ranges, middle, strict=True):
        span = slice(first, last)
        if not np.all(present[span]):
            part = neighbours if len(ranges) == 1 else _Known.of(x[span], present[span])
            x[span] = _draw(part, prediction, rng) + level
    x[present] = values[present]
    return x


def _draw(known: _Known, prediction: _Prediction, rng: np.random.Generator) -> Vector:
    """Return the samples of a range without cuts, with draws for lost samples."""
    lost = runs_of(~known.present)
    gaps = _Gaps(lost[:, 0], lost[:, 1] - lost[:, 0])
    x, prediction = known.values.copy(), prediction.within(known)
    short = gaps.lengths <= 2 * prediction.near
    _draw_short(x, known, gaps.only(short), prediction=prediction, rng=rng)
    _draw_long(x, known, gaps.only(~short), prediction=prediction, rng=rng)
    return x


class _Gaps(NamedTuple):
    """Ranges of lost samples, with the first sample and the length of each."""

    firsts: Places
    lengths: Places

    def only(self, which: NDArray[np.bool_]) -> _Gaps:
        return _Gaps(self.firsts[which], self.lengths[which])


@dataclass(frozen=True, eq=False)
class _Known:
    """The known samples of a signal."""

    values: Vector  # (N,) samples minus their mean; 0 where they are lost
    present: NDArray[np.bool_]  # (N,)
    before: Places  # (N + 1,) number of known samples before each sample
    path: Vector  # (n + 1,) running sum of the n known samples

    @classmethod
    def of(cls, values: Vector, present: NDArray[np.bool_]) -> _Known:
        before = np.zeros(values.size + 1, dtype=np.int64)
        path = np.zeros(np.cumsum(present, out=before[1:])[-1] + 1)
        np.cumsum(values[present], out=path[1:])
        return cls(values, present, before, path)

    def __len__(self) -> int:
        return self.path.size - 1

    def sides(self, first: Places, last: Places, width: int) -> tuple[Vector, Vector]:
        """Return means of the nearest `width` known samples before `first` and from `last` on, or the other side's."""
        i = self.before[np.clip(first, 0, self.values.size)]
        k = self.before[np.clip(last, 0, self.values.size)]
        before, right = np.minimum(width, i), np.minimum(width, len(self) - k)
        a = (self.path[i] - self.path[i - before]) / np.maximum(before, 1)
        b = (self.path[k + right] - self.path[k]) / np.maximum(right, 1)
        return np.where(before > 0, a, b), np.where(right > 0, b, a)

    def level(self, first: Places, last: Places, width: int) -> Vector:
        """Return the level, which is the average of the means of both sides."""
        a, b = self.sides(first, last, width)
        return np.asarray(0.5 * (a + b))

    def best_width(
        self, length: int, widths: Sequence[int], rng: np.random.Generator, ranges: Sequence[Range] = ()
    ) -> int:
        """Return the width for which the level predicts the mean of `length` samples between both sides best."""
        places = _inside(rng.integers(0, self.values.size - length, _TRAINING), length, ranges)
        last = places + length
        count = self.before[last] - self.before[places]
        places, last, count = places[count > 0], last[count > 0], count[count > 0]
        if not places.size:
            return widths[0]
        mean = (self.path[self.before[last]] - self.path[self.before[places]]) / count
        errors = [float(np.mean((mean - self.level(places, last, width)) ** 2)) for width in widths]
        return widths[int(np.argmin(errors))]


def _inside(places: Places, length: int, ranges: Sequence[Range]) -> Places:
    """Return the distinct places at which `length` samples from there on are within one of the ranges."""
    places = np.unique(places)
    if len(ranges) < 2:
        return places
    ends = np.array([last for _, last in ranges])
    return np.asarray(places[ends[np.searchsorted(ends, places, side="right")] >= places + length])


def _widths(least: int, most: int, ratio: int) -> list[int]:
    """Return a geometric sequence of widths from `least` to `most`, with at least one width."""
    out = [least]
    while out[-1] * ratio <= min(WIDEST_MEAN_SAMPLES, most):
        out.append(out[-1] * ratio)
    return out


def _autocovariance(
    known: _Known, width: int, size: int, *, ranges: Sequence[Range], rng: np.random.Generator
) -> Matrix:
    """Return the covariance (size, size) of consecutive samples about the level of both sides: the variance minus half
    the mean squared difference, which is far smaller in a drift, so that averaged products would be inaccurate."""
    places = _inside(rng.integers(0, known.values.size - size + 1, _WINDOWS), size, ranges)
    present = np.lib.stride_tricks.sliding_window_view(known.present, size)[places].astype(np.float64)
    level = known.level(places, places + size, width)[:, None]
    deviation = (np.lib.stride_tricks.sliding_window_view(known.values, size)[places] - level) * present
    squares = (deviation**2).T @ present
    halves = 0.5 * (squares + squares.T) - deviation.T @ deviation
    pairs = present.T @ present
    sums = np.array([(np.trace(halves, lag), np.trace(pairs, lag)) for lag in range(size)])
    lags = np.abs(np.subtract.outer(np.arange(size), np.arange(size)))
    variance = np.trace(squares) / max(sums[0, 1], 1.0)
    covariance = variance - (sums[:, 0] / np.maximum(sums[:, 1], 1.0))[lags]
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T + _RIDGE * covariance[0, 0] * np.eye(size))


@dataclass(frozen=True, eq=False)
class _Prediction:
    """Prediction of the samples of a gap from the level and the neighbours on each side."""

    near: int  # number of neighbours on each side
    width: int  # width of the means that give the level
    covariance: Matrix  # (n, n) covariance of consecutive samples about the level; n is at least 4 `near`

    @classmethod
    def of(cls, known: _Known, ranges: Sequence[Range], rng: np.random.Generator) -> _Prediction:
        """Compute the prediction from the known samples in some ranges of a signal."""
        longest = max(int(known.before[last] - known.before[first]) for first, last in ranges)
        near = _neighbours(longest)
        width = known.best_width(4 * near, _widths(4 * near, longest // 8, 2), rng, ranges)
        return cls(near, width, _autocovariance(known, width, 4 * near, ranges=ranges, rng=rng))

    def within(self, known: _Known) -> _Prediction:
        """Return the prediction for a range with fewer samples."""
        near = min(self.near, _neighbours(len(known)))
        return replace(self, near=near, width=max(min(self.width, len(known) // 8), 1))

    def weights(self, length: int) -> Matrix:
        """Return weights (2 near, length) of the neighbours for each sample of a gap."""
        near, covariance = self.near, self.covariance
        if not covariance[0, 0] > 0:
            return np.zeros((2 * near, length))
        neighbours = np.r_[0:near, near + length : 2 * near + length]
        inside = np.arange(near, near + length)
        return np.linalg.solve(covariance[np.ix_(neighbours, neighbours)], covariance[np.ix_(neighbours, inside)])


def _neighbours(known: int) -> int:
    """Return the number of neighbours on each side, for a number of known samples."""
    return max(1, min(PREDICTING_NEIGHBOURS, known // 16))


class _Draw(NamedTuple):
    """Gaps of one length that are filled together; a gap's donor is the position that lends its residual."""

    first: Places
    donor: Places
    level: Matrix
    donor_level: Matrix
    sign: Matrix

    def group(self, k: int) -> _Draw:
        """Return every fourth gap, from gap number k on."""
        return _Draw._make(values[k::_GROUPS] for values in self)


def _draw_short(
    x: Vector, known: _Known, gaps: _Gaps, *, prediction: _Prediction, rng: np.random.Generator,
    levels: Vector | None = None,
) -> None:  # fmt: skip
    """Draw the samples of short gaps in place; levels are computed from known samples unless given."""
    near, width = prediction.near, prediction.width
    weights: dict[int, Matrix] = {}
    draws: dict[int, _Draw] = {}
    for length in np.unique(gaps.lengths).tolist():
        weights[length] = prediction.weights(length)
        mine = gaps.lengths == length
        first = gaps.firsts[mine]
        donor = _donors(known, length, first.size, rng)
        level = known.level(first - near, first + length + near, width) if levels is None else levels[mine]
        draw = draws[length] = _Draw(
            first=first,
            donor=donor,
            level=level[:, None],
            donor_level=known.level(donor - near, donor + length + near, width)[:, None],
            sign=rng.choice([-1.0, 1.0], first.size)[:, None],
        )
        inner = np.arange(length)
        x[first[:, None] + inner] = draw.level + draw.sign * (known.values[donor[:, None] + inner] - draw.donor_level)
    for _ in range(_SWEEPS):
        for group in range(_GROUPS):
            new = []
            for length, draw in draws.items():
                part = draw.group(group)
                inner = np.arange(length)
                offsets = np.r_[-near:0, length : length + near]
                donated = x[part.donor[:, None] + inner] - part.donor_level
                residual = donated - _around(x, part.donor, offsets, part.donor_level) @ weights[length]
                predicted = part.level + _around(x, part.first, offsets, part.level) @ weights[length]
                new.append((part.first[:, None] + inner, predicted + part.sign * residual))
            for places, samples in new:
                x[places] = samples


def _around(x: Vector, places: Places, offsets: Places, level: Matrix) -> Matrix:
    """Return the deviations of the neighbours of each place from the level; 0 beyond the ends of the signal."""
    index = places[:, None] + offsets
    inside = (index >= 0) & (index < x.size)
    return np.where(inside, x[np.clip(index, 0, x.size - 1)] - level, 0.0)


def _donors(known: _Known, length: int, count: int, rng: np.random.Generator) -> Places:
    """Return random places where `length` samples are known, and if possible also the samples next to them."""
    most = known.values.size - length
    places = rng.integers(0, most + 1, count)
    best = np.full(count, np.iinfo(np.int64).max)
    chosen = places.copy()
    open_ = np.arange(count)
    for _ in range(_TRIALS):
        first, last = np.maximum(places - _CLEAN, 0), np.minimum(places + length + _CLEAN, known.values.size)
        inside = length - (known.before[places + length] - known.before[places])
        around = (last - first) - (known.before[last] - known.before[first])
        # A lost sample inside the range counts more than all lost samples beside it.
        missing = inside * (2 * _CLEAN + 1) + around
        better = missing < best[open_]
        chosen[open_[better]], best[open_[better]] = places[better], missing[better]
        open_ = np.flatnonzero(best > 0)
        if not open_.size:
            break
        places = rng.integers(0, most + 1, open_.size)
    return chosen


def _draw_long(x: Vector, known: _Known, gaps: _Gaps, *, prediction: _Prediction, rng: np.random.Generator) -> None:
    """Draw the samples of long gaps in place, from the shortest gap to the longest."""
    present = np.ones(x.size, dtype=np.bool_)
    for first, length in zip(*gaps, strict=True):
        present[first : first + length] = False
    near, ends, levels = prediction.near, list[int](), list[float]()
    octaves = np.log2(np.maximum(gaps.lengths, 1)).astype(np.int64)
    for octave in np.unique(octaves).tolist():
        subset = gaps.only(octaves == octave)
        before = np.concatenate([[0], np.cumsum(present)])
        middle = min(round(1.4 * 2**octave), x.size // 2)
        width = known.best_width(middle, _widths(1, len(known) // 8, 4), rng)
        for first, length in zip(subset.firsts.tolist(), subset.lengths.tolist(), strict=True):
            places = rng.integers(0, x.size - length + 1, _TRIALS)
            donor = int(places[np.argmax(before[places + length] - before[places])])
            inner = (np.arange(length) + 0.5) / length
            a, b = known.sides(np.array([first, donor]), np.array([first, donor]) + length, width)
            line = a[:, None] + np.outer(b - a, inner)
            x[first : first + length] = line[0] + rng.choice([-1.0, 1.0]) * (x[donor : donor + length] - line[1])
            ends += [first, first + length - near]
            levels += [float(line[0][near // 2]), float(line[0][-near // 2])]
        for first, length in zip(*subset, strict=True):
            present[first : first + length] = True
    # The ends are drawn again from the neighbours on both sides, so that a smooth signal stays smooth there.
    places = np.array(ends, dtype=np.int64)
    ends_of_gaps = _Gaps(places, np.full(places.size, near))
    _draw_short(x, known, ends_of_gaps, prediction=prediction, rng=rng, levels=np.array(levels))
