"""Adjust p-values for the number of tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Vector


def holm(pvalues: ArrayLike) -> Vector:
    """Adjust p-values (n,) by Holm's method (1979, Scandinavian Journal of Statistics 6, 65-70): the probability of any
    true hypothesis with an adjusted p-value of at most s is at most s, even for dependent tests. NaN is a test that was
    not made.

    >>> holm([0.01, 0.5, np.nan, 0.02])
    array([0.03, 0.5 ,  nan, 0.04])
    """
    p = np.asarray(pvalues, dtype=np.float64)
    count = np.count_nonzero(~np.isnan(p))
    order = np.argsort(p, kind="stable")[:count]  # NaN is last
    adjusted = np.full_like(p, np.nan)
    adjusted[order] = np.maximum.accumulate(np.minimum((count - np.arange(count)) * p[order], 1.0))
    return adjusted
