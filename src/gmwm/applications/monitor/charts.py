"""CUSUM charts of one axis, which monitor its standardised innovations at each Haar level.

Alarms do not depend on chunks: block sums add pairs, and chart statistics are integers in units of 2⁻²⁴."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import numpy as np

from gmwm.applications.monitor.whitening import numbers, whole, wholes
from gmwm.base.arrays import Integers, Vector
from gmwm.base.lazy import scipy

DESIGN_SHIFT = 1.0
"""Shift of a block mean, in standard deviations of block means, for which the level charts have the shortest delay."""
SOLVED_RUN_BLOCKS = 1e5
"""Run length (blocks) of the integral equation; others are extrapolated within 4 % (tests/monitor/test_charts.py)."""


def level_threshold(run_length: float) -> float:
    """Return the threshold h of S ← max(0, S + z − SHIFT/2), z standard normal: run length (e^{2κb} − 2κb − 1)/(2κ²), κ
    = SHIFT/2, b = h + 1.166 (Siegmund 1985, Sequential Analysis, section 2.6)."""
    kappa = DESIGN_SHIFT / 2.0
    low, high = 0.0, math.log(run_length + 10.0) / (2.0 * kappa) + 10.0
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        b = middle + 1.166
        length = (math.exp(2.0 * kappa * b) - 2.0 * kappa * b - 1.0) / (2.0 * kappa**2)
        low, high = (middle, high) if length < run_length else (low, middle)
    return high


def noise_threshold(run_length: float, shape: float, ratio: float) -> float:
    """Return the threshold h of S ← max(0, S + l), l = k[y(1 − 1/R) − ln R], with independent Gamma y of shape k and
    mean 1; R is the ratio with the shortest delay. The run length is at least e^h (Lorden 1971, Annals of Mathematical
    Statistics 42, 1897-1908), and C e^h for large h, with C by Page's integral equation for 10⁵ blocks (Brook and Evans
    1972, Biometrika 59, 539-549)."""
    return max(math.log(run_length) - _advantage(round(shape, 2), ratio), 0.5)


@lru_cache(maxsize=4096)
def _advantage(shape: float, ratio: float) -> float:
    """Return ln C = ln(run length) − h at a run length of 10⁵ blocks."""
    low, high = 0.05, math.log(SOLVED_RUN_BLOCKS) + 1.0
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if noise_run_length(middle, shape, ratio) < SOLVED_RUN_BLOCKS else (low, middle)
    return math.log(SOLVED_RUN_BLOCKS) - high


@lru_cache(maxsize=64)
def shape_factor(sums: int, ratio: float) -> float:
    """Return the factor of a noise chart's shape for correlated coefficients of `sums` block sums each.

    Their mean squares have longer tails than a Gamma distribution with k = 1/Var y: up to 1.4 times the false alarms in
    500 blocks at R = 2. The factor makes E e^l = 1: with density g(ω) = |Σ ± e^{ikω}|²/m, Szegő's theorem gives the
    shape q per coefficient by −½ mean ln(1 − 2q(1 − 1/R)g(ω)) = q ln R."""
    omega = (np.arange(4096) + 0.5) * np.pi / 4096
    signs = np.repeat([-1.0, 1.0], sums // 2)
    density = np.square(np.abs(np.exp(1j * np.outer(omega, np.arange(sums))) @ signs)) / sums
    usual = 0.5 / float(np.mean(density**2))
    slope = 1.0 - 1.0 / ratio

    def excess(factor: float) -> float:
        q = factor * usual
        return float(-0.5 * np.mean(np.log1p(-2.0 * q * slope * density))) - q * math.log(ratio)

    largest = 0.5 / (usual * slope * float(density.max())) if slope > 0 else 10.0
    return float(scipy.optimize.brentq(excess, 1e-3, min(largest * (1.0 - 1e-9), 10.0)))


def noise_run_length(threshold: float, shape: float, ratio: float, cells: int = 120) -> float:
    """Return the average run length (blocks) of a noise chart that starts at 0, from Page's equation on cells."""
    width = threshold / cells
    states = np.concatenate([[0.0], (np.arange(cells) + 0.5) * width])
    # All rows are values of one function: the probability of an increment below each multiple of half a cell.
    places = np.asarray(0.5 * width * np.arange(-2.0 * cells, 2 * cells + 1), dtype=np.float64)
    slope = 1.0 - 1.0 / ratio
    y = np.maximum((places / shape + math.log(ratio)) / slope, 0.0)
    probability = scipy.special.gammainc(shape, y * shape) if slope > 0 else scipy.special.gammaincc(shape, y * shape)
    below = np.asarray(probability, dtype=np.float64)
    twice = np.rint(2.0 * states / width).astype(np.int64)
    edges = 2 * np.arange(cells + 1) + 2 * cells
    cumulative = below[edges[None, :] - twice[:, None]]
    moves = np.empty((cells + 1, cells + 1))
    moves[:, 1:] = np.diff(cumulative, axis=1)
    moves[:, 0] = cumulative[:, 0]
    return float(np.linalg.solve(np.eye(cells + 1) - moves, np.ones(cells + 1))[0])


