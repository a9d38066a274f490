"""Mean rise per sample over a whole recording with gaps, from the samples and their times."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.recording.signals import Signal


class RiseSums(NamedTuple):
    """Sums for the least-squares slope of a straight line through samples at known times t (in sampling intervals).

    `number` is the number of samples, `time` and `value` are the means t̄ and x̄, `times2` and `product` are Σ (t −
    t̄)² and Σ (t − t̄)(x − x̄). `known` is 1 if the times are known and in order, else 0.
    """

    number: float = 0.0
    time: float = 0.0
    value: float = 0.0
    times2: float = 0.0
    product: float = 0.0
    known: float = 1.0

    @classmethod
    def of(cls, signal: Signal) -> RiseSums:
        """Compute the sums of a signal."""
        sums = cls()
        for values, start in zip(signal.segment_values(), signal.starts, strict=True):
            sums = sums.followed_by(_of_segment(values, start * signal.rate))
        return sums if signal.gaps_known or len(signal.segments) == 1 else sums._replace(known=0.0)

    def followed_by(self, later: RiseSums) -> RiseSums:
        """Return the sums over these samples and later samples."""
        if not self.number or not later.number:
            return later if later.number else self
        number, apart = self.number + later.number, later.time - self.time
        share, step = later.number / number, later.value - self.value
        return RiseSums(
            number=number,
            time=self.time + share * apart,
            value=self.value + share * step,
            times2=self.times2 + later.times2 + self.number * share * apart**2,
            product=self.product + later.product + self.number * share * apart * step,
            known=float(self.known and later.known and apart > 0),
        )

    def slope(self) -> float | None:
        """Return the rise per sample; None if the times are not known."""
        return self.product / self.times2 if self.known and self.times2 > 0 else None


def _of_segment(values: Vector, time: float) -> RiseSums:
    middle, mean = 0.5 * (values.size - 1), float(values.mean())
    product = float(np.dot(np.arange(values.size) - middle, values - mean))
    times2 = values.size * (values.size**2 - 1.0) / 12
    return RiseSums(number=values.size, time=time + middle, value=mean, times2=times2, product=product)
