"""Recognise words of a sensor that overflowed, and undo it."""

from __future__ import annotations

import math

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.recording.resolution import lsb

_FAR = 30.0
"""Smallest distance of a wrapped value from the median, in interquartile ranges."""
_BITS = range(8, 33)
"""Lengths of words (bits)."""
_FEWEST = 2
"""Smallest number of wrapped values. A single far value is a wrong sample."""
_SOME = 20_000
"""Number of values from which the median and the quartiles are computed."""
_UNLIKELY = 1e-6
"""Largest probability that values at random distances all look like wrapped ones."""


def modulus_of(values: Vector) -> tuple[float, float] | None:
    """Return the range 2^b of the word from which some values of an axis wrapped around, in the unit of the axis, and
    the median of the values; None if none did.

    A wrapped value is away from all others by a whole range. It is recognised if the values have a quantization step,
    and if all far values are 2^b steps away from the bulk.
    """
    lowest, highest = float(np.min(values)), float(np.max(values))
    some = values[:: max(values.size // _SOME, 1)]
    low, middle, high = np.quantile(some, [0.25, 0.5, 0.75]).tolist()
    if high - low > (highest - lowest) / 2:  # the mean is at the end of the word
        upper = some > (lowest + highest) / 2
        low, middle, high = np.quantile(some[upper == (np.mean(upper) > 0.5)], [0.25, 0.5, 0.75]).tolist()
    reach = _FAR * (high - low)
    if not reach > 0 or max(highest - middle, middle - lowest) <= reach:
        return None
    is_far = np.abs(values - middle) > reach
    far, near = values[is_far], values[~is_far]
    if not _FEWEST <= far.size <= near.size:
        return None
    step = lsb(near)
    if step is None:
        return None
    width = float(np.max(near) - np.min(near)) + step
    distance = np.abs(far - middle)
    bits = round(math.log2(float(np.median(distance)) / step))
    modulus = 2.0**bits * step
    if bits not in _BITS or np.any(np.abs(distance - modulus) > width):
        return None
    # The chance that the distances of this many other values fall into the same interval about a power of two.
    return None if min(2 * width / modulus, 1.0) ** min(far.size, 100) > _UNLIKELY else (modulus, middle)


def unwrapped(values: Vector, modulus: float, middle: float) -> Vector:
    """Return values that are at most half a range away from the middle."""
    turns = np.rint((values - middle) / modulus)
    return np.asarray(np.where(turns == 0, values, values - turns * modulus))
