"""Relative error of a model, which is the part of its difference from the data that chance does not explain.

For long recordings, a goodness-of-fit test rejects every model. As in random-effects models, each level is wrong by an
independent factor 1 ± τ, so that the chi-square statistic equals its expectation (Paule and Mandel 1982)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from gmwm.base.arrays import FrozenArrays, Matrix, Vector
from gmwm.base.documents import Documented
from gmwm.base.errors import GmwmError
from gmwm.base.lazy import scipy
from gmwm.fitting.estimation.goodness import usable_levels
from gmwm.fitting.estimation.linearised import columns_of, relative_jacobian, square_of_rest
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.reweighting import nearly_settled
from gmwm.fitting.estimation.weighting import precision, square_root
from gmwm.measuring.covariance import Design, covariance
from gmwm.measuring.covariance.api import variances
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.model import Model

LARGEST_MODEL_ERROR = 1.0
"""Largest error; a model that is wrong by a factor of two is useless (tests/inference/test_model_error.py)."""
COARSE_TEST_SIZE = 0.01
"""Significance level of the test of the coarse levels of one fit. It is 1 % because a unit has several axes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RelativeMisfit(FrozenArrays, Documented):
    """Relative difference between a model and its data: d = ν²/ν̂² − 1 (`distance`), its standard error s, and levels
    with over 30 degrees of freedom (`judged`), of which `largest` and `rms` summarise √max(d² − s², 0)."""

    distance: Vector
    error: Vector
    judged: np.ndarray[Any, np.dtype[np.bool_]]
    largest: float
    rms: float
    tau: float


JUDGED_FREEDOM = 30.0
"""Degrees of freedom above which a level is judged. The relative standard error of the level is then below 26 %."""


def relative_misfit(fit: Fit) -> RelativeMisfit:
    """Compute the relative difference between a fitted model and its data."""
    wv = fit.wavelet_variance
    error = np.sqrt(2 / wv.degrees_of_freedom)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.where(wv.variance > 0, fit.implied / np.where(wv.variance > 0, wv.variance, 1.0) - 1, 0.0)
    judged = (wv.degrees_of_freedom > JUDGED_FREEDOM) & (wv.variance > 0)
    beyond = np.where(judged, np.sqrt(np.maximum(distance**2 - error**2, 0.0)), 0.0)
    worst = int(np.argmax(beyond))
    count = max(int(np.count_nonzero(judged)), 1)
    square = float(np.sum(np.where(judged, distance**2 - error**2, 0.0))) / count
    return RelativeMisfit(
        distance=np.asarray(distance), error=np.asarray(error), judged=np.asarray(judged),
        largest=float(beyond[worst]), rms=float(np.sqrt(max(square, 0.0))), tau=float(wv.tau[worst]),
    )  # fmt: skip


