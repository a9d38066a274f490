"""Results of the same kind for the axes of a recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from functools import partial
from types import MappingProxyType
from typing import Any, TypeVar

from gmwm.base.errors import DataError
from gmwm.base.plotting import Plotted
from gmwm.base.text import Summarised

T = TypeVar("T")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class AxisResults(Summarised, Plotted, Mapping[str, T]):
    """Mapping of axis to result. A subclass has one field, the mapping, and `noun` for one of its results."""

    noun = "result"

    def __post_init__(self) -> None:
        if not self._results:
            raise DataError(argument=self._field, expected=f"the {self.noun} of at least one axis", got=self._results)
        object.__setattr__(self, self._field, MappingProxyType(dict(self._results)))

    def __reduce__(self) -> tuple[Any, ...]:
        # A mapping proxy cannot be pickled, so the copy is rebuilt from a plain dict.
        return partial(type(self), **{self._field: dict(self._results)}), ()

    def __getitem__(self, axis: str) -> T:
        try:
            return self._results[axis]
        except KeyError:
            raise DataError(argument="axis", expected=f"one of {', '.join(self)}", got=axis) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._results)

    def __len__(self) -> int:
        return len(self._results)

    def __contains__(self, axis: object) -> bool:
        return axis in self._results

    def get(self, axis: str, default: Any = None) -> Any:
        """Return the result of an axis, or `default` if there is none."""
        return self._results.get(axis, default)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields of each axis as plain numbers, lists and strings, by axis."""
        results: Mapping[str, Any] = self._results
        return {axis: result.to_dict() for axis, result in results.items()}

    @property
    def _field(self) -> str:
        return fields(self)[0].name

    @property
    def _results(self) -> Mapping[str, T]:
        results: Mapping[str, T] = getattr(self, self._field)
        return results
