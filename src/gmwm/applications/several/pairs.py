"""A mapping whose keys are pairs of axes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from itertools import combinations
from types import MappingProxyType
from typing import Any, TypeVar

from gmwm.base.errors import DataError

T = TypeVar("T")


class Pairs(Mapping[tuple[str, str], T]):
    """Mapping from pairs of axes to values. The order of the two names of a pair does not matter.

    >>> pairs = Pairs({("gyro_x", "gyro_y"): 0.1})
    >>> pairs["gyro_y", "gyro_x"]
    0.1
    """

    def __init__(self, values: Mapping[tuple[str, str], T]) -> None:
        self._values = MappingProxyType(dict(values))

    def __reduce__(self) -> tuple[Any, ...]:
        # A mapping proxy cannot be pickled, so the unpickled object is made from a plain dict.
        return partial(Pairs, dict(self._values)), ()

    def __getitem__(self, pair: tuple[str, str]) -> T:
        if isinstance(pair, tuple) and len(pair) == 2:
            for key in (pair, pair[::-1]):
                if key in self._values:
                    return self._values[key]
        axes = sorted({axis for key in self._values for axis in key})
        raise DataError(argument="pair", expected=f"two different names of {', '.join(axes)}", got=pair)

    def get(self, pair: tuple[str, str], default: Any = None) -> Any:
        """Return the value of a pair, or `default` if there is none."""
        return self._values.get(pair, self._values.get(pair[::-1], default))

    def __contains__(self, pair: object) -> bool:
        return isinstance(pair, tuple) and len(pair) == 2 and (pair in self._values or pair[::-1] in self._values)

    def __iter__(self) -> Iterator[tuple[str, str]]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __repr__(self) -> str:
        return f"Pairs({dict(self._values)!r})"


def pairs_of(axes: list[str]) -> list[tuple[str, str]]:
    """Return all pairs of different axes, in the order of the axes."""
    return list(combinations(axes, 2))
