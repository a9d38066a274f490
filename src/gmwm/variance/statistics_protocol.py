"""What is taken of wavelet coefficients, besides their squares, while the samples that they come from are there."""

from __future__ import annotations

from typing import Any, Protocol

from gmwm._arrays import Vector


class Part(Protocol):
    """What was taken of some coefficients of one level; adds up in any order and grouping."""

    def merge(self, other: Any, /) -> Any:
        """That of the coefficients of both."""


class Taken(Protocol):
    """What was taken of all levels; adds up in any order and grouping."""

    def merge(self, other: Any, /) -> Any:
        """That of the coefficients of both."""


class Taking(Protocol):
    """How it is taken.

    Attributes
    ----------
    squares : bool
        Whether the sums of squares are wanted too.
    """

    squares: bool

    def haar(self, running_sum: Vector, levels: int, begin: int) -> Taken:
        """Of the coefficients of levels 1 … `levels` that end at sample `begin` or after."""

    def across(self, running_sum: Vector, level: int) -> Taken:
        """Of all coefficients of one level that there are."""

    def values(self, coefficients: Vector, level: int) -> Part:
        """Of coefficients of one level, none or many."""

    def at(self, level: int, part: Any, resolution: float) -> Taken:
        """With that of one level, nothing at the others; of coefficients that are rounding up to `resolution`."""

    def nothing(self) -> Taken:
        """Of no coefficients at all."""
