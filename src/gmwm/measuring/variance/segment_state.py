"""State of a segment of consecutive samples, from which the wavelet variance of a recording is computed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from gmwm.base import _core
from gmwm.base.arrays import Integers, Vector
from gmwm.measuring.variance.coefficients import haar_resolution
from gmwm.measuring.variance.sketch import SKETCH_COLLECTOR, Sketch, Sketches

if TYPE_CHECKING:
    from typing_extensions import Self


class LevelStatistic(Protocol):
    """Statistic of some coefficients of one level. Statistics can be merged in any order and grouping."""

    def merge(self, other: Any, /) -> Any:
        """Return the statistic of the coefficients of `self` and `other` together."""


class Statistics(Protocol):
    """Statistics of the coefficients of all levels. They can be merged in any order and grouping."""

    def merge(self, other: Any, /) -> Any:
        """Return the statistics of the coefficients of `self` and `other` together."""


class StatisticsCollector(Protocol):
    """Object that computes statistics of wavelet coefficients; `squares` tells whether Σ W² is needed too."""

    squares: bool

    def haar(self, running_sum: Vector, levels: int, begin: int) -> Statistics:
        """Return the statistics of the coefficients of levels 1 … `levels` that end at sample `begin` or after."""

    def across(self, running_sum: Vector, level: int) -> Statistics:
        """Return the statistics of all coefficients of one level of a running sum."""

    def values(self, coefficients: Vector, level: int) -> LevelStatistic:
        """Return the statistic of an array of coefficients of one level, which can be empty."""

    def at(self, level: int, part: Any, resolution: float) -> Statistics:
        """Return statistics of all levels, with `part` at `level`; |W| ≤ `resolution` can be rounding."""

    def empty(self) -> Statistics:
        """Return the statistics of no coefficients."""


BLOCKS_OF_SCALE = 64  # Number of blocks per scale τ. Coefficients are computed at every τ/64-th sample.
_KEPT = BLOCKS_OF_SCALE - 1


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of `step` = τ/64 samples in a segment with sums b_k and Σ (sum of 32 − of the 32 before)² (`squares`).

    `first` and `last` are the first complete block and the end (last < first if none); `before`, `after` sum samples
    outside, `heads`, `tails` the 63 blocks at both ends. `total` and `moment` are Σ b_k and Σ (k − first) b_k. `part`
    are further statistics, and `resolution` the largest |W| of rounding."""

    step: int
    first: int
    last: int
    before: float
    after: float = 0.0
    heads: Vector = field(default_factory=lambda: np.empty(0))
    tails: Vector = field(default_factory=lambda: np.empty(0))
    squares: float = 0.0
    count: int = 0
    total: float = 0.0
    moment: float = 0.0
    part: LevelStatistic | None = None
    resolution: float = 0.0

    @property
    def open(self) -> bool:
        """Whether the segment contains no multiple of the step."""
        return self.last < self.first

    def followed_by(self, later: Blocks, collector: StatisticsCollector | None = None) -> Blocks:
        """Combine the blocks of this segment and the segment that directly follows it."""
        if later.open:
            if self.open:
                return replace(self, before=self.before + later.before)
            return replace(self, after=self.after + later.before)
        if self.open:
            return replace(later, before=self.before + later.before)
        # If the boundary is not a multiple of the step, the remainders before and after it form one block.
        middle = [] if self.last == later.first else [self.after + later.before]
        joint = np.concatenate([self.tails, middle, later.heads])
        squares, count, part, resolution = block_statistics(joint, self.step, collector)
        if part is not None and self.part is not None and later.part is not None:
            part = self.part.merge(later.part).merge(part)
        heads, tails = self.heads, later.tails
        if heads.size < _KEPT:
            heads = np.concatenate([heads, middle, later.heads])[:_KEPT]
        if tails.size < _KEPT:
            tails = np.concatenate([self.tails, middle, tails])[-_KEPT:]
        return Blocks(
            step=self.step, first=self.first, last=later.last, before=self.before, after=later.after, heads=heads,
            tails=tails, squares=self.squares + later.squares + squares, count=self.count + later.count + count,
            total=self.total + sum(middle) + later.total,
            moment=self.moment
            + sum(middle) * (self.last - self.first)
            + later.moment
            + later.total * (later.first - self.first),
            part=part, resolution=max(self.resolution, later.resolution, resolution),
        )  # fmt: skip

    @property
    def rise(self) -> float | None:
        """Least-squares estimate of the rise per sample from the block means; None for fewer than two blocks."""
        n = self.last - self.first
        if n < 2:
            return None
        about = self.moment - 0.5 * (n - 1) * self.total
        return about / (n * (n * n - 1.0) / 12.0) / self.step**2

    def numbers(self) -> list[float]:
        """Return the numbers that `restored` needs besides the sums of the blocks."""
        return [
            self.first, self.last, self.before, self.after, self.squares, self.count, self.total, self.moment,
            self.heads.size,
        ]  # fmt: skip

    @classmethod
    def restore(cls, step: int, numbers: list[float], heads: Vector, tails: Vector) -> Blocks:
        """Restore the blocks from the output of `numbers` and the sums of the first and last blocks."""
        first, last, before, after, squares, count, total, moment, _ = numbers
        return cls(
            step=step, first=int(first), last=int(last), before=before, after=after, heads=heads.copy(),
            tails=tails.copy(), squares=squares, count=int(count), total=total, moment=moment,
        )  # fmt: skip

    def shift(self, offset: float, start: int, stop: int) -> Blocks:
        """Return the blocks of the segment from `start` to `stop` with `offset` added to every sample."""
        if self.open:
            return replace(self, before=self.before + offset * (stop - start))
        s, n = self.step, self.last - self.first
        return replace(
            self, before=self.before + offset * (self.first * s - start),
            after=self.after + offset * (stop - self.last * s), heads=self.heads + offset * s,
            tails=self.tails + offset * s, total=self.total + offset * s * n,
            moment=self.moment + offset * s * (n * (n - 1) / 2),
        )  # fmt: skip


