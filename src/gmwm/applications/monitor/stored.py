"""Check the numbers in the state of a monitor that was read from a file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gmwm.base.arrays import Vector


def whole(value: Any) -> int:
    """Check that a value is a whole number, and return it."""
    if type(value) is not int or abs(value) > 1 << 62:  # sample numbers are 64-bit integers
        raise ValueError(f"expected a whole number; got {value!r:.50}")
    return value


def require_scale(axis: str, variance: float) -> None:
    """Raise a ValueError if squares of the innovations of an axis, relative to their variance, would overflow."""
    if not 1e-100 < variance < 1e100:
        raise ValueError(f"the innovations of {axis} must have a variance from 1e-100 to 1e100; got {variance:.3g}")


def wholes(values: Any, like: Sequence[int]) -> tuple[int, ...]:
    """Check that `values` contains whole numbers and has the length of `like`, and return the numbers."""
    if len(values) != len(like):
        raise ValueError(f"expected {len(like)} whole numbers; got {len(values)}")
    return tuple(map(whole, values))


def number(value: Any) -> float:
    """Check that a value is a number, and return it as a float."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e100:
        raise ValueError(f"expected a number; got {value!r:.50}")
    return float(value)


def numbers(values: Any) -> Vector:
    """Check that values are finite numbers, and return them as an array (n,)."""
    return np.array([number(value) for value in values], dtype=np.float64)