def implausible_levels(fit: Fit, size: float = COARSE_TEST_SIZE) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Return a mask (J,) of the coarse levels, with at most 30 degrees of freedom, that differ from the model by more
    than chance explains, by chi-square tests with the probability `size` of at least one marked level."""
    wv = fit.wavelet_variance
    design = Design.of(wv)
    coarse = (design.degrees_of_freedom <= JUDGED_FREEDOM) & (fit.implied > 0) & (wv.variance > 0)
    if not np.any(coarse):
        return np.zeros(len(wv), dtype=np.bool_)
    freedom = 2 * fit.implied**2 / np.where(coarse, variances(fit.model, design), np.inf)
    place = np.where(coarse, freedom * wv.variance / np.where(coarse, fit.implied, 1.0) / 2, 1.0)
    half = np.where(coarse, np.maximum(freedom, 1e-3) / 2, 1.0)
    tail = 2 * np.minimum(scipy.special.gammainc(half, place), scipy.special.gammaincc(half, place))
    return np.asarray(coarse & (tail < size / np.count_nonzero(coarse)))


def model_error(fit: Fit) -> float:
    """Estimate τ ≤ 1 of a fit, refitted with the weights of τ (Paule and Mandel 1982); 0 if chance explains all."""
    error = Distance.of(fit).error()
    # Largest number of fits with weights that follow from the error.
    for _ in range(2 if error else 0):
        try:
            again = nearly_fitted(fit.model, having_error(fit.wavelet_variance, error), fit.weighting)
        except GmwmError:
            break
        before, error = error, Distance.of(replace(again, wavelet_variance=fit.wavelet_variance)).error()
        # Relative change of the error below which no further fit is needed.
        if abs(error - before) <= 0.05 * error:
            break
    return error


def having_error(wv: WaveletVariance, error: float) -> WaveletVariance:
    """Return the wavelet variance with `error` as the relative error of the model at each level."""
    return wv if error == wv.model_error else replace(wv, model_error=error)


def nearly_fitted(model: Model, wv: WaveletVariance, weighting: str) -> Fit:
    """Fit a model, without a certificate, with weights that have converged to a few per cent, to compare models."""
    return Fit.of(nearly_settled(model, wv, weighting)[0], wv, weighting)


@dataclass(frozen=True, eq=False)
class Distance:
    """Residuals `left`, covariance V, relative derivatives (J, p) and fitted curve of the goodness-of-fit test."""

    left: Vector
    scatter: Matrix
    slopes: Matrix
    curve: Vector

    @classmethod
    def of(cls, fit: Fit) -> Distance:
        """Compute the difference between a fit and its data."""
        wv = fit.wavelet_variance
        used = usable_levels(wv)
        design = Design.of(wv).only(used)
        columns, _ = columns_of(fit.model, fit.diagnostics.acts_as)
        return cls(
            left=wv.variance[used] - fit.implied[used], scatter=covariance(fit.model, design),
            slopes=relative_jacobian(fit.model, design, columns), curve=fit.implied[used],
        )  # fmt: skip

    @property
    def freedom(self) -> int:
        """Degrees of freedom, which are the number of levels minus the number of parameters."""
        return int(self.left.size - self.slopes.shape[1])

    @property
    def surely(self) -> float:
        """p-value with every level as a degree of freedom, an upper bound for models of some of the terms."""
        return float(scipy.special.gammaincc(self.left.size / 2, self.statistic(0.0) / 2))

    @property
    def pvalue(self) -> float:
        """p-value of the chi-square test; 1 without degrees of freedom."""
        return float(scipy.special.gammaincc(self.freedom / 2, self.statistic(0.0) / 2)) if self.freedom > 0 else 1.0

    def statistic(self, error: float) -> float:
        """Compute the chi-square statistic of the residuals beyond the parameters, for a relative model error."""
        if error:
            share, left, slopes = self._axes
            scale = 1 / np.sqrt(share + error**2)
            return square_of_rest(scale * left, scale[:, None] * slopes)[0]
        root = square_root(precision(self.scatter))
        return square_of_rest(root @ self.left, root @ self.slopes)[0]

    @cached_property
    def _axes(self) -> tuple[Vector, Vector, Matrix]:
        """Variances in the axes of V relative to the curve, to which an error adds its square, residuals and slopes."""
        share, axes = np.linalg.eigh(self.scatter / np.outer(self.curve, self.curve))
        return np.maximum(share, 0), axes.T @ (self.left / self.curve), axes.T @ (self.slopes / self.curve[:, None])

    def error(self) -> float:
        """Return the relative error for which the statistic equals its degrees of freedom; 0 if it is smaller."""
        if self.freedom < 1 or self.statistic(0.0) <= self.freedom:
            return 0.0
        # Smallest error that is considered. It is far below the relative standard error of any level.
        low, high = 1e-5, LARGEST_MODEL_ERROR
        if self.statistic(high) > self.freedom:
            return LARGEST_MODEL_ERROR
        for _ in range(24):
            middle = float(np.sqrt(low * high))
            low, high = (middle, high) if self.statistic(middle) > self.freedom else (low, middle)
        return float(np.sqrt(low * high))
