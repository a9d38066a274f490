"""Find the still parts of a recording in which the unit was turned between several positions, as for six positions."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from gmwm.base.arrays import Vector, runs_of
from gmwm.measuring.inspection.time_grid import Extent

# The limits separate recordings at rest, vehicles and turns by hand in tests/test_inspection.py.
_TURNED = 1.0
"""Change of the direction of gravity (degrees) between two blocks in which the unit turns."""
_APART = 10.0
"""Change of the direction of gravity (degrees) between two positions."""
_SHORTEST, _FEWEST = 8, 3
"""Fewest blocks of a still part, and fewest positions."""


def still_parts(
    levels: Mapping[str, list[tuple[int, Vector]]], length: int, extent: Extent
) -> list[tuple[float, float]]:
    """Return the times (s) of the still parts of a recording with three positions or more; [] for other recordings.

    `levels` are the block medians of each axis, with the first sample of each range; a block has `length` samples.
    """
    axes = [levels.get(f"accel_{axis}", []) for axis in "xyz"]
    parts, directions = list[tuple[float, float]](), list[Vector]()
    for ranges in zip(*axes, strict=False):
        first = ranges[0][0]
        blocks = np.column_stack([values for _, values in ranges])
        norms = np.linalg.norm(blocks, axis=1, keepdims=True)
        unit = np.divide(blocks, norms, out=np.zeros_like(blocks), where=norms > 0)
        still = np.sum(unit[1:] * unit[:-1], axis=1) > np.cos(np.radians(_TURNED))
        for begin, end in runs_of(still).tolist():
            # The blocks at both ends may contain a part of the turn.
            if end - begin - 1 >= _SHORTEST:
                edges = [first + length * (begin + 1), first + length * end - 1]
                since = extent.times(edges)
                parts.append((float(since[0]), float(since[1])))
                directions.append(np.mean(unit[begin + 1 : end], axis=0))
    turns = [float(a @ b) < np.cos(np.radians(_APART)) for a, b in pairwise(directions)]
    return parts if sum(turns) >= _FEWEST - 1 else []
