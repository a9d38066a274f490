"""Compute the columns of a regression: powers, splines and rates of change of covariates, and functions of time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gmwm.base.arrays import Matrix, Vector
from gmwm.measuring.regression.against import TIME, WARM_UP, CovariateTerm

HOUR = 3600.0
_SIGNS = {2: "²", 3: "³", 4: "⁴", 5: "⁵"}


@dataclass(frozen=True)
class Column:
    """One column of a regression, of the covariate `term`, such as "temperature^2", "temperature lag", "temperature
    knot 1" or "warmup tau", and its unit, such as "°C²", or ""."""

    name: str
    term: str
    power: str = ""


@dataclass(frozen=True)
class Basis:
    """The terms of a regression, the values of covariates (time in hours) without effect, and all knots of splines."""

    terms: tuple[CovariateTerm, ...]
    references: Mapping[str, float]
    knots: Mapping[str, tuple[float, ...]]

    @property
    def columns(self) -> tuple[Column, ...]:
        """The columns, in the order of the terms."""
        return tuple(column for term in self.terms for column in _columns(term))

    def matrix(self, values: Mapping[str, Vector], times: Vector, tau: float | None) -> Matrix:
        """Return the columns (n, p) for values of the covariates, times (s), and the time constant (s)."""
        return np.hstack([self._of_term(term, values.get(term.name, times), times, tau) for term in self.terms])

    def along(self, name: str, points: Vector) -> Matrix:
        """Return the columns (m, p) for values of one covariate, with zero for others and rates of change."""
        parts = []
        for term in self.terms:
            if term.name == name:
                points_or_times = points * HOUR if name == TIME else points
                parts.append(self._of_term(replace(term, lag=False), points_or_times, points, None))
                parts += [np.zeros((points.size, 1))] * term.lag
            else:
                parts.append(np.zeros((points.size, len(_columns(term)))))
        return np.hstack(parts)

    def _of_term(self, term: CovariateTerm, values: Vector, times: Vector, tau: float | None) -> Matrix:
        if term.name == WARM_UP:
            assert tau is not None
            decay = np.exp(-times / tau)
            return np.column_stack([decay, times / tau * decay])
        covariate = values / HOUR if term.name == TIME else values
        offsets = covariate - self.references[term.name]
        columns = [offsets**power for power in range(1, term.degree + 1)]
        if term.knots:
            at_reference = _spline(np.array([self.references[term.name]]), self.knots[term.name])
            curved = _spline(covariate, self.knots[term.name])
            columns += [curve - zero for curve, zero in zip(curved, at_reference, strict=True)]
        if term.lag:
            columns.append(np.gradient(values, times))
        return np.column_stack(columns)


def _columns(term: CovariateTerm) -> list[Column]:
    name, unit = term.name, term.unit
    if name == WARM_UP:
        return [Column(name, name), Column(f"{name} tau", name)]
    columns = [Column(name, name, unit)]
    columns += [Column(f"{name}^{k}", name, unit and unit + _SIGNS[k]) for k in range(2, term.degree + 1)]
    columns += [Column(f"{name} knot {k}", name, unit) for k in range(1, term.knots + 1)]
    if term.lag:
        columns.append(Column(f"{name} lag", name, unit and f"{unit}/s"))
    return columns


def _spline(values: Vector, knots: tuple[float, ...]) -> list[Vector]:
    """Return the nonlinear columns of a natural cubic spline (Hastie, Tibshirani and Friedman 2009, eq. 5.4)."""
    at, last = np.array(knots), knots[-1]
    width = last - at[0]

    def part(k: int) -> Vector:
        cubes = np.maximum(values - at[k], 0.0) ** 3 - np.maximum(values - last, 0.0) ** 3
        return np.asarray(cubes / (last - at[k]) / width)

    end = part(len(knots) - 2)
    return [part(k) - end for k in range(len(knots) - 2)]
