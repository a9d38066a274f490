"""Convert results to dicts, lists, numbers and strings for JSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

TEXTS: dict[type, Callable[[Any], str]] = {}
"""Functions that write the objects of a class as a text; `gmwm.base.documents.write_as_text` registers them."""
_SAME = frozenset({bool, int, str})


def plain(value: Any, *, finite: bool = True) -> Any:
    """Convert arrays and tuples to lists, results to dicts, and, if `finite`, numbers that are not finite to None.

    >>> plain({"x": np.array([[1.0, np.nan]]), "names": ("a", "b")})
    {'x': [[1.0, None]], 'names': ['a', 'b']}
    """
    if type(value) is float:
        return None if finite and not math.isfinite(value) else value
    if value is None or type(value) in _SAME:
        return value
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if type(value) in TEXTS:
        return TEXTS[type(value)](value)
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name), finite=finite) for field in fields(value)}
    if isinstance(value, Mapping):
        return {name: plain(item, finite=finite) for name, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        numbers = value.tolist()
        return numbers if value.dtype.kind in "biuf" and not finite else plain(numbers, finite=finite)
    if isinstance(value, list | tuple):
        return [plain(item, finite=finite) for item in value]
    return None if finite and isinstance(value, float) and not math.isfinite(value) else value


def plain_fields(result: object, names: str, *, finite: bool = True) -> dict[str, Any]:
    """Return the attributes of a result whose names are separated by spaces, as `plain` converts them."""
    return {name: plain(getattr(result, name), finite=finite) for name in names.split()}
