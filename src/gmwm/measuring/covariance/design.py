"""Design of a wavelet variance, which is everything except the model that determines its covariance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from gmwm.base.arrays import Booleans, Integers, Matrix, Vector, freeze
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.measuring.variance.robust import MEAN_SQUARE_COUNT
from gmwm.measuring.variance.transform import Transform, coefficient_counts, loss_factor, pooled_counts
from gmwm.theory.filters import HAAR, WaveletFilter, find_filter


@dataclass(frozen=True, eq=False)
class Design:
    """Levels, length, rate, filter, transform and estimator of a wavelet variance.

    `segments` are the lengths of segments, () without gaps, and `filled` counts replaced samples (`loss_factor`).
    `strides` are distances (samples) between the used coefficients of each level, () for all. For one segment of
    several, `pooled` (J,) counts the coefficients of all. `efficiency` is None for a classical estimate; see
    `WaveletVariance` for `excess` and `model_error`."""

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

    @staticmethod
    @lru_cache(maxsize=12)
    def of(wv: WaveletVariance) -> Design:
        """Return the design of a wavelet variance."""
        return Design(
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

    @cached_property
    def gaussian(self) -> Design:
        """The design itself if the signal is Gaussian and no sample is filled; otherwise the design with this."""
        if self.added is None and not self.filled:
            return self
        return replace(self, excess=None, model_error=0.0, filled=0)

    @cached_property
    def added(self) -> Matrix | None:
        """Relative covariance (J, J) in addition to that of a Gaussian signal; None if zero."""
        if not self.model_error:
            return self.excess
        own = self.model_error**2 * np.eye(self.levels.size)
        return own if self.excess is None else self.excess + own

    @cached_property
    def for_weights(self) -> Design:
        """Design for the weights of a fit, with only the diagonal of the excess, up to a relative error of 1 %. Weights
        with an error common to all levels would make a curve of zero a good fit (Peelle's puzzle)."""
        if self.excess is None:
            return self
        # Largest relative error by which the excess changes weights (tests/covariance/test_excess.py).
        return replace(self, excess=np.diag(np.minimum(np.diag(self.excess), 0.01**2)))

    def segment(self, length: int, counts: Integers) -> Design | None:
        """Return the design of a segment, with `counts` over all segments; None if the segment has no level."""
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
        """Whether the coefficients (maximal-overlap Haar) are second differences of a running sum."""
        return self.filter is HAAR and self.transform == "modwt"

    @property
    def without_lags(self) -> Design:
        """Design of the wavelet variances alone, if the filter has lags."""
        return replace(self.only(self.levels > 0), filter=HAAR)
