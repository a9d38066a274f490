"""Recognise noise that switches between two levels: popcorn noise, or random telegraph noise."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from gmwm.base.arrays import Vector, row_medians
from gmwm.base.remarks import Remark
from gmwm.recording.repairs.runs import Mask
from gmwm.recording.resolution import lsb

_LENGTHS = (16, 64, 256, 1024)
"""Numbers of samples whose means are sorted into two levels."""
_TOGETHER = 128
"""Number of means from which a slow drift is subtracted together."""
_APART = 5.0
"""Smallest distance of the two levels, in standard deviations of the means at one level. It is 2.7 for Gaussian noise
(tests/recording/test_repairs.py, as the next constants)."""
_SHARE = 0.005
"""Smallest share of the time at the rarer level."""
_BETWEEN = 0.5
"""Largest number of means in the middle third between the levels, relative to those at the rarer level."""
_CHANGES = 16
"""Smallest number of changes of the level."""
_PARTS = 8
"""Number of parts of the recording, in more than half of which the rarer level must occur. Otherwise the unit moved."""
_LASTS = 1.5
"""Smallest mean duration of the rarer level, in means. A shorter one is a wrong sample."""


class TwoLevels(NamedTuple):
    """Two levels of an axis: their distance in the unit of the axis, the share of the time at the rarer one, and the
    mean time (samples) that it lasts."""

    size: float
    share: float
    duration: float


def two_levels_of(values: Vector) -> TwoLevels | None:
    """Return the two levels between which the mean of an axis switches; None if it does not."""
    for length in _LENGTHS:
        count = values.size // length
        if count < _TOGETHER:
            break
        means = values[: count * length].reshape(count, length).mean(axis=1)
        rows = means[: count - count % _TOGETHER].reshape(-1, _TOGETHER)
        for x in (means, (rows - row_medians(rows)[:, None]).ravel()):
            split = _split(x)
            if split is not None and (levels := _levels(x, split, length)) is not None:
                # The mean of a coarse output can only be at multiples of a step.
                return levels if levels.size > (lsb(values) or 0.0) else None
    return None


def _split(x: Vector) -> float | None:
    """Return the value between two classes with the smallest variance within the classes (Otsu 1979); None if their
    means are not far apart."""
    ordered = np.sort(x)
    n, k = x.size, np.arange(1, x.size)
    sums = np.cumsum(ordered - ordered[n // 2])
    below, above = sums[:-1] / k, (sums[-1] - sums[:-1]) / (n - k)
    between = k * (n - k) * (above - below) ** 2
    at = int(np.argmax(between))
    within = float(np.var(ordered)) - float(between[at]) / n**2
    distance = float(above[at] - below[at])
    return float((ordered[at] + ordered[at + 1]) / 2) if distance > _APART * np.sqrt(max(within, 0.0)) > 0 else None


def _levels(x: Vector, split: float, length: int) -> TwoLevels | None:
    """Return the two levels of means on both sides of a value, if they are levels and not the tails of noise."""
    upper: Mask = x > split
    rare = upper if np.mean(upper) < 0.5 else ~upper
    low, high = float(np.median(x[~upper])), float(np.median(x[upper]))
    middle = np.abs(x - (low + high) / 2) < (high - low) / 6
    changes = int(np.count_nonzero(np.diff(rare)))
    count, runs = int(np.count_nonzero(rare)), max(changes / 2, 1.0)
    lasting: Mask = rare[1:] & rare[:-1]  # single means can cross by noise after one jump
    if (
        count < _SHARE * x.size
        or np.count_nonzero(np.diff(lasting)) < _CHANGES
        or count < _LASTS * runs
        or np.count_nonzero(middle) > _BETWEEN * count
        or sum(bool(np.any(part)) for part in np.array_split(lasting, _PARTS)) <= _PARTS / 2
    ):
        return None
    return TwoLevels(high - low, count / x.size, length * count / runs)


def axes_with_two_levels(remarks: Iterable[Remark]) -> frozenset[str]:
    """Return the axes that remarks name as switching between two levels."""
    return frozenset(
        remark.subject for remark in remarks if remark.code == "heavy-tails" and remark.facts["case"] == "levels"
    )
