"""Estimate the quantization step of an axis from a part of its samples."""

from __future__ import annotations

import numpy as np

from gmwm._arrays import Vector

_ENOUGH = 20_000
"""Samples that are used: each value of a coarse output then occurs many times (tests/test_inspection.py)."""
_REPEATED = 0.9
"""Largest share of distinct values among the samples for which a quantization step is searched."""
_UNEVEN = 0.05
"""Largest deviation of the differences from multiples of the step, in steps (tests/test_inspection.py)."""


class Sample:
    """Every 2^k-th sample of a record of any length: 20 000 to 40 000 samples if the record has as many."""

    def __init__(self) -> None:
        self._kept = np.empty(0)
        self._came, self._stride = 0, 1

    def update(self, values: Vector) -> None:
        """Add the next samples."""
        before, self._came = self._came, self._came + values.size
        while self._came > 2 * _ENOUGH * self._stride:
            self._kept, self._stride = self._kept[::2], 2 * self._stride
        part = values[-before % self._stride :: self._stride]
        if part.size:
            self._kept = np.concatenate([self._kept, part])

    def values(self) -> Vector:
        """The selected samples."""
        return self._kept


def lsb(values: Vector) -> float | None:
    """Quantization step of an axis: the spacing of a lattice that contains all values; None if there is none.

    A step is searched only if values repeat.

    >>> lsb(np.round(np.random.default_rng(0).normal(0, 1, 1000) / 0.05) * 0.05)
    0.05
    """
    sample = Sample()
    sample.update(values)
    return step_of(sample.values())


def step_of(sample: Vector) -> float | None:
    """Spacing of a lattice that contains all values of a sample; None if there is none."""
    levels = np.unique(sample)
    if levels.size < 2 or levels.size > _REPEATED * sample.size:
        return None
    steps = np.diff(levels)
    # Values that differ only by the rounding of float64 are equal.
    steps = steps[steps > 1e-12 * np.max(np.abs(levels))]
    if steps.size == 0:
        return None
    step = float(np.min(steps))
    multiples = steps / step
    if np.max(np.abs(multiples - np.round(multiples))) > _UNEVEN:
        return None
    # The step from the whole range has a smaller rounding error than a single difference.
    exact = float(np.sum(steps) / np.sum(np.round(multiples)))
    return float(f"{exact:.9g}")
