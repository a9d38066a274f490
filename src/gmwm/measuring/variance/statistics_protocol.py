"""Protocols for statistics of wavelet coefficients that are collected in chunks, in addition to the sums of squares."""

from __future__ import annotations

from typing import Any, Protocol

from gmwm.base.arrays import Vector


class LevelStatistic(Protocol):
    """Statistic of some coefficients of one level. Statistics can be merged in any order and grouping."""

    def merge(self, other: Any, /) -> Any:
        """Return the statistic of the coefficients of `self` and `other` together."""


class Statistics(Protocol):
    """Statistics of the coefficients of all levels. They can be merged in any order and grouping."""

    def merge(self, other: Any, /) -> Any:
        """Return the statistics of the coefficients of `self` and `other` together."""


class StatisticsCollector(Protocol):
    """Object that computes statistics of wavelet coefficients; `squares` tells whether Σ W² is needed too."""

    squares: bool

    def haar(self, running_sum: Vector, levels: int, begin: int) -> Statistics:
        """Return the statistics of the coefficients of levels 1 … `levels` that end at sample `begin` or after."""

    def across(self, running_sum: Vector, level: int) -> Statistics:
        """Return the statistics of all coefficients of one level of a running sum."""

    def values(self, coefficients: Vector, level: int) -> LevelStatistic:
        """Return the statistic of an array of coefficients of one level, which can be empty."""

    def at(self, level: int, part: Any, resolution: float) -> Statistics:
        """Return the statistics of all levels, with `part` at `level`. Any |W| up to `resolution` can be a rounding
        error."""

    def empty(self) -> Statistics:
        """Return the statistics of no coefficients."""
