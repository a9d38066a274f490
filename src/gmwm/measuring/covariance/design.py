"""Design of a wavelet variance, which is everything except the model that determines its covariance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gmwm.base.arrays import Booleans, Integers, Matrix, Vector, freeze
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.measuring.variance.robust import MEAN_SQUARE_COUNT
from gmwm.measuring.variance.transform import Transform, coefficient_counts, loss_factor, pooled_counts
from gmwm.theory.filters import HAAR, WaveletFilter, find_filter


@dataclass(frozen=True, eq=False)
class Design:
    """Levels, length of the recording, rate, filter, transform and estimator of a wavelet variance.

    Attributes
    ----------
    levels : (J,) int array
        Levels j, ascending from 1.
    samples : int
        Length N of the recording.
    rate : float
        Sampling rate (Hz).
    filter : WaveletFilter
        Wavelet filter.
    transform : "modwt" or "dwt"
        Maximal-overlap or decimated transform.
    efficiency : float or None
        Efficiency of a robust estimate; None for a classical estimate.
    segments : tuple of int
        Lengths of the segments; () for a recording without a gap.
    filled : int
        Number of samples that replace lost ones; see `gmwm.variance.transform.loss_factor`.
    strides : tuple of int
        Distance (samples) between the coefficients that each level uses; () if all coefficients are used.
    pooled : (J,) int array or None
        For the design of a single segment, the number of coefficients of all segments; otherwise None.
    excess : (J, J) array or None
        Relative covariance of the estimates in addition to the covariance for a Gaussian signal; see `WaveletVariance`.
    model_error : float
        Relative error of the model at each level; see `WaveletVariance`.

    Examples
    --------
    >>> Design(np.arange(1, 4), samples=100, rate=1.0).counts
    array([99, 97, 93])
    """

    levels: Integers
    samples: int
    rate: float
    filter: WaveletFilter = HAAR
    transform: Transform = "modwt"
    efficiency: float | None = None
    segments: tuple[int, ...] = ()
    filled: int = 0
    strides: tuple[int, ...] = ()
    pooled: Integers | None = None
    excess: Matrix | None = None
    model_error: float = 0.0

    def __post_init__(self) -> None:
        # Copy the array, because the caller's array must stay writable.
        object.__setattr__(self, "levels", freeze(np.array(self.levels, dtype=np.int64)))

    @classmethod
    def of(cls, wv: WaveletVariance) -> Design:
        """Return the design of a wavelet variance."""
        return cls(
            levels=wv.levels, samples=wv.samples, rate=wv.rate, filter=find_filter(wv.filter), transform=wv.transform,
            efficiency=wv.efficiency, segments=wv.segments, filled=wv.filled, strides=wv.strides, excess=wv.excess,
            model_error=wv.model_error,
        )  # fmt: skip

    @property
    def lengths(self) -> tuple[int, ...]:
        """Length of each segment without a gap."""
        return self.segments or (self.samples,)

    @property
    def longest(self) -> int:
        """Length of the longest segment without a gap."""
        return max(self.lengths)

    @cached_property
    def counts(self) -> Integers:
        """Number M_j (J,) of coefficients of each level in all segments, including those that strides leave out."""
        return freeze(pooled_counts(self.lengths, self.levels, self.filter, self.transform)[0])

    @cached_property
    def degrees_of_freedom(self) -> Vector:
        """Degrees of freedom η_j (J,) of a classical estimate, which do not depend on the model."""
        eta = pooled_counts(self.lengths, self.levels, self.filter, self.transform)[1]
        return freeze(np.asarray(eta / self.loss_factor))

    @property
    def loss_factor(self) -> float:
        """Factor by which filled samples increase the covariance."""
        return loss_factor(self.filled, self.samples)

    @property
    def few(self) -> Booleans:
        """Mask (J,) of the levels that have too few coefficients, in all segments together, for a robust estimate."""
        return np.asarray((self.counts if self.pooled is None else self.pooled) <= MEAN_SQUARE_COUNT)

    def only(self, which: Booleans) -> Design:
        """Return the design with only the levels that the mask `which` (J,) selects."""
        strides = tuple(np.array(self.strides, dtype=np.int64)[which].tolist()) if self.strides else ()
        excess = None if self.excess is None else self.excess[np.ix_(which, which)]
        return replace(self, levels=self.levels[which], strides=strides, excess=excess)

    @property
    def added(self) -> Matrix | None:
        """Relative covariance (J, J) that the excess and the model error add to that of a Gaussian signal; None if
        zero."""
        if not self.model_error:
            return self.excess
        own = self.model_error**2 * np.eye(self.levels.size)
        return own if self.excess is None else self.excess + own

    @property
    def for_weights(self) -> Design:
        """Design for the weights of a fit, with only the diagonal of the excess, up to a relative error of 1 %.

        The weights must not include an error that all levels have in common. Otherwise a curve of zero would be a good
        fit, because it differs from the data by a common factor (Peelle's puzzle).
        """
        if self.excess is None:
            return self
        # Largest relative error of a level by which the excess covariance changes the weights of a fit
        # (tests/covariance/test_excess.py).
        return replace(self, excess=np.diag(np.minimum(np.diag(self.excess), 0.01**2)))

    def segment(self, length: int, counts: Integers) -> Design | None:
        """Return the design of one segment of a given length; None if the segment has no level.

        `counts` are the numbers of coefficients of all segments together.
        """
        reached = self.reached(length)
        if not reached.any():
            return None
        single = replace(self, excess=None).only(reached)
        return replace(single, samples=length, segments=(), pooled=counts[reached], model_error=0.0)

    def reached(self, length: int) -> Booleans:
        """Return the mask (J,) of the levels with a coefficient in a segment of a given length."""
        return coefficient_counts(length, self.levels, self.filter, self.transform) > 0

    @property
    def running_sum(self) -> bool:
        """Whether the transform is the maximal-overlap Haar transform, which has second differences of a running
        sum."""
        return self.filter is HAAR and self.transform == "modwt"

    @property
    def without_lags(self) -> Design:
        """Design of the wavelet variances alone, if the filter has lags."""
        return replace(self.only(self.levels > 0), filter=HAAR)
