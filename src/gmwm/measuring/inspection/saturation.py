"""Recognise an output that is clipped at the end of the measuring range."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gmwm.base.arrays import Vector

_SHARE = 1e-3
"""Smallest share of samples at an extreme value that is reported. Gaussian noise that is clipped there loses 0.1 % of
its standard deviation (tests/test_inspection_faults.py, as the next constants)."""
_LEAST = 10
"""Smallest number of samples at an extreme value."""
_EXPECTED = 30.0
"""Number of samples that Gaussian noise would have beyond the extreme value, whose absence is not chance."""


@dataclass(frozen=True, kw_only=True)
class Saturation:
    """Samples of an axis at its smallest or largest value. `share` is their share, and `value` the value at which there
    are most of them."""

    axis: str
    share: float
    value: float


class Extremes:
    """The largest value of an axis, the next smaller one, and their numbers of samples, from samples in any parts."""

    def __init__(self) -> None:
        self.levels = np.empty(0)
        self.counts = np.empty(0, dtype=np.int64)

    def update(self, values: Vector) -> None:
        """Add samples."""
        if not values.size:
            return
        largest = float(np.max(values))
        smaller = values[values < largest]
        new = [largest, float(np.max(smaller))] if smaller.size else [largest]
        levels = np.unique([*self.levels.tolist(), *new])[-2:]
        counts = [int(np.count_nonzero(values == level)) + self._count(level) for level in levels]
        self.levels, self.counts = levels, np.array(counts)

    def _count(self, level: float) -> int:
        at = np.flatnonzero(self.levels == level)
        return int(self.counts[at[0]]) if at.size else 0

    def is_clipped(self, samples: int, step: float, noise: float) -> bool:
        """Return whether the noise would extend beyond the largest value. `step` is the quantization step, 0 if none is
        visible, and `noise` the standard deviation before rounding.

        The logarithm of the probabilities of the values of rounded Gaussian noise has the second difference −step²/σ².
        The two largest values with n_1 and n_0 samples predict n_1²/n_0 · exp(−step²/σ²) samples beyond. A mean that
        varies makes the tail longer.
        """
        if self.levels.size < 2 or self.counts[-1] < max(_SHARE * samples, _LEAST):
            return False
        if not step:
            return True
        if not noise > 0:
            return False
        return bool(self.counts[-1] ** 2 / self.counts[-2] * math.exp(-((step / noise) ** 2)) > _EXPECTED)


def saturation_of(
    axis: str, low: Extremes, high: Extremes, *, samples: int, step: float, noise: float
) -> Saturation | None:
    """Return the share of clipped samples of an axis; None if it is not clipped. `low` has the extremes of the negative
    samples."""
    clipped = [(int(side.counts[-1]), sign * float(side.levels[-1])) for side, sign in ((low, -1.0), (high, 1.0))
               if side.is_clipped(samples, step, noise)]  # fmt: skip
    if not clipped:
        return None
    return Saturation(axis=axis, share=sum(count for count, _ in clipped) / samples, value=max(clipped)[1])
