"""Protocols for statistics of wavelet coefficients that are collected in chunks, in addition to the sums of squares."""

from __future__ import annotations

from typing import Any, Protocol

from gmwm._arrays import Vector


class LevelStatistic(Protocol):
    """A statistic of some coefficients of one level. Statistics can be merged in any order and grouping."""

    def merge(self, other: Any, /) -> Any:
        """Return the statistic of the coefficients of both."""


class Statistics(Protocol):
    """The statistics of all levels. They can be merged in any order and grouping."""

    def merge(self, other: Any, /) -> Any:
        """Return the statistic of the coefficients of both."""


class StatisticsCollector(Protocol):
    """Computes the statistics of coefficients.

    Attributes
    ----------
    squares : bool
        Whether the sums of squares are needed too.
    """

    squares: bool

    def haar(self, running_sum: Vector, levels: int, begin: int) -> Statistics:
        """Return the statistics of the coefficients of levels 1 … `levels` that end at sample `begin` or after."""

    def across(self, running_sum: Vector, level: int) -> Statistics:
        """Return the statistics of all coefficients of one level of a running sum."""

    def values(self, coefficients: Vector, level: int) -> LevelStatistic:
        """Return the statistic of coefficients of one level, none or many."""

    def at(self, level: int, part: Any, resolution: float) -> Statistics:
        """Return statistics with `part` at `level` and none at other levels; |W| up to `resolution` is a rounding
        error."""

    def empty(self) -> Statistics:
        """Return the statistics of no coefficients."""