def spike_limit(run_length: float) -> float:
    """Return the limit that |e| exceeds on average once in `run_length` samples, for standard normal e."""
    return float(-scipy.special.ndtri(0.5 / run_length))


Family = Literal["noise up", "noise down", "level", "spike", "constant"]
"""Monitored quantity: mean squares (noise), means (level), single innovations (spike), or equal samples (constant)."""

NOISE: tuple[tuple[Family, int, float], ...] = (
    ("noise up", 1, 2.0), ("noise up", 1, 1.25), ("noise down", -1, 1.0 / 1.5),
)  # fmt: skip
"""Family, direction and variance ratio R of the noise charts, fastest for its R. The first finds large changes and slow
noise early, the second 10 % of the standard deviation (docs/validation/monitor.md)."""
BLOCKS_OF_LEVEL = 4
"""Block length in 2^j samples; with 16, slow noise is found 40 s later (docs/validation/monitor.md)."""
STATISTIC_UNIT = 2.0**24  # the chart statistics are integers in units of 1/UNIT
LARGEST_INNOVATION = 6.0
"""Limit of innovations, means and coefficients (standard deviations), so that a wrong sample is no jump."""
LONGEST_PAUSE_S = 60.0  # longest pause (s) of a chart between two alarms while a fault lasts


class Alarm(NamedTuple):
    """An alarm of a chart: its statistic exceeded the threshold."""

    sample: int  # number of the sample at which the chart exceeded its threshold
    family: Family  # quantity that the chart monitors
    level: int  # Haar level of the chart; 0 for single innovations
    sign: int  # direction of the change: 1 for an increase, −1 for a decrease
    onset: int  # number of the last sample at which the chart statistic was 0, before the alarm
    score: float  # value of the chart statistic, the logarithm of the likelihood ratio


def window(level: int) -> tuple[int, int]:
    """Return the level and the number of the block sums that make up a Haar coefficient of the given level: at most 8,
    which keep 93 % of their freedom (tests/monitor/test_charts.py)."""
    base = max(level - 3, 0)
    return base, 1 << (level - base)


