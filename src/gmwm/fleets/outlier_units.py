"""Which units of a sample are not like the others: Rosner's procedure for numbers with errors of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Matrix, Vector
from gmwm.fleets.random_effects import effects

FEWEST = 8
"""With fewer units the others say too little of how far apart healthy ones are."""
SHARE, MOST = 0.1, 100
"""At most a tenth of the units, and so many, are looked at as outliers: more are not outliers but another type."""


@dataclass(frozen=True, eq=False)
class Deviants:
    """The units farthest from all others of their sample, the farthest first.

    Attributes
    ----------
    places : (m, k) array of int
        Their places; −1 beyond the number that was looked for.
    distance : (m, k) array
        t of each against those that are left.
    pvalue : (m, k) array
        Of finding so many outliers or more in a sample without any.
    """

    places: NDArray[np.int64]
    distance: Matrix
    pvalue: Matrix


def looked_for(count: Vector) -> NDArray[np.int64]:
    """How many outliers are looked for among so many units: a tenth of them, one at least; none among few.

    >>> looked_for(np.array([7, 8, 20, 5000])).tolist()
    [0, 1, 2, 100]
    """
    return np.where(count < FEWEST, 0, np.clip(np.floor(SHARE * count), 1, MOST)).astype(np.int64)


def deviants(x: Matrix, s2: Matrix) -> Deviants:
    """Take the farthest unit away, again and again, and test each against those that are left.

        t_i = (x_i − μ̂_{−i}) / v_i,   v_i² = τ̂²_{−i} + s_i² + Var μ̂_{−i},   ν_i = 2 v_i⁴ / Var v_i²

    against t of ν_i degrees of freedom (Satterthwaite; v_i² scatters as τ̂²_{−i} does), but no more than n − 2, the
    p-value times the number n of units that it was the farthest of. Where all s_i are nothing, ν_i = n − 2, and this is
    Rosner's generalised ESD procedure: the outliers at a level are all up to the last one whose p-value is below. So
    that this can be read off, the p-value of each is the least of its own and those taken after it.

    Parameters
    ----------
    x, s2 : (m, n) arrays
        Numbers, and the squares of their standard errors, above zero; NaN in `x` where there is none.

    References
    ----------
    Rosner (1983), Percentage points for a generalized ESD many-outlier procedure, Technometrics 25, 165-172.
    """
    from scipy.stats import t

    left = np.array(x, dtype=np.float64)
    wanted = looked_for(np.isfinite(left).sum(axis=-1))
    shape = (left.shape[0], int(wanted.max(initial=0)))
    places, distance, pvalue = np.full(shape, -1), np.full(shape, np.nan), np.ones(shape)
    whole = effects(left, s2)
    mean, spread2, error = whole.mean, whole.spread2, whole.error
    for k in range(shape[1]):
        rows = np.flatnonzero(wanted > k)
        here, here2 = left[rows], s2[rows]
        # Against all, itself among them: who is the farthest needs no more.
        size2 = spread2[rows, None] + here2 - error[rows, None] ** 2
        scaled = np.abs(here - mean[rows, None]) / np.sqrt(np.maximum(size2, np.finfo(float).tiny))
        far = np.nanargmax(scaled, axis=1)
        each = np.arange(rows.size)
        value, error2, count = here[each, far], here2[each, far], np.isfinite(here).sum(axis=-1)
        here[each, far] = np.nan
        left[rows, far] = np.nan
        others = effects(here, here2, start=spread2[rows])
        mean[rows], spread2[rows], error[rows] = others.mean, others.spread2, others.error
        size2 = others.spread2 + error2 + others.error**2
        distance[rows, k] = (value - others.mean) / np.sqrt(size2)
        scatter = others.spread2_variance * (1 + others.error2_slope) ** 2
        # Of an ill-known unit the size is known better than that, if τ̂² is no chance: among few units it often is.
        freedom = np.minimum(2 * size2**2 / scatter, count - 2)
        chance = 2 * t.sf(np.abs(distance[rows, k]), freedom)
        pvalue[rows, k] = np.minimum(1.0, count * chance)
        places[rows, k] = far
    return Deviants(places, distance, np.minimum.accumulate(pvalue[:, ::-1], axis=1)[:, ::-1])
