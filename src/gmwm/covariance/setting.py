"""How a wavelet variance was measured: all that its covariance depends on besides the model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import freeze
from gmwm.filters import HAAR, WaveletFilter, find_filter
from gmwm.variance.result import WaveletVariance
from gmwm.variance.transform import Transform, coefficient_counts


@dataclass(frozen=True, eq=False)
class Setting:
    """Levels, length of the record, rate, filter, transform and estimator of a wavelet variance.

    Attributes
    ----------
    levels : (J,) int array
        Levels j, ascending from 1.
    samples : int
        Length N of the record.
    rate : float
        Samples per second (Hz).
    filter : WaveletFilter
    transform : "modwt" or "dwt"
    efficiency : float or None
        Of a robust estimate; None of a classical one.

    Examples
    --------
    >>> Setting(np.arange(1, 4), samples=100, rate=1.0).counts
    array([99, 97, 93])
    """

    levels: NDArray[np.int64]
    samples: int
    rate: float
    filter: WaveletFilter = HAAR
    transform: Transform = "modwt"
    efficiency: float | None = None

    def __post_init__(self) -> None:
        # A copy of its own: freezing the caller's array would be a surprise.
        object.__setattr__(self, "levels", freeze(np.array(self.levels, dtype=np.int64)))

    @classmethod
    def of(cls, wv: WaveletVariance) -> Setting:
        """The setting in which `wv` was measured."""
        return cls(wv.levels, wv.samples, wv.rate, find_filter(wv.filter), wv.transform, wv.efficiency)

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number M_j of coefficients behind each estimate (J,)."""
        return coefficient_counts(self.samples, self.levels, self.filter, self.transform)

    @property
    def running_sum(self) -> bool:
        """Whether the coefficients are second differences of a running sum: the maximal-overlap Haar transform."""
        return self.filter is HAAR and self.transform == "modwt"