@lru_cache(maxsize=64)
def white_shape(level: int) -> float:
    """Return k = 1/Var y of a block's mean squares in white noise; Var y is over many correlated blocks."""
    _, m = window(level)
    half = np.repeat([1.0, -1.0], m // 2)
    rho = np.correlate(half, half, "full") / m
    return float(BLOCKS_OF_LEVEL * m / (2.0 * np.sum(rho**2)))


@dataclass(frozen=True, eq=False)
class ChartSettings:
    """Settings of the charts of one axis, from the statistics of a healthy sensor."""

    # (J,) expected mean squares of the standardised Haar coefficients at levels 1 … J; 1 if the model is right
    ratios: Vector
    shapes: Vector  # (J,) shape k = 1/Var y of the relative mean squares y of a block at these levels
    scatter: Vector  # (J + 1 or fewer,) standard deviations of the standardised block means at levels 0, 1, …
    # Dead band. A variance that differs from the expected one by less than this factor is not a fault.
    band: float = 1.0
    # factor by which the limit for single innovations is multiplied; 1 for normally distributed noise
    tail: float = 1.0
    equal: int = 0  # length of a run of equal samples that causes an alarm; 0 for no limit

    @classmethod
    def of_model(cls, rate: float) -> ChartSettings:
        """Return the settings for white normal innovations with variance 1, at a sampling rate (Hz)."""
        levels = min(max(round(math.log2(164.0 * rate)), 4), 20)  # about 164 s
        shapes = np.array([white_shape(j) for j in range(1, levels + 1)])
        equal = max(round(0.5 * rate), 20)  # equal samples for 0.5 s
        return cls(np.ones(levels), shapes, np.ones(levels + 1), equal=equal)

    @property
    def charts(self) -> int:
        """Number of charts among which the rate of false alarms is divided."""
        return len(NOISE) * self.ratios.size + 2 * self.scatter.size + 1


class Charts:
    """Charts of one axis, with `run_length` samples between false alarms of a chart, and pauses after alarms."""

    STATE = ("count", "base", "left", "tails", "squares", "done", "sums", "zeros", "rests", "pauses", "recent")

    def __init__(self, settings: ChartSettings, run_length: float, rest: int, longest_rest: int) -> None:
        self.settings, self.rest, self.longest_rest = settings, rest, longest_rest
        self.depth = max(settings.ratios.size, settings.scatter.size - 1)
        self.names: list[tuple[Family, int, int]] = []
        limits: list[float] = []
        self.noise: dict[tuple[int, float], int] = {}  # indices of the noise charts, by level and variance ratio
        self.means: dict[tuple[int, int], int] = {}  # indices of the level charts, by level and direction
        for level in range(1, settings.ratios.size + 1):
            blocks = run_length / (BLOCKS_OF_LEVEL << level)
            for family, sign, ratio in NOISE:
                k = self._shape(level, ratio)
                self.noise[level, ratio] = len(self.names)
                self.names.append((family, level, sign))
                limits.append(noise_threshold(blocks, k, ratio))
        for level in range(settings.scatter.size):
            for sign in (1, -1):
                self.means[level, sign] = len(self.names)
                self.names.append(("level", level, sign))
                limits.append(level_threshold(run_length / (1 << level)))
        self.names.append(("spike", 0, 1))
        limits.append(0.0)
        self.spike = spike_limit(run_length) * settings.tail
        self.limits = np.rint(np.array(limits) * STATISTIC_UNIT).astype(np.int64).tolist()
        self.count = 0
        self.recent = np.zeros(0)  # block sums of level 6 of the last update
        self.peaks = [0] * len(self.names)  # largest statistics since the last `forget_peaks`, for plots
        self.reset()

    def _shape(self, level: int, ratio: float) -> float:
        """Return the Gamma shape that the chart of a variance ratio uses for the mean squares of a level."""
        return float(self.settings.shapes[level - 1]) * shape_factor(window(level)[1], ratio)

    def reset(self) -> None:
        """Set all chart statistics to 0."""
        n = len(self.names)
        self.sums: tuple[int, ...] = (0,) * n
        self.zeros: tuple[int, ...] = (self.count - 1,) * n
        self.rests: tuple[int, ...] = (-1,) * n  # last sample of the pause after an alarm
        self.pauses: tuple[int, ...] = (0,) * n  # length of this pause
        self.break_blocks()

    def break_blocks(self) -> None:
        """Begin new blocks after a gap."""
        self.base = self.count
        none = np.zeros(0)
        self.left: tuple[Vector, ...] = (none,) * (self.depth + 1)  # block sum that waits for the second of its pair
        self.tails: tuple[Vector, ...] = (none,) * self.settings.ratios.size  # block sums for the next coefficients
        self.squares: tuple[Vector, ...] = (none,) * self.settings.ratios.size  # squares of an incomplete block
        self.done: tuple[int, ...] = (0,) * (self.depth + 1)  # number of block sums so far

    def skip(self, samples: int) -> None:
        """Advance the sample number over samples that the charts do not use."""
        self.count += samples
        self.break_blocks()

    def update(self, e: Vector) -> list[Alarm]:
        """Add standardised innovations (n,), and return the alarms in no particular order."""
        if not e.size:
            return []
        alarms = list(self._spikes(e))
        clipped = np.clip(e, -LARGEST_INNOVATION * self.settings.tail, LARGEST_INNOVATION * self.settings.tail)
        sums, self.recent = clipped, np.zeros(0)
        waiting, done = list(self.left), list(self.done)
        tails, squares = list(self.tails), list(self.squares)
        states = (list(self.sums), list(self.zeros), list(self.rests), list(self.pauses))
        for level in range(self.depth + 1):
            if level:
                joined = np.concatenate([waiting[level - 1], sums]) if waiting[level - 1].size else sums
                even = joined.size & ~1
                waiting[level - 1], sums = joined[even:], joined[0:even:2] + joined[1:even:2]
                if not sums.size:
                    break
            if level == HISTORY_LEVEL:
                self.recent = sums
            first = self.base + (done[level] + 1) * (1 << level) - 1
            alarms += self._means(level, sums, first, states)
            for j, m in self._coefficients(level):
                alarms += self._variances(j, m, sums, tails=tails, squares=squares, done=done[level], states=states)
            done[level] += sums.size
        self.left, self.done, self.tails, self.squares = tuple(waiting), tuple(done), tuple(tails), tuple(squares)
        self.sums, self.zeros, self.rests, self.pauses = (tuple(part) for part in states)
        self.count += e.size
        return alarms

    def _coefficients(self, base: int) -> Iterator[tuple[int, int]]:
        """Yield the levels whose coefficients are made of block sums of level `base`, and the sums in each."""
        for level in (1, 2, 3) if base == 0 else (base + 3,):
            if level <= self.settings.ratios.size:
                yield level, window(level)[1]

    def _spikes(self, e: Vector) -> Iterator[Alarm]:
        far = np.flatnonzero(np.abs(e) > self.spike)
        for k in far[:8].tolist():  # a fault causes many; a few alarms are enough
            sample = self.count + k
            sign = 1 if e[k] > 0 else -1
            yield Alarm(sample, "spike", 0, sign, onset=sample - 1, score=float(e[k] ** 2 / 2.0))

    def _means(self, level: int, sums: Vector, first: int, states: States) -> Iterator[Alarm]:
        if level >= self.settings.scatter.size:
            return
        z = sums / (2.0 ** (level / 2.0) * self.settings.scatter[level])
        scaled = np.rint(np.clip(z, -LARGEST_INNOVATION, LARGEST_INNOVATION) * STATISTIC_UNIT).astype(np.int64)
        half = int(STATISTIC_UNIT * DESIGN_SHIFT / 2.0)
        for sign in (1, -1):
            place = self.means[level, sign]
            yield from self._chart(place, sign * scaled - half, first, states)

    def _variances(
        self, level: int, m: int, sums: Vector, tails: list[Vector], squares: list[Vector], done: int, states: States
    ) -> Iterator[Alarm]:
        """Update the noise charts of a level, whose coefficients have m block sums each, and yield their alarms."""
        at = level - 1
        joined = np.concatenate([tails[at], sums])
        tails[at] = joined[-(m - 1) :]
        if joined.size < m:
            return
        w = differences(joined, m)
        # With the right model, 2^{j/2} W_j has a standard normal distribution.
        w *= 1.0 / (2.0 ** (level / 2.0) * np.sqrt(self.settings.ratios[at]))
        w *= w
        np.minimum(w, (LARGEST_INNOVATION * self.settings.tail) ** 2, out=w)
        ready = np.concatenate([squares[at], w])
        length = BLOCKS_OF_LEVEL * m
        blocks = ready.size // length
        squares[at] = ready[blocks * length :]
        if not blocks:
            return
        y = ready[: blocks * length].reshape(blocks, length)
        while y.shape[1] > 1:
            half = y.shape[1] // 2
            y = y[:, :half] + y[:, half:]
        y = y[:, 0] / length
        base = max(level - 3, 0)
        # Number of the block sum at the end of the last complete block of mean squares.
        last = done + sums.size - 1 - squares[at].size
        first = self.base + (last - (blocks - 1) * length + 1) * (1 << base) - 1
        for _, sign, ratio in NOISE:
            k = self._shape(level, ratio)
            l = k * (y / self.settings.band**sign * (1.0 - 1.0 / ratio) - np.log(ratio))  # noqa: E741
            scaled = np.rint(np.clip(l, -1e6, 1e6) * STATISTIC_UNIT).astype(np.int64)
            place = self.noise[level, ratio]
            yield from self._chart(place, scaled, first, states, width=BLOCKS_OF_LEVEL << level)

    def _chart(
        self, place: int, steps: Integers, first: int, states: States, width: int | None = None
    ) -> Iterator[Alarm]:
        """Add the increments of consecutive blocks, the first ending at `first`, to one chart, and yield its alarms."""
        sums, zeros, rests, pauses = states
        family, level, sign = self.names[place]
        width = width or 1 << level
        limit, at, n = self.limits[place], 0, steps.size
        while at < n:
            end = first + at * width
            if end <= rests[place]:
                at += (rests[place] - end) // width + 1
                zeros[place] = first + (at - 1) * width
                continue
            path = np.cumsum(steps[at:])
            path += sums[place]
            path -= np.minimum.accumulate(np.minimum(path, 0))
            over = int(np.argmax(path > limit)) if int(path.max()) > limit else -1
            part = path if over < 0 else path[: over + 1]
            self.peaks[place] = max(self.peaks[place], int(part.max()))
            back = int(np.argmax(part[::-1] == 0))
            if part[part.size - 1 - back] == 0:
                zeros[place] = first + (at + part.size - 1 - back) * width
            if over < 0:
                sums[place] = int(path[-1])
                return
            sample = first + (at + over) * width
            score = float(path[over]) / STATISTIC_UNIT
            yield Alarm(sample, family, level, sign, onset=zeros[place], score=score)
            again = sample - rests[place] <= 4 * pauses[place]
            pauses[place] = min(2 * pauses[place], self.longest_rest) if again else self.rest
            rests[place], sums[place], zeros[place] = sample + pauses[place], 0, sample
            at += over + 1

    def forget_peaks(self) -> None:
        """Start a new interval for `heights`."""
        self.peaks = [0] * len(self.names)

    def heights(self) -> dict[str, float]:
        """Return the largest chart statistic of each family since `forget_peaks`, as a fraction of the threshold."""
        heights: dict[str, float] = {}
        for (family, _, _), height, limit in zip(self.names, self.peaks, self.limits, strict=True):
            heights[family] = max(heights.get(family, 0.0), height / limit if limit else 0.0)
        return heights

    def save(self) -> dict[str, Any]:
        """Return the state. Its arrays are never modified in place."""
        return {name: getattr(self, name) for name in self.STATE}

    def load(self, state: Mapping[str, Any]) -> None:
        """Restore a state from `save`."""
        self.count, self.base = whole(state["count"]), whole(state["base"])
        for name in ("left", "tails", "squares"):
            parts = tuple(map(numbers, state[name]))
            if len(parts) != len(getattr(self, name)):
                raise ValueError(f"{name} must have {len(getattr(self, name))} parts; got {len(parts)}")
            setattr(self, name, parts)
        for name in ("done", "sums", "zeros", "rests", "pauses"):
            setattr(self, name, wholes(state[name], getattr(self, name)))
        self.recent = numbers(state["recent"])


States = tuple[list[int], list[int], list[int], list[int]]
HISTORY_LEVEL = 6  # level of the block sums that are kept to determine the kind of a slow fault


def differences(sums: Vector, m: int) -> Vector:
    """Return, for each run of m consecutive sums, the total of its second half minus the total of its first half."""
    half = m // 2
    while half > 1:
        # Sums of 2, then of 4 consecutive entries, by adding neighbours.
        step = m // 2 // half
        sums, half = sums[step:] + sums[:-step], half // 2
    step = m // 2
    return np.asarray(sums[step:] - sums[:-step])
