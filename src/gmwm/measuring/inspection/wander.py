"""Likelihood of block means: white noise, random walk, Gauss-Markov process and a course.

The sine transform z_k = √(2/n) Σ d_i sin(πki/n) of differences d of n means has the variances λ_k = σ² (2 − 2 cos θ_k)
+ γ² (2 + cos θ_k)/3 + g_k, θ_k = πk/n, exactly but for g (validation/study_trends.py). A grid finds the maximum."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Integers, Matrix, Vector
from gmwm.base.lazy import scipy
from gmwm.base.threads import computed_once

_LEAST = float(np.finfo(float).tiny)
_WALKS = np.concatenate([[0.0], np.geomspace(1e-6, 1e4, 60)])
"""Grid of γ²/σ²: the smallest is invisible in 1000 blocks, whose lowest θ² is 1e-5; the largest hides white noise."""
_TIMES = (1.5, 5.0, 16.0)
"""Correlation times of the Gauss-Markov process (blocks); above a tenth of the recording it is close to a walk."""
_PLATEAUS = np.geomspace(1e-2, 1e4, 13)
"""Spectral density of the Gauss-Markov process at low frequency, relative to the density of the white noise."""
FIRST = 3  # blocks at the beginning and the end in which a change is treated as a warm-up
Change = tuple[float, float, float, Vector]
"""Reduction of −2 log L by a jump or settling, its place and time constant (blocks), and weights of the noise model."""
Single = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class NoiseGrid:
    """Noise models on a grid, relative to white noise. `transform` is the sine transform of differences, `weights` are
    1/λ_k, `logs` Σ log λ_k, `walks` γ²/σ², `rest` λ_k without the walk, and `walk` λ_k of γ² = 1."""

    transform: Matrix
    weights: Matrix
    logs: Vector
    walks: Vector
    rest: Matrix
    walk: Vector


@computed_once(4)
def grid_of(blocks: int) -> NoiseGrid:
    """Return the grid for a number of block means."""
    k = np.arange(1, blocks)
    transform = np.sqrt(2 / blocks) * np.sin(np.pi * np.outer(k, k) / blocks)
    theta = np.pi * k / blocks
    white, walk = 2 - 2 * np.cos(theta), (2 + np.cos(theta)) / 3
    rests, walks = [np.repeat(white[None, :], _WALKS.size, axis=0)], [_WALKS]
    for time in _TIMES:
        if 10 * time > blocks:
            continue
        markov = _markov(transform, time)
        for plateau in _PLATEAUS:
            # With a Gauss-Markov process, every second ratio is enough: neighbours are still within 2.2.
            walks.append(_WALKS[::2])
            rests.append(np.repeat((white + plateau / (2 * time) * markov)[None, :], walks[-1].size, axis=0))
    ratios, variances_without = np.concatenate(walks), np.vstack(rests)
    variances = variances_without + ratios[:, None] * walk
    return NoiseGrid(
        transform=transform, weights=1 / variances, logs=np.sum(np.log(variances), axis=1), walks=ratios,
        rest=variances_without, walk=walk,
    )  # fmt: skip


@computed_once(8)
def _steps(blocks: int, first: int, last: int) -> Matrix:
    """Return the transformed jumps (n − 1, C) of size 1 before and in the middle of the blocks `first` to `last`."""
    columns = grid_of(blocks).transform[:, first - 1 : last]
    return np.hstack([columns, (columns[:, 1:] + columns[:, :-1]) / 2])


@computed_once(1)
def _changes(blocks: int) -> tuple[Vector, Single, Single]:
    """Return places (blocks), and for them `_searched` (S, P, n − 1) and (S, P, W) of `_courses_at`."""
    places = np.arange(FIRST, blocks - FIRST + 0.5, 0.5)
    courses, squares = _searched(_courses_at(places, blocks), blocks)
    return places, np.stack(courses), np.stack(squares)


def _searched(parts: Iterable[Matrix], blocks: int) -> tuple[list[Single], list[Single]]:
    """Return transformed courses c and Σ c²/λ in models of white noise and a walk, part by part, so that these need
    little memory. float32 finds the best course in half the time."""
    weights, courses, squares = grid_of(blocks).weights[: _WALKS.size].T, list[Single](), list[Single]()
    for part in parts:
        courses.append(part.astype(np.float32))
        squares.append((part**2 @ weights).astype(np.float32))
    return courses, squares


def _times_of(blocks: int) -> Vector:
    """Return the time constants of decays (blocks)."""
    return np.asarray(2.0 ** np.arange(int(math.log2(blocks)) - 2))


def _courses_at(places: Vector, blocks: int) -> Iterator[Matrix]:
    """Yield transformed courses (P, n − 1): a jump, and those that settle after a jump or, last, without one."""
    ramps = np.arange(blocks + 1) - places[:, None]
    jumps = _jumps_at(places, blocks)
    decays = [transformed(decay(ramps, tau)) for tau in _times_of(blocks)]
    yield from (jumps, *decays)
    # A mean that begins to move slowly looks like a jump if its time constant is shorter than two blocks.
    yield from (jumps - course for course in decays[1:])


def _jumps_at(places: NDArray[np.float64], blocks: int) -> NDArray[np.float64]:
    """Return transformed jumps of size 1 within blocks: a jump before the block and one after it, in proportion."""
    before, rows = places.astype(np.int64), grid_of(blocks).transform  # which is symmetric
    share = (places - before)[..., None]
    return np.asarray((1 - share) * rows[before - 1] + share * rows[before])


def decay(edges: Matrix, tau: float | Matrix) -> Matrix:
    """Return the means of e^(−t/τ), 0 for t < 0, between neighbouring times (the last axis)."""
    return np.asarray(np.diff(-tau * np.exp(-np.maximum(edges, 0.0) / tau)))


class _Boxes(NamedTuple):
    """Boxes between two places (blocks): places (P, 2), and `_searched` (P, n − 1) and (P, W)."""

    places: Matrix
    courses: Single
    squares: Single


@computed_once(1)
def _boxes(blocks: int) -> _Boxes:
    """Return the boxes of up to an eighth of the blocks, which all axes share."""
    places, length = list[Matrix](), 1.0
    while length <= blocks / 8:
        begins = np.arange(FIRST, blocks - FIRST - length, max(0.5, length / 8))
        places.append(np.stack([begins, begins + length], axis=1))
        length *= 1.5 if length < 2 else 2**0.5
    courses, squares = _searched((_box_courses(corners, blocks) for corners in places), blocks)
    return _Boxes(np.concatenate(places), np.concatenate(courses), np.concatenate(squares))


def _box_courses(places: Matrix, blocks: int) -> Matrix:
    """Return the transformed boxes between pairs of places (P, 2)."""
    return _jumps_at(places[:, 0], blocks) - _jumps_at(places[:, 1], blocks)


def transformed(courses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the differences of courses along the last axis, times `NoiseGrid.transform`, which is a sine transform."""
    return np.asarray(scipy.fft.dst(np.diff(courses), type=1, norm="ortho", overwrite_x=True))


