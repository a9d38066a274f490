"""Test whether the axes of a sensor differ, by Hotelling's test of the differences within each unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gmwm.applications.fleets.statistics_result import SIGNED, AxisDifference
from gmwm.base.arrays import Matrix
from gmwm.base.axis_names import sensor_of
from gmwm.base.multiple_tests import holm


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
    tests = []
    for (sensor, symbol), places in groups.items():
        complete = x[places][:, np.all(np.isfinite(x[places]), axis=0)]
        # Leaves 4 denominator degrees of freedom for three axes.
        if len(places) < 2 or complete.shape[1] < 6 or len({numbers[k][2:] for k in places}) > 1:
            continue
        pvalue = hotelling(np.diff(complete, axis=0))
        if pvalue is None:
            continue
        off = np.mean(complete - complete.mean(axis=0), axis=1)
        signed = symbol == SIGNED
        relative = {numbers[k][0]: float(d if signed else np.exp(d)) for k, d in zip(places, off, strict=True)}
        tests.append(AxisDifference(
            sensor=sensor, symbol=symbol, unit=numbers[places[0]][2], units=complete.shape[1], relative=relative,
            pvalue=pvalue, adjusted=1.0, differs=False,
        ))  # fmt: skip
    adjusted = holm([test.pvalue for test in tests]).tolist()
    return tuple(replace(test, adjusted=p, differs=p <= size) for test, p in zip(tests, adjusted, strict=True))


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
