"""Find outliers among units by Rosner's procedure, extended to estimates with different standard errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.random_effects import effects

LEAST_UNITS_FOR_OUTLIERS = 8
"""Least units for a search for outliers; tests/fleets/test_statistics.py checks the false alarms."""
SHARE, MOST = 0.1, 100
"""Largest share and number of units that are tested as outliers. More would be another type of unit."""


@dataclass(frozen=True, eq=False)
class Deviants:
    """For each of m samples, the k units with the largest distances from the remaining units."""

    places: NDArray[np.int64]  # (m, k) indices of the units, in the order of removal; −1 if fewer units were tested
    distance: Matrix  # (m, k) t statistic of each unit relative to the remaining units
    pvalue: Matrix  # (m, k) p-value of each unit, for a sample without outliers


def looked_for(count: Vector) -> NDArray[np.int64]:
    """Return how many of `count` units are tested as outliers: a tenth and at least one, but none of a small fleet.

    >>> looked_for(np.array([7, 8, 20, 5000])).tolist()
    [0, 1, 2, 100]
    """
    return np.where(count < LEAST_UNITS_FOR_OUTLIERS, 0, np.clip(np.floor(SHARE * count), 1, MOST)).astype(np.int64)


def deviants(x: Matrix, s2: Matrix) -> Deviants:
    """Remove the farthest unit repeatedly, and test each removed unit against the remaining ones.

    For unit i with the estimate x_i and the standard error s_i (NaN in x is a missing estimate), the test statistic is

        t_i = (x_i − μ̂_{−i}) / v_i,   v_i² = τ̂²_{−i} + s_i² + Var μ̂_{−i},   ν_i = 2 v_i⁴ / Var v_i².

    Here μ̂_{−i} and τ̂²_{−i} are the mean and variance between the remaining units. The statistic has about a t
    distribution with ν_i degrees of freedom (Satterthwaite), at most n − 2. The unit is the farthest of n, so its
    p-value is multiplied by n. It is then replaced by the smallest p-value of this unit and the units removed later:
    all units up to the last significant one are outliers. If all s_i are zero, this is Rosner's generalised ESD
    procedure (1983, Technometrics 25, 165-172) with ν_i = n − 2."""
    from scipy.special import stdtr

    remaining = np.array(x, dtype=np.float64)
    tested = looked_for(np.isfinite(remaining).sum(axis=-1))
    shape = (remaining.shape[0], int(tested.max(initial=0)))
    places, distance, pvalue = np.full(shape, -1), np.full(shape, np.nan), np.ones(shape)
    everything = effects(remaining, s2)
    mean, spread2, error = everything.mean, everything.spread2, everything.error
    for k in range(shape[1]):
        rows = np.flatnonzero(tested > k)
        here, here2 = remaining[rows], s2[rows]
        # To find the farthest unit, the distance from the mean of all units (including this one) is sufficient.
        size2 = spread2[rows, None] + here2 - error[rows, None] ** 2
        scaled = np.abs(here - mean[rows, None]) / np.sqrt(np.maximum(size2, np.finfo(float).tiny))
        far = np.nanargmax(scaled, axis=1)
        each = np.arange(rows.size)
        value, error2, count = here[each, far], here2[each, far], np.isfinite(here).sum(axis=-1)
        here[each, far] = np.nan
        remaining[rows, far] = np.nan
        others = effects(here, here2, start=spread2[rows])
        mean[rows], spread2[rows], error[rows] = others.mean, others.spread2, others.error
        size2 = others.spread2 + error2 + others.error**2
        distance[rows, k] = (value - others.mean) / np.sqrt(size2)
        scatter = others.spread2_variance * (1 + others.error2_slope) ** 2
        # For a unit with a large standard error, Satterthwaite's formula gives more than n − 2, although τ̂² comes from
        # few units.
        freedom = np.minimum(2 * size2**2 / scatter, count - 2)
        chance = 2 * stdtr(freedom, -np.abs(distance[rows, k]))
        pvalue[rows, k] = np.minimum(1.0, count * chance)
        places[rows, k] = far
    return Deviants(places, distance, np.minimum.accumulate(pvalue[:, ::-1], axis=1)[:, ::-1])