class CoursePairs(NamedTuple):
    """Pairs of transformed courses c and s (P, n − 1), and Σ c²/λ, Σ c s/λ and Σ s²/λ (G, P) of each."""

    first: Matrix
    second: Matrix
    squares: tuple[Matrix, Matrix, Matrix]

    @classmethod
    def of(cls, weights: Matrix, first: Matrix, second: Matrix) -> CoursePairs:
        """Return pairs for noise models with these weights."""
        return cls(first, second, (weights @ (first**2).T, weights @ (first * second).T, weights @ (second**2).T))


@computed_once(2)
def waves_of(blocks: int, periods: tuple[float, ...]) -> CoursePairs:
    """Return the cosine and sine with each number of periods in the recording, which all axes share."""
    grid, phase = grid_of(blocks), 2 * np.pi * np.outer(periods, np.arange(blocks) + 0.5) / blocks
    cosines, sines = transformed(np.cos(phase)), transformed(np.sin(phase))
    return CoursePairs.of(grid.weights, cosines, sines)


def _markov(transform: Matrix, time: float) -> Vector:
    """Return the variances g_k that a Gauss-Markov process of variance 1 adds."""
    lags, decay = np.arange(len(transform) + 2), np.exp(-1 / time)
    means = (time * (1 - decay)) ** 2 * np.exp(-np.maximum(lags - 1, 0) / time)  # autocovariance of block means
    means[0] = 2 * time**2 * (1 / time - 1 + decay)
    of_differences = 2 * means[:-1] - means[1:] - np.concatenate([[means[1]], means[:-2]])
    i = np.arange(len(transform))
    covariance = of_differences[np.abs(i[:, None] - i)]
    return np.asarray(np.sum((transform @ covariance) * transform, axis=1))


