"""Test whether the axes of a sensor differ, by Hotelling's test of the differences within each unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gmwm.applications.fleets.statistics_result import SIGNED, AxisDifference
from gmwm.base.arrays import Matrix
from gmwm.base.axis_names import sensor_of
from gmwm.base.multiple_tests import holm

LEAST = 6
"""Smallest number of units with a value on all axes for the test. For three axes, 4 denominator degrees of freedom are
then left."""


def differences(
    numbers: Sequence[tuple[str, str, str, str | None]], x: Matrix, size: float
) -> tuple[AxisDifference, ...]:
    """Test for each noise parameter, a row (axis, symbol, unit, model) of `x` (m, n), whether the axes of a sensor
    differ.

        T² = n d̄ᵀ S⁻¹ d̄,   (n − p) T² / (p (n − 1)) ~ F(p, n − p).

    Here d (p,) are the differences between successive axes (x and y, y and z) in a unit, with the mean d̄ over the n
    units with values on all axes and the covariance S. A factor that all axes of a unit share cancels in d. The axes
    may have different precision (Hotelling 1931, Annals of Mathematical Statistics 2, 360-378)."""
    groups: dict[tuple[str, str], list[int]] = {}
    for k, (axis, symbol, _, _) in enumerate(numbers):
        if sensor := sensor_of(axis):
            groups.setdefault((sensor, symbol), []).append(k)
    made = []
    for (sensor, symbol), places in groups.items():
        whole = x[places][:, np.all(np.isfinite(x[places]), axis=0)]
        if len(places) < 2 or whole.shape[1] < LEAST or len({numbers[k][2:] for k in places}) > 1:
            continue
        pvalue = hotelling(np.diff(whole, axis=0))
        if pvalue is None:
            continue
        off = np.mean(whole - whole.mean(axis=0), axis=1)
        signed = symbol == SIGNED
        relative = {numbers[k][0]: float(d if signed else np.exp(d)) for k, d in zip(places, off, strict=True)}
        made.append(
            AxisDifference(
                sensor=sensor,
                symbol=symbol,
                unit=numbers[places[0]][2],
                units=whole.shape[1],
                relative=relative,
                pvalue=pvalue,
                adjusted=1.0,
                differs=False,
            )
        )
    return _adjusted(made, size)


def hotelling(d: Matrix) -> float | None:
    """Return the p-value of Hotelling's test that the mean of d (p, n) over n units is zero; None if it is singular."""
    from scipy.special import fdtrc

    p, n = d.shape
    mean = d.mean(axis=1)
    # The differences are scaled to unit variance, so that the rank does not depend on the unit.
    size = d.std(axis=1, ddof=1)
    if n <= p or not np.all(size > 0):
        return None
    scatter = np.atleast_2d(np.corrcoef(d))
    if np.linalg.matrix_rank(scatter, hermitian=True) < p:
        return None
    t2 = n * float(mean / size @ np.linalg.solve(scatter, mean / size))
    return float(fdtrc(p, n - p, (n - p) * t2 / (p * (n - 1))))


def _adjusted(found: Sequence[AxisDifference], size: float) -> tuple[AxisDifference, ...]:
    """Return the tests with p-values adjusted by Holm's method, and with the decision at a significance level."""
    adjusted = holm([one.pvalue for one in found]).tolist()
    return tuple(replace(one, adjusted=p, differs=p <= size) for one, p in zip(found, adjusted, strict=True))
