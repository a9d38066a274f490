"""The quantisation step of an axis, from a part of its samples."""

from __future__ import annotations

import numpy as np

from gmwm._arrays import Vector

_ENOUGH = 20_000  # samples: every step of a coarse sensor is seen many times


class Sample:
    """Some samples of a record of any length: every 2^k-th, 20 000 to 40 000 of them if there are as many."""

    def __init__(self) -> None:
        self._kept = np.empty(0)
        self._came, self._stride = 0, 1

    def update(self, values: Vector) -> None:
        """The samples that follow."""
        before, self._came = self._came, self._came + values.size
        while self._came > 2 * _ENOUGH * self._stride:
            self._kept, self._stride = self._kept[::2], 2 * self._stride
        part = values[-before % self._stride :: self._stride]
        if part.size:
            self._kept = np.concatenate([self._kept, part])

    def values(self) -> Vector:
        """Those that were kept."""
        return self._kept


def lsb(values: Vector) -> float | None:
    """The quantisation step of an axis: the step of a lattice on which all values lie, or None.

    Looked for only where values repeat; numbers with many digits lie on no visible lattice.

    >>> lsb(np.round(np.random.default_rng(0).normal(0, 1, 1000) / 0.05) * 0.05)
    0.05
    """
    sample = Sample()
    sample.update(values)
    return step_of(sample.values())


def step_of(sample: Vector) -> float | None:
    """The step of a lattice on which all of these lie."""
    levels = np.unique(sample)
    if levels.size < 2 or levels.size > 0.9 * sample.size:
        return None
    steps = np.diff(levels)
    # Values that differ only by the rounding of float64 are one level.
    steps = steps[steps > 1e-12 * np.max(np.abs(levels))]
    if steps.size == 0:
        return None
    step = float(np.min(steps))
    multiples = steps / step
    if np.max(np.abs(multiples - np.round(multiples))) > 0.05:
        return None
    # One step read from the whole range is exact where a single difference carries rounding.
    exact = float(np.sum(steps) / np.sum(np.round(multiples)))
    return float(f"{exact:.9g}")
