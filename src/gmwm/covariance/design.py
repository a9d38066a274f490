"""The design of a wavelet variance: everything except the model that its covariance depends on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Matrix, Vector, freeze
from gmwm.filters import HAAR, WaveletFilter, find_filter
from gmwm.variance.result import WaveletVariance
from gmwm.variance.robust import FEW
from gmwm.variance.transform import Transform, coefficient_counts, loss_factor, pooled_counts

MOST = 0.01
"""Largest relative error of a level that the excess covariance adds to the weights
(tests/covariance/test_excess.py)."""


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
    transform : "modwt" or "dwt"
    efficiency : float or None
        Efficiency of a robust estimate; None for a classical one.
    segments : tuple of int
        Lengths of the segments; () for a recording without a gap.
    filled : int
        Number of samples that replace lost ones; see `gmwm.variance.transform.loss_factor`.
    strides : tuple of int
        For each level, the distance (samples) between the coefficients that were used; () if all were used.
    pooled : (J,) int array or None
        For one segment among several, the number of coefficients of all segments together.
    excess : (J, J) array or None
        Relative covariance of the estimates beyond a Gaussian signal of the model; see `WaveletVariance`.
    model_error : float
        Relative error of the model at each level.

    Examples
    --------
    >>> Design(np.arange(1, 4), samples=100, rate=1.0).counts
    array([99, 97, 93])
    """

    levels: NDArray[np.int64]
    samples: int
    rate: float
    filter: WaveletFilter = HAAR
    transform: Transform = "modwt"
    efficiency: float | None = None
    segments: tuple[int, ...] = ()
    filled: int = 0
    strides: tuple[int, ...] = ()
    pooled: NDArray[np.int64] | None = None
    excess: Matrix | None = None
    model_error: float = 0.0

    def __post_init__(self) -> None:
        # Copy the array, because the caller's array must stay writable.
        object.__setattr__(self, "levels", freeze(np.array(self.levels, dtype=np.int64)))

    @classmethod
    def of(cls, wv: WaveletVariance) -> Design:
        """Return the design of a wavelet variance."""
        return cls(
            levels=wv.levels,
            samples=wv.samples,
            rate=wv.rate,
            filter=find_filter(wv.filter),
            transform=wv.transform,
            efficiency=wv.efficiency,
            segments=wv.segments,
            filled=wv.filled,
            strides=wv.strides,
            excess=wv.excess,
            model_error=wv.model_error,
        )

    @property
    def lengths(self) -> tuple[int, ...]:
        """Length of each segment without a gap."""
        return self.segments or (self.samples,)

    @property
    def longest(self) -> int:
        """Length of the longest segment without a gap."""
        return max(self.lengths)

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number M_j of coefficients of each level (J,) in all segments, used or not."""
        return pooled_counts(self.lengths, self.levels, self.filter, self.transform)[0]

    @property
    def degrees_of_freedom(self) -> Vector:
        """Degrees of freedom η_j (J,) of a classical estimate, without a model."""
        eta = pooled_counts(self.lengths, self.levels, self.filter, self.transform)[1]
        return np.asarray(eta / self.loss_factor)

    @property
    def loss_factor(self) -> float:
        """Factor by which filled samples increase the covariance."""
        return loss_factor(self.filled, self.samples)

    @property
    def few(self) -> NDArray[np.bool_]:
        """Which levels have too few coefficients for a robust estimate, in all segments together (J,)."""
        return np.asarray((self.counts if self.pooled is None else self.pooled) <= FEW)

    def only(self, which: NDArray[np.bool_]) -> Design:
        """Return the design with only some of the levels."""
        strides = tuple(np.array(self.strides, dtype=np.int64)[which].tolist()) if self.strides else ()
        excess = None if self.excess is None else self.excess[np.ix_(which, which)]
        return replace(self, levels=self.levels[which], strides=strides, excess=excess)

    @property
    def added(self) -> Matrix | None:
        """Relative covariance (J, J) that is added to the covariance of a Gaussian signal, with the model error; None
        if it is zero."""
        if not self.model_error:
            return self.excess
        own = self.model_error**2 * np.eye(self.levels.size)
        return own if self.excess is None else self.excess + own

    @property
    def for_weights(self) -> Design:
        """The design for weights: only the diagonal of the excess is used, up to a relative error of 1 %.

        An error that all levels have in common must not enter weights. They would make a curve of zero a good fit,
        because it differs from the data by a common factor (Peelle's puzzle).
        """
        if self.excess is None:
            return self
        return replace(self, excess=np.diag(np.minimum(np.diag(self.excess), MOST**2)))

    def segment(self, length: int, counts: NDArray[np.int64]) -> Design | None:
        """Return the design of one segment, with its own levels and the `counts` of all segments; None if it has no
        level."""
        own = coefficient_counts(length, self.levels, self.filter, self.transform)
        reach = int(np.count_nonzero(own > 0))
        if reach == 0:
            return None
        return replace(
            self, levels=self.levels[:reach], samples=length, segments=(), strides=self.strides[:reach],
            pooled=counts[:reach], excess=None, model_error=0.0,
        )  # fmt: skip

    @property
    def running_sum(self) -> bool:
        """Whether the coefficients are second differences of a running sum: the maximal-overlap Haar transform."""
        return self.filter is HAAR and self.transform == "modwt"
