"""Check the numbers of a state that was read from a file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gmwm._arrays import Vector

LARGEST = 1 << 62
"""Largest size of a whole number: numbers of samples are 64-bit integers."""


def whole(value: Any) -> int:
    """Return a whole number.

    Raises
    ------
    ValueError
        If it is something else, or larger than `LARGEST`.
    """
    if type(value) is not int or abs(value) > LARGEST:
        raise ValueError(f"expected a whole number; got {value!r:.50}")
    return value


def wholes(values: Any, like: Sequence[int]) -> tuple[int, ...]:
    """Return whole numbers, as many as in `like`.

    Raises
    ------
    ValueError
        If any value is not a whole number, or their number differs.
    """
    if len(values) != len(like):
        raise ValueError(f"expected {len(like)} whole numbers; got {len(values)}")
    return tuple(map(whole, values))


def number(value: Any) -> float:
    """Return a finite number.

    Raises
    ------
    ValueError
        If it is something else.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(float(value)):
        raise ValueError(f"expected a number; got {value!r:.50}")
    return float(value)


def numbers(values: Any) -> Vector:
    """Return an array of finite numbers (n,).

    Raises
    ------
    ValueError
        If any value is not a finite number.
    """
    return np.array([number(value) for value in values], dtype=np.float64)
