"""Draw lost samples from their conditional distribution given the others, without a model of the noise.

A sample is a level (mean of w known samples on each side, beyond 32 neighbours) and a deviation, an autoregressive
process of order 32 with the autocovariance about the level. w has the smallest prediction error. Lost samples are drawn
together: with them, the filtered deviations are, in the least-squares sense, prediction errors of random known samples
with random signs. For Gaussian noise, this draw is exact: Papandreou, G. and Yuille, A. (2010), Gaussian sampling by
local perturbations, Advances in Neural Information Processing Systems 23. Beyond 64 samples, a gap has deviations from
another place about a straight line, and only its ends are drawn.

Second moments are those without losses, so the wavelet variance is unbiased; a mean would make it too small at short
scales, an interpolation too large at long ones (tests/filling)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector, runs_of
from gmwm.base.lazy import scipy

Places = NDArray[np.int64]
Range = tuple[int, int]

# All constants here are measured in tests/filling.
PREDICTING_NEIGHBOURS = 32  # number of neighbours on each side that predict a lost sample
LONGEST_PREDICTED_SAMPLES = 64  # longest gap (samples) that is predicted from neighbours
WIDEST_MEAN_SAMPLES = 1 << 16  # largest width w of the means on both sides of a gap (samples)
_RIDGE = 1e-3  # relative white noise in the autocovariance; it limits weights of neighbours of smooth signals
_TRAINING = 1 << 13  # number of positions from which width and autocovariance are estimated
_TRIALS = 64  # number of trials to find another place for a long gap


def drawn(values: Vector, present: NDArray[np.bool_], *, seed: int = 0, cuts: Sequence[int] = ()) -> Vector:
    """Replace samples (N,) that are not `present` by draws from their conditional distribution given the others.

    With equal losses and seed, prediction errors are from the same positions, which keeps the covariance of two axes.
    No gap extends over `cuts`, the first samples of ranges."""
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
            _draw(part, prediction.within(part), rng)
            x[span] += level
    np.copyto(x, values, where=present)
    return x


def _draw(known: _Known, prediction: _Prediction, rng: np.random.Generator) -> None:
    """Draw the lost samples of a range without cuts, in place."""
    prediction.draw(known, rng)
    gaps = runs_of(~known.present)
    gaps = gaps[gaps[:, 1] - gaps[:, 0] > 2 * prediction.order]
    if gaps.size:
        _draw_long(known, gaps, rng)
        # The ends are drawn again from the neighbours on both sides, so that a smooth signal stays smooth there.
        inner = np.ones(known.present.size, dtype=np.bool_)
        for first, last in gaps.tolist():
            inner[first : first + prediction.order] = inner[last - prediction.order : last] = False
        prediction.draw(_Known.of(known.values, inner), rng)


def _draw_long(known: _Known, gaps: Places, rng: np.random.Generator) -> None:
    """Replace the samples of long gaps (m, 2) by those of other places, about straight lines."""
    x, widths = known.values, dict[int, int]()
    for first, last in gaps.tolist():
        length = last - first
        octave = length.bit_length()
        if octave not in widths:
            middle = min(round(0.7 * 2**octave), x.size // 2)
            widths[octave] = known.best_width(middle, _widths(1, len(known) // 8, 4), rng)
        places = rng.integers(0, x.size - length + 1, _TRIALS)
        donor = int(places[np.argmax(known.before[places + length] - known.before[places])])
        begins = np.array([first, donor])
        # Means of one side, which is the other one at an end.
        a = known.level(begins, np.where(known.before[begins] > 0, x.size, begins + length), widths[octave])
        b = known.level(
            np.where(known.before[begins + length] < len(known), 0, begins), begins + length, widths[octave]
        )
        line = a[:, None] + np.outer(b - a, (np.arange(length) + 0.5) / length)
        x[first:last] = line[0] + rng.choice([-1.0, 1.0]) * (x[donor : donor + length] - line[1])


@dataclass(frozen=True, eq=False)
class _Known:
    """The known samples of a signal."""

    values: Vector  # (N,) samples minus their mean; 0, or draws, where they are lost
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

    def level(self, first: Places, last: Places, width: int) -> Vector:
        """Return the mean of the nearest `width` known samples before `first`, and as many from `last` on."""
        i, k = self.before.take(first, mode="clip"), self.before.take(last, mode="clip")
        begin, end = np.maximum(i - width, 0), np.minimum(k + width, len(self))
        sums = self.path[i] - self.path[begin] + self.path[end] - self.path[k]
        return np.asarray(sums / np.maximum(i - begin + end - k, 1))

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
) -> Vector:
    """Return the autocovariance (size,) about the level of both sides: the variance minus half the mean squared
    difference, which is far smaller in a drift, so that averaged products would be inaccurate."""
    wide = 2 * size - 2
    places = _inside(rng.integers(0, known.values.size - wide + 1, _TRAINING), wide, ranges)
    present = np.lib.stride_tricks.sliding_window_view(known.present, wide)[places].astype(np.float64)
    level = known.level(places, places + wide, width)[:, None]
    deviation = (np.lib.stride_tricks.sliding_window_view(known.values, wide)[places] - level) * present
    squares = (deviation**2).T @ present
    halves = 0.5 * (squares + squares.T) - deviation.T @ deviation
    pairs = present.T @ present
    sums = np.array([(np.trace(halves, lag), np.trace(pairs, lag)) for lag in range(size)])
    return np.asarray(np.trace(squares) / max(sums[0, 1], 1.0) - sums[:, 0] / np.maximum(sums[:, 1], 1.0))


@dataclass(frozen=True, eq=False)
class _Prediction:
    """Prediction of samples from the level and from their neighbours."""

    order: int  # number of neighbours on each side
    width: int  # width of the means that give the level
    autocovariance: Vector  # (n,) autocovariance about the level; n is greater than the order

    @classmethod
    def of(cls, known: _Known, ranges: Sequence[Range], rng: np.random.Generator) -> _Prediction:
        """Compute the prediction from the known samples in some ranges of a signal."""
        longest = max(int(known.before[last] - known.before[first]) for first, last in ranges)
        order = _neighbours(longest)
        width = known.best_width(4 * order, _widths(4 * order, longest // 8, 2), rng, ranges)
        return cls(order, width, _autocovariance(known, width, order + 1, ranges=ranges, rng=rng))

    def within(self, known: _Known) -> _Prediction:
        """Return the prediction for a range with fewer samples."""
        order = min(self.order, _neighbours(len(known)))
        return replace(self, order=order, width=max(min(self.width, len(known) // 8), 1))

    def error_filter(self) -> Vector:
        """Return the filter (order + 1,) that leaves the error of the prediction from the samples before."""
        variance, lags = self.autocovariance[0], np.arange(self.order)
        if not variance > 0:
            return np.append(1.0, np.zeros(self.order))
        correlation = self.autocovariance / variance
        matrix = correlation[np.abs(np.subtract.outer(lags, lags))]
        # White noise makes a matrix positive definite that is not, because lags are from different pairs of samples.
        matrix += np.eye(self.order) * (_RIDGE + 2 * max(-np.linalg.eigvalsh(matrix)[0], 0.0))
        return np.concatenate([[1.0], -np.linalg.solve(matrix, correlation[1 : self.order + 1])])

    def draw(self, known: _Known, rng: np.random.Generator) -> None:
        """Draw the lost samples of a range without cuts, in place."""
        order, size = self.order, known.values.size
        # Samples beyond both ends are lost, too, and the deviation is zero beyond them.
        beyond = 5 * order
        lost = np.pad(np.pad(~known.present, beyond - order, constant_values=True), order)
        # Only samples near lost ones matter. They are put in a row, where those of different gaps are far apart.
        counts = np.cumsum(np.pad(lost, (order + 1, order)), dtype=np.int32)
        near = np.flatnonzero(counts[2 * order + 1 :] > counts[: -2 * order - 1])
        lost, at = lost[near], near - beyond
        inside = (at >= 0) & (at < size)
        missing, given = inside & lost, inside & ~lost
        level = known.level(at - order, at + order + 1, self.width)
        deviation = np.where(given, known.values.take(at, mode="clip") - level, 0.0)
        prediction_error = self.error_filter()
        errors = np.convolve(deviation, prediction_error)[: at.size]
        solve = _least_squares(lost, prediction_error)
        smallest = errors + np.convolve(solve(errors), prediction_error)[: at.size]
        in_gap = np.pad(at[order:] - at[:-order] == order, (order, 0))  # all that the filter uses is from one gap
        pool = smallest[given & in_gap]
        # As residuals of any regression, they are smaller than the errors of the process.
        pool *= np.linalg.norm(smallest[in_gap]) / max(float(np.linalg.norm(pool)), np.finfo(float).tiny)
        samples = level + solve(errors - rng.choice(np.concatenate([pool, -pool]), at.size))
        known.values[at[missing]] = samples[missing]


def _least_squares(lost: NDArray[np.bool_], filter_: Vector) -> Callable[[Vector], Vector]:
    """Return the function that gives the `lost` samples that minimise the squares of filtered samples plus `errors`."""
    order, at = filter_.size - 1, np.flatnonzero(lost)
    products = np.append(np.correlate(filter_, filter_, "full")[order:], 0.0)
    bands = [np.full(at.size, products[0])]
    while len(bands) < at.size and (gaps := at[len(bands) :] - at[: -len(bands)]).min() <= order:
        bands.append(np.pad(products[np.minimum(gaps, order + 1)], (0, len(bands))))
    factor = scipy.linalg.cholesky_banded(np.array(bands), lower=True)

    def solve(errors: Vector) -> Vector:
        out = np.zeros(lost.size)
        out[at] = scipy.linalg.cho_solve_banded((factor, True), -np.correlate(errors, filter_, "full")[order:][at])
        return out

    return solve


def _neighbours(known: int) -> int:
    """Return the number of neighbours on each side, for a number of known samples."""
    return max(1, min(PREDICTING_NEIGHBOURS, known // 16))