def _gram(weights: Matrix, courses: Matrix) -> NDArray[np.float64]:
    """Return Σ a b/λ (G, p, p) of all pairs of transformed courses, regular for equal ones, as in the last block."""
    rows, columns = np.triu_indices(len(courses))
    gram = np.empty((len(weights), len(courses), len(courses)))
    gram[:, rows, columns] = gram[:, columns, rows] = weights @ (courses[rows] * courses[columns]).T
    gram[:, rows[rows == columns], rows[rows == columns]] *= 1 + 1e-10
    return gram


def _crossing(walks: Vector, excess: Vector) -> float:
    """Return the largest γ² at which `excess` is not positive, interpolated on the grid."""
    inside = excess <= 0
    largest = float(np.max(walks[inside]))
    # The walk grows from model to model, and starts again at zero for the next Gauss-Markov process.
    k = np.flatnonzero(inside[:-1] & ~inside[1:] & (walks[:-1] > 0) & (walks[1:] > walks[:-1]))
    if not k.size:
        return largest
    share = excess[k] / (excess[k] - excess[k + 1])
    return max(largest, float(np.max(walks[k] * (walks[k + 1] / walks[k]) ** share)))


@dataclass(frozen=True, eq=False)
class CourseProfile:
    """−2 log L, up to a constant, of G noise models and C courses with the best coefficient; `squares` estimate σ²."""

    values: Matrix
    squares: Matrix