def block_statistics(
    blocks: Vector, step: int, collector: StatisticsCollector | None
) -> tuple[float, int, LevelStatistic | None, float]:
    """Compute `squares`, `count`, `part` and `resolution` of `Blocks` from the sums of consecutive blocks."""
    count = blocks.size - BLOCKS_OF_SCALE + 1
    if count < 1:
        return 0.0, 0, _empty(collector, step), 0.0
    half = BLOCKS_OF_SCALE // 2
    sums = np.concatenate([[0.0], np.cumsum(blocks - blocks.mean())])
    w = sums[BLOCKS_OF_SCALE:] - 2.0 * sums[half:-half] + sums[:-BLOCKS_OF_SCALE]
    if collector is None:
        return float(w @ w), count, None, 0.0
    level = _level(step)
    # The same bound as for a running sum of samples of which only the last value of each block is known.
    resolution = haar_resolution(float(np.abs(sums).max()), level)
    return float(w @ w), count, collector.values(np.ldexp(w, -level), level), resolution


def _level(step: int) -> int:
    return (BLOCKS_OF_SCALE * step).bit_length() - 1


def _empty(collector: StatisticsCollector | None, step: int) -> LevelStatistic | None:
    return None if collector is None else collector.values(np.empty(0), _level(step))


def blocks_of(
    sums: Vector, start: int, stop: int, *, steps: list[int], collector: StatisticsCollector | None = None
) -> list[Blocks]:
    """Build blocks for each step, a power of two times the first, from sums before multiples and of all samples."""
    base, first, total = steps[0], -(-start // steps[0]), float(sums[-1])
    marks = sums[:-1]
    return [
        _of(
            step, start, stop=stop, marks=marks[(-first) % (step // base) :: step // base], total=total,
            collector=collector,
        )
        for step in steps
    ]  # fmt: skip


def _of(step: int, start: int, stop: int, marks: Vector, total: float, collector: StatisticsCollector | None) -> Blocks:
    """Build the blocks of one step from `marks`, the sums of all samples before each multiple of the step."""
    first, last = -(-start // step), stop // step
    if first > last:
        return Blocks(step, first, last, total, part=_empty(collector, step))
    blocks = np.diff(marks)
    squares, count, part, resolution = block_statistics(blocks, step, collector)
    return Blocks(
        step=step, first=first, last=last, before=float(marks[0]), after=total - float(marks[-1]),
        heads=blocks[:_KEPT].copy(), tails=blocks[-_KEPT:].copy(), squares=squares, count=count,
        total=float(blocks.sum()), moment=float(np.arange(blocks.size) @ blocks), part=part, resolution=resolution,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class SegmentState:
    """State of a segment of samples, minus the first (`reference`), so that large offsets cause no rounding error.

    Of `exact` levels, `squares` sums all W², with the 2^exact − 1 samples `head` and `tail`; `blocks` serve higher
    levels. `start` is the first index, `count` the number of samples, and `statistics` those of exact coefficients."""

    exact: int
    start: int
    count: int
    reference: float
    head: Vector
    tail: Vector
    squares: Vector
    blocks: tuple[Blocks, ...]
    statistics: Statistics | None = None

    @property
    def stop(self) -> int:
        """Index in the recording of the sample after the segment."""
        return self.start + self.count

    @classmethod
    def of(cls, x: Vector, start: int, exact: int, levels: int, collector: StatisticsCollector | None = None) -> Self:
        """Build the state of a segment of at least one sample."""
        reference, reach = float(x[0]), (1 << exact) - 1
        steps = [(1 << level) // BLOCKS_OF_SCALE for level in range(exact + 1, max(levels, exact + 1) + 1)]
        nothing = np.empty(0)
        squares, sums, statistics = _sums_of(nothing, x, reference, start=start, exact=exact, collector=collector)
        return cls(
            exact=exact, start=start, count=x.size, reference=reference, head=x[:reach] - reference,
            tail=x[-reach:] - reference, squares=squares,
            blocks=tuple(blocks_of(sums, start, start + x.size, steps=steps, collector=collector)),
            statistics=statistics,
        )  # fmt: skip

    def grown(self, x: Vector, collector: StatisticsCollector | None = None) -> SegmentState:
        """Return the state of this segment extended by the samples `x`."""
        reach = (1 << self.exact) - 1
        squares, sums, statistics = _sums_of(
            self.tail, x, self.reference, start=self.stop, exact=self.exact, collector=collector
        )
        steps = [blocks.step for blocks in self.blocks]
        fresh = blocks_of(sums, self.stop, self.stop + x.size, steps=steps, collector=collector)
        missing = reach - self.head.size
        return SegmentState(
            exact=self.exact, start=self.start, count=self.count + x.size, reference=self.reference,
            head=self.head if missing == 0 else np.concatenate([self.head, x[:missing] - self.reference]),
            tail=np.concatenate([self.tail[x.size :], x[-reach:] - self.reference])[-reach:],
            squares=self.squares + squares,
            blocks=tuple(a.followed_by(b, collector) for a, b in zip(self.blocks, fresh, strict=True)),
            statistics=_merge(self.statistics, statistics),
        )  # fmt: skip

    def followed_by(self, later: SegmentState, collector: StatisticsCollector | None = None) -> SegmentState:
        """Return the state of this segment and the segment that directly follows it."""
        offset, reach = later.reference - self.reference, (1 << self.exact) - 1
        head, tail = later.head + offset, later.tail + offset
        squares, statistics = self.squares + later.squares, _merge(self.statistics, later.statistics)
        for level in range(1, self.exact + 1):
            # Every coefficient of the 2^j − 1 samples before and after the boundary extends across it.
            width = (1 << level) - 1
            around = np.concatenate([self.tail[-width:], head[:width]])
            if around.size > width:
                total = _core.running_sum(around)
                if collector is None or collector.squares:
                    squares[level - 1] += _core.haar_sums_of_squares(total, level, 0, around.size)[-1]
                if collector is not None:
                    statistics = _merge(statistics, collector.across(total, level))
        return SegmentState(
            exact=self.exact, start=self.start, count=self.count + later.count, reference=self.reference,
            head=self.head if self.head.size == reach else np.concatenate([self.head, head])[:reach],
            tail=tail if tail.size == reach else np.concatenate([self.tail, tail])[-reach:], squares=squares,
            blocks=tuple(
                a.followed_by(b.shift(offset, later.start, later.stop), collector)
                for a, b in zip(self.blocks, later.blocks, strict=True)
            ),
            statistics=statistics,
        )  # fmt: skip

    def sums(self, levels: int) -> tuple[Vector, Integers]:
        """Return Σ W² (J,) and the number of coefficients used (J,) at levels 1 … J."""
        squares, counts = np.zeros(levels), np.zeros(levels, dtype=np.int64)
        exact = min(levels, self.exact)
        squares[:exact] = self.squares[:exact]
        counts[:exact] = np.maximum(self.count - (np.int64(1) << np.arange(1, exact + 1)) + 1, 0)
        for level, blocks in enumerate(self.blocks[: levels - exact], start=self.exact + 1):
            squares[level - 1], counts[level - 1] = blocks.squares / 4.0**level, blocks.count
        return squares, counts

    def all_statistics(self, collector: StatisticsCollector) -> Any:
        """Return the collected statistics of all levels."""
        joint = self.statistics
        for level, blocks in enumerate(self.blocks, start=self.exact + 1):
            if blocks.count:
                joint = _merge(joint, collector.at(level, blocks.part, blocks.resolution))
        return joint

    @property
    def rise(self) -> float:
        """Mean rise per sample, by least squares over the block means, or from the means of both halves."""
        rise = self.blocks[0].rise
        if rise is not None:
            return rise
        half = self.count // 2
        if half == 0 or self.count > self.head.size:
            return 0.0
        first, second = float(self.head[:half].mean()), float(self.head[half:].mean())
        return (second - first) / (self.count / 2)

    def arrays(self, prefix: str) -> dict[str, Any]:
        """Return the state as numbers and arrays by name; the names start with `prefix`."""
        return {
            f"{prefix}start": self.start, f"{prefix}count": self.count, f"{prefix}reference": self.reference,
            f"{prefix}head": self.head, f"{prefix}tail": self.tail, f"{prefix}squares": self.squares,
            f"{prefix}blocks": np.array([b.numbers() for b in self.blocks]),
            f"{prefix}heads": np.concatenate([b.heads for b in self.blocks]),
            f"{prefix}tails": np.concatenate([b.tails for b in self.blocks]), **self._sketch_arrays(prefix),
        }  # fmt: skip

    def _sketch_arrays(self, prefix: str) -> dict[str, Any]:
        if self.statistics is None:
            return {}
        bins, resolutions = self.all_statistics(SKETCH_COLLECTOR).to_arrays()
        return {f"{prefix}bins": bins, f"{prefix}resolutions": resolutions}

    @classmethod
    def restore(cls, prefix: str, exact: int, levels: int, values: Mapping[str, Any]) -> Self | None:
        """Restore the state from the output of `arrays`; None if there is no such state."""
        if f"{prefix}count" not in values:
            return None
        blocks, at = [], 0
        head, tail, squares, heads, tails = (
            np.array(values[prefix + name], dtype=np.float64) for name in ("head", "tail", "squares", "heads", "tails")
        )
        if any(array.ndim != 1 for array in (head, tail, squares, heads, tails)):
            raise ValueError("the samples of a segment must be lists of numbers")
        table = np.asarray(values[f"{prefix}blocks"], dtype=np.float64)
        if not all(np.all(np.abs(array) < LARGEST_SUM) for array in (head, tail, squares, heads, tails, table)):
            raise ValueError(f"the sums of a segment must be numbers below {LARGEST_SUM:g}")
        if squares.size != exact or np.any(squares < 0):
            raise ValueError(f"a segment must have {exact} sums of squares, and none may be negative")
        if len(table) != max(levels, exact + 1) - exact:
            raise ValueError(f"a segment must have a row of blocks for each level above {exact}, up to {levels}")
        for level, row in enumerate(table.tolist(), start=exact + 1):
            part = slice(at, at + int(row[-1]))
            blocks.append(Blocks.restore((1 << level) // BLOCKS_OF_SCALE, row, heads[part], tails[part]))
            at = part.stop
        statistics: Statistics | None = None
        if f"{prefix}bins" in values:
            sketches = Sketches.from_arrays(values[f"{prefix}bins"], values[f"{prefix}resolutions"])
            statistics = Sketches(sketches.levels[:exact], sketches.resolutions[:exact])
            further = zip(sketches.levels[exact:], sketches.resolutions[exact:].tolist(), strict=True)
            entries = [*further, *((Sketch(), 0.0) for _ in blocks)]
            blocks = [replace(b, part=p[0], resolution=p[1]) for b, p in zip(blocks, entries, strict=False)]
        start, count = (as_count(values[prefix + name]) for name in ("start", "count"))
        return cls(
            exact=exact, start=start, count=count, reference=float(values[f"{prefix}reference"]), head=head, tail=tail,
            squares=squares, blocks=tuple(blocks), statistics=statistics,
        )  # fmt: skip


LARGEST_SUM = 1e140  # limit of a stored sample or sum of samples. The sum of the squares of larger numbers may overflow


def as_count(value: Any, least: int = 0) -> int:
    """Return a stored number of samples; raise ValueError if no recording has that number."""
    # Largest number of samples of a stored state: a 64-bit integer can hold its sum with the first index.
    longest = 1 << 61
    count = int(value)
    if not least <= count <= longest:
        raise ValueError(f"a number of samples must be from {least} to {longest}")
    return count


def _sums_of(
    before: Vector, x: Vector, reference: float, *, start: int, exact: int, collector: StatisticsCollector | None
) -> tuple[Vector, Vector, Statistics | None]:
    """Return Σ W² (exact,) of coefficients that end in x, which follows `before`, the block sums and the statistics."""
    step = (2 << exact) // BLOCKS_OF_SCALE
    reach = min(exact, (before.size + x.size).bit_length() - 1) if collector is None or collector.squares else 0
    squares = np.zeros(exact)
    squares[:reach], sums = _core.haar_panel(
        before, x, reference=reference, levels=reach, first=-start % step, step=step
    )
    if collector is None:
        return squares, sums, None
    total = _core.running_sum(np.concatenate([before, x - reference]))
    return squares, sums, collector.haar(total, exact, before.size)


def _merge(a: Statistics | None, b: Statistics | None) -> Any:
    return None if a is None or b is None else a.merge(b)
