"""Do the axes of a sensor differ? Hotelling's test of their differences, unit by unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gmwm._arrays import Matrix
from gmwm.fleets.statistics_result import SIGNED, AxisDifference
from gmwm.signals import sensor_of

LEAST = 6
"""Units in which all axes have a number, below which their differences are not tested."""


def differences(
    numbers: Sequence[tuple[str, str, str, str | None]], x: Matrix, size: float
) -> tuple[AxisDifference, ...]:
    """The axes of each sensor, number by number.

        T² = n d̄ᵀ S⁻¹ d̄,   (n − p) T² / (p (n − 1)) ~ F(p, n − p)

    with d the differences of neighbouring axes in each of the n units that have all, S their covariance and p one less
    than axes. What the axes of a unit share, and that some are known better than others, does not matter to it.

    Parameters
    ----------
    numbers : sequence of (axis, symbol, unit, model)
        What the rows of `x` are.
    x : (m, n) array
        Numbers of n units on the scale of comparison, NaN where there is none.
    size : float
        Of all tests together.

    References
    ----------
    Hotelling (1931), The generalization of Student's ratio, Annals of Mathematical Statistics 2, 360-378.
    """
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
    """P-value of d (p, n) having the mean zero; None where their scatter is not of full rank."""
    from scipy.stats import f

    p, n = d.shape
    mean = d.mean(axis=1)
    # In units of their own scatter, so that the rank is told whatever the units.
    size = d.std(axis=1, ddof=1)
    if n <= p or not np.all(size > 0):
        return None
    scatter = np.atleast_2d(np.corrcoef(d))
    if np.linalg.matrix_rank(scatter, hermitian=True) < p:
        return None
    t2 = n * float(mean / size @ np.linalg.solve(scatter, mean / size))
    return float(f.sf((n - p) * t2 / (p * (n - 1)), p, n - p))


def _adjusted(found: Sequence[AxisDifference], size: float) -> tuple[AxisDifference, ...]:
    """Holm's adjustment over all."""
    made, least = list(found), 0.0
    for rank, k in enumerate(sorted(range(len(made)), key=lambda k: made[k].pvalue)):
        least = max(least, min(1.0, (len(made) - rank) * made[k].pvalue))
        made[k] = replace(made[k], adjusted=least, differs=least <= size)
    return tuple(made)
