"""Convert results to dicts, lists, numbers and strings for JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """Convert arrays and tuples to lists, results to dicts, and numbers that are not finite to None.

    >>> plain({"x": np.array([[1.0, np.nan]]), "names": ("a", "b")})
    {'x': [[1.0, None]], 'names': ['a', 'b']}
    """
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {name: plain(item) for name, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def plain_fields(result: object, names: str) -> dict[str, Any]:
    """Return the attributes of a result whose names are separated by spaces, as `plain` converts them."""
    return {name: plain(getattr(result, name)) for name in names.split()}
