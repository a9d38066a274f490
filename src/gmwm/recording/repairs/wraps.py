"""Recognise words of a sensor that overflowed, and undo it."""

from __future__ import annotations

import math

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.recording.resolution import lsb

_BITS = range(8, 33)
"""Lengths of words (bits)."""
_REACH = 0.025
"""Largest distance of a value from the end of the word, as a share of the range of the word."""
_UNLIKELY = 1e-6
"""Largest probability that values at random distances all look like wrapped ones."""
_GAP = 10.0
"""Largest distance between the values on both sides of the end, in expected distances. It is exponentially distributed
if the output is continuous, and exceeds this value with a probability of 5e-5."""
_CONTINUOUS = 8.0
"""Largest median change of the output where it wraps, in median changes of neighbours
(tests/recording/test_repairs.py)."""


def modulus_of(values: Vector) -> tuple[float, float] | None:
    """Return the range 2^b of the word from which some values of an axis wrapped around, in the unit of the axis, and
    the median of the values on the more frequent side; None if none did.

    The values of a word that wraps are at both of its ends, with nothing between them. Moved by 2^b steps, those of the
    rarer side continue the others without a gap and without overlap. Wrong samples do not: they leave a gap, or
    overlap if a bit of the word flipped.
    """
    lowest, highest = float(np.min(values)), float(np.max(values))
    upper = values > (lowest + highest) / 2
    rare = upper if np.mean(upper) <= 0.5 else ~upper
    far, near = values[rare], values[~rare]
    if far.size < 2 or max(np.ptp(far), np.ptp(near)) > 2 * _REACH * (highest - lowest):
        return None
    step = lsb(near)
    if step is None:
        return None
    bits = math.floor(math.log2((highest - lowest) / step + 0.5)) + 1  # the range is at most 2^b − 1 steps
    modulus = math.ldexp(step, bits)
    above = bool(far[0] > near[0])
    depth = near.min() - (far - modulus) if above else far + modulus - near.max()
    gap, reach = float(np.min(depth)), float(np.max(depth))
    visits = int(np.count_nonzero(np.diff(rare) & rare[1:])) + bool(rare[0])
    excess = float(np.mean(depth)) - gap
    if (
        bits not in _BITS
        or reach > _REACH * modulus
        or (2 * reach / modulus) ** min(far.size, 100) > _UNLIKELY
        or gap > 1.5 * step + _GAP * excess / visits
    ):
        return None
    changes = np.abs(np.diff(unwrapped(values, modulus, middle := float(np.median(near)))))
    jumps = float(np.median(changes[np.diff(rare)]))
    return (modulus, middle) if jumps <= _CONTINUOUS * float(np.median(changes)) + 2 * step else None


def unwrapped(values: Vector, modulus: float, middle: float) -> Vector:
    """Return values that are at most half a range away from the middle."""
    turns = np.rint((values - middle) / modulus)
    return np.asarray(np.where(turns == 0, values, values - turns * modulus))
