"""State of a segment of consecutive samples, from which the wavelet variance of a recording is computed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base import _core
from gmwm.base.arrays import Vector
from gmwm.measuring.variance.blocks import BLOCKS_OF_SCALE, Blocks, Statistics, StatisticsCollector, blocks_of
from gmwm.measuring.variance.sketch import SKETCH_COLLECTOR, Sketch, Sketches

if TYPE_CHECKING:
    from typing_extensions import Self


@dataclass(frozen=True, eq=False)
class SegmentState:
    """State of a segment of consecutive samples, from which the values of the first one (`reference`) are subtracted,
    so that a large offset causes no rounding error. `exact` is the number of levels at which every coefficient is used,
    `start` the index of the first sample in the recording, and `count` the number of samples. `head` and `tail` are the
    first and the last 2^exact − 1 samples, `squares` (exact,) the sums of the squared coefficients, `blocks` the block
    sums for the higher levels (at least one), and `statistics` further statistics of the coefficients of the exact
    levels."""

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

    def sums(self, levels: int) -> tuple[Vector, NDArray[np.int64]]:
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


LARGEST_SUM = 1e140
"""Limit of a stored sample or sum of samples. The sum of the squares of larger numbers may overflow."""


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
    """Return Σ W² (exact,) of coefficients that end in x, if needed, the sums for blocks, and the statistics. The
    samples x follow `before`, which is relative to `reference`, and begin at sample `start`."""
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