class Likelihood:
    """The likelihood of n block means. A course is a known function of time with an unknown coefficient."""

    def __init__(self, means: Vector) -> None:
        self.means, self.size, self.grid = means, means.size, grid_of(means.size)
        self.z = self.grid.transform @ np.diff(means)
        self._flat = self.grid.weights @ self.z**2

    def without(self) -> CourseProfile:
        """Return the profile likelihood without a course."""
        return self._profile(self._flat[:, None])

    def with_one(self, courses: Matrix, squares: Matrix | None = None) -> CourseProfile:
        """Return the profile likelihood with one course; the result has a column for each of C transformed courses.
        `squares` are Σ c²/λ (G, C), if they are known."""
        cross = self.grid.weights @ (courses * self.z).T
        squares = self.grid.weights @ (courses**2).T if squares is None else squares
        return self._profile(self._flat[:, None] - cross**2 / squares)

    def with_pairs(self, pairs: CoursePairs, courses: Matrix | None = None) -> CourseProfile:
        """Return the profile likelihood with the two courses of a pair together, and p transformed `courses`; the
        result has a column for each pair."""
        u, v = (self.grid.weights @ (first * self.z).T for first in (pairs.first, pairs.second))
        (a, b, c), flat = pairs.squares, self._flat[:, None]
        if courses is not None and len(courses):
            # Of a pair, what the courses leave.
            cross, flat = self.grid.weights @ (courses * self.z).T, flat.copy()
            products = [self.grid.weights @ (x[:, None] * courses).reshape(-1, x.shape[1]).T for x in pairs[:2]]
            products = [each.reshape(len(each), -1, len(courses)).transpose(0, 2, 1) for each in products]
            sums = np.concatenate([cross[:, :, None], *products], axis=2)
            explained = np.linalg.solve(_gram(self.grid.weights, courses), sums)
            flat -= np.sum(cross * explained[:, :, 0], axis=1)[:, None]
            u, v = (x - np.sum(y * explained[:, :, :1], axis=1) for x, y in zip((u, v), products, strict=True))
            first, second = np.split(explained[:, :, 1:], 2, axis=2)
            of_first, of_second = products
            parts = (a * (1 + 1e-10), of_first, first), (b, of_first, second), (c * (1 + 1e-10), of_second, second)
            a, b, c = (whole - np.sum(x * y, axis=1) for whole, x, y in parts)
        return self._profile(flat - (u**2 * c - 2 * u * v * b + v**2 * a) / (a * c - b**2))

    def with_all(self, courses: Matrix, *, alone: bool = False) -> float:
        """Return the smallest −2 log L with all transformed courses (p, n − 1) together; `alone` as in `walk`."""
        used = slice(_WALKS.size if alone else None)
        weights = self.grid.weights[used]
        cross = weights @ (courses * self.z).T
        taken = np.sum(cross * np.linalg.solve(_gram(weights, courses), cross[:, :, None])[:, :, 0], axis=1)
        return float(np.min(self._minus2(self._flat[used] - taken, self.grid.logs[used])))

    def with_first(self, courses: Matrix) -> Vector:
        """Return the smallest −2 log L with the first of p transformed courses, with the first two, … together (p,)."""
        root = np.linalg.cholesky(_gram(self.grid.weights, courses))
        cross = np.linalg.solve(root, (self.grid.weights @ (courses * self.z).T)[:, :, None])[:, :, 0]
        return np.asarray(np.min(self._profile(self._flat[:, None] - np.cumsum(cross**2, axis=1)).values, axis=0))

    @cached_property
    def jump(self) -> Change:
        """The best jump."""
        return self._best_change(slice(1))

    @cached_property
    def settling(self) -> Change:
        """The best settling, after a jump or without one."""
        return self._best_change(slice(1, None))

    def _best_change(self, shapes: slice) -> Change:
        """Return the best change of these shapes, each at the best place beside white noise and a walk."""
        places, courses, squares = _changes(self.size)
        taken = self._taken(courses[shapes], squares[shapes])
        # For each shape and model, the place that explains most is the best one.
        values = self._minus2(self._flat[: _WALKS.size] - np.max(taken, axis=1), self.grid.logs[: _WALKS.size])
        rows = np.arange(len(values))
        best = places[np.argmax(taken[rows, :, np.argmin(values, axis=1)], axis=1)]
        values = self.with_one(np.stack(list(_courses_at(best, self.size)))[shapes][rows, rows]).values
        model, shape = np.unravel_index(np.argmin(values), values.shape)
        gain, times = float(np.min(self.without().values) - values[model, shape]), _times_of(self.size)
        time = np.concatenate([[0.0], times, times[1:]])[shapes][shape]
        return gain, float(best[shape]), float(time), self.grid.weights[model]

    def best_box(self) -> tuple[float, tuple[float, float], Vector]:
        """Return the reduction of −2 log L by the best box, its places (blocks), and the weights of the noise model,
        beside white noise and a random walk."""
        boxes = _boxes(self.size)
        best = np.unique(np.argmax(self._taken(boxes.courses, boxes.squares), axis=0))
        values = self.with_one(_box_courses(boxes.places[best], self.size)).values
        model, shape = np.unravel_index(np.argmin(values), values.shape)
        places, weights = boxes.places[best[shape]], self.grid.weights[model]
        for k in (0, 1, 0, 1):
            # The grid of places is as wide as an eighth of the length, and lengths are 41 % apart.
            near = np.repeat(places[None, :], 41, axis=0)
            near[:, k] += np.linspace(-0.25, 0.25, 41) * (places[1] - places[0])
            near = near[(near[:, 0] >= FIRST) & (near[:, 1] <= self.size - FIRST)]
            courses = _box_courses(near, self.size)
            places = near[np.argmax((courses @ (weights * self.z)) ** 2 / (courses**2 @ weights))]
        begin, end = places.tolist()
        return float(np.min(self.without().values) - values[model, shape]), (begin, end), weights

    def _taken(self, courses: Single, squares: Single) -> NDArray[np.float64]:
        """Return the part of Σ z²/λ that each course explains in models of white noise and a walk."""
        scale = max(float(np.max(np.abs(self.z))), _LEAST)  # float32 has a small range
        weighted = (self.grid.weights[: _WALKS.size] * (self.z / scale)).astype(np.float32)
        return np.asarray(scale**2 * np.square(courses @ weighted.T).astype(np.float64) / squares)

    def best_band(self, first: int) -> tuple[float, slice]:
        """Return the reduction of −2 log L by more power in a band of the frequencies θ_k, k > `first`, beside the best
        noise model, and the band."""
        power = self.grid.weights[int(np.argmin(self._minus2(self._flat, self.grid.logs)))] * self.z**2
        sums = np.cumsum(np.append(0.0, power / max(float(np.mean(power)), _LEAST)))[first:]
        best = 0.0, slice(first, first)
        widths = (2, 3, 4, 6, 8, 12, 16, 24, 32, 48)
        for width in filter(lambda width: 2 * width < sums.size, widths):
            ratio = np.maximum((sums[width:] - sums[:-width]) / width, 1.0)
            k = int(np.argmax(ratio))
            gain = width * (float(ratio[k]) - 1 - math.log(ratio[k]))
            best = max(best, (gain, slice(first + k, first + k + width)), key=lambda item: item[0])
        return best

    def with_steps(self, models: Integers, first: int, last: int) -> Matrix:
        """Return −2 log L of some models with a jump before or in the middle of each block from `first` to `last`."""
        shapes, weights = _steps(self.size, first, last), self.grid.weights[models]
        taken = ((weights * self.z) @ shapes) ** 2 / (weights @ shapes**2)
        return self._minus2(self._flat[models][:, None] - taken, self.grid.logs[models][:, None])

    def walk(self, courses: Matrix, *, alone: bool = False) -> tuple[float, float]:
        """Return γ² of a step of the random walk besides courses (p, n − 1), and its 95 % limit, by REML, which
        excludes frequencies that courses explain. With `alone`, no Gauss-Markov process can replace the walk."""
        grid, used = self.grid, _WALKS.size if alone else len(self.grid.walks)
        values, scales = self._restricted_likelihood(grid.weights[:used], grid.logs[:used], courses)
        best = int(np.argmin(values))
        # 95 % quantile of χ²₁. The usual 90 % for one-sided limits gives limits too low in 10 to 20 % of recordings,
        # because a Gauss-Markov process can replace a walk (docs/validation/trends.md).
        limit = _crossing(grid.walks[:used] * scales, values - values[best] - 3.841)
        if not grid.walks[best]:
            return 0.0, limit
        # Between two neighbours of `_WALKS`, whose ratio is 1.48.
        ratios = grid.walks[best] * np.geomspace(0.67, 1.5, 17)
        variances = grid.rest[best] + ratios[:, None] * grid.walk
        values, scales = self._restricted_likelihood(1 / variances, np.sum(np.log(variances), axis=1), courses)
        finer = int(np.argmin(values))
        best_walk = float(ratios[finer] * scales[finer])
        return best_walk, max(limit, best_walk)

    def _restricted_likelihood(self, weights: Matrix, logs: Vector, courses: Matrix) -> tuple[Vector, Vector]:
        """Return −2 log of the restricted likelihood, up to a constant, and σ², for each noise model."""
        squares, free = weights @ self.z**2, self.z.size - len(courses)
        if len(courses):
            gram = _gram(weights, courses)
            cross = weights @ (courses * self.z).T
            squares = squares - np.sum(cross * np.linalg.solve(gram, cross[:, :, None])[:, :, 0], axis=1)
            logs = logs + np.linalg.slogdet(gram)[1]
        squares = np.maximum(squares, _LEAST)
        return free * np.log(squares) + logs, squares / free

    def coefficient(self, model: int, course: Vector) -> float:
        """Return the coefficient of a transformed course for one noise model."""
        weights = self.grid.weights[model]
        return float(weights @ (course * self.z) / (weights @ course**2))

    def _profile(self, squares: Matrix) -> CourseProfile:
        return CourseProfile(self._minus2(squares, self.grid.logs[:, None]), squares)

    def _minus2(self, squares: Matrix, logs: Matrix) -> Matrix:
        # Differences that are all equal have no variance; log 0 would be −inf in every model.
        return np.asarray(self.z.size * np.log(np.maximum(squares, _LEAST)) + logs)
