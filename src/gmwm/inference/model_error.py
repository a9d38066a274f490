"""The relative error of a model: its distance from the data at each level in addition to chance.

Long recordings reject every model. The error τ of a model is estimated as in random-effects models: each level of the
model is off by a factor 1 ± τ, independent of the others, in addition to the scatter of the data. The estimate makes
the chi-square statistic equal to its expectation (Paule and Mandel 1982).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gmwm._arrays import Matrix, Vector, freeze
from gmwm.covariance import Design, covariance
from gmwm.covariance.api import variances
from gmwm.errors import GmwmError
from gmwm.estimation.estimator import as_fit
from gmwm.estimation.linearised import columns_of, relative_jacobian, unexplained
from gmwm.estimation.result import Fit
from gmwm.estimation.reweighting import nearly_settled
from gmwm.estimation.weighting import precision, square_root
from gmwm.inference.goodness import usable_levels
from gmwm.processes.model import Model
from gmwm.variance.result import WaveletVariance

LARGEST = 1.0
"""Largest error that is considered: a model that is wrong by a factor of two is of no use
(tests/inference/test_model_error.py)."""
IMPLAUSIBLE = 0.01
"""Level of the test of the coarse levels of one fit: 1 %, because a unit has several axes."""
SMALLEST = 1e-5
"""Smallest error that the search considers: far below the relative standard error of any level."""
_ROUNDS = 2
_SETTLED = 0.05
_HALVINGS = 24


@dataclass(frozen=True, kw_only=True, eq=False)
class RelativeMisfit:
    """Relative distance of a model from the data, over the levels with more than 30 degrees of freedom.

    Attributes
    ----------
    distance : (J,) array
        Model / data − 1 of the wavelet variance at each level.
    error : (J,) array
        Relative standard error of each level of the data.
    judged : (J,) bool array
        Levels with more than 30 degrees of freedom.
    largest, rms : float
        Largest and root mean square distance over the judged levels, with the part that chance explains taken off:
        √max(d² − s², 0).
    tau : float
        Scale (s) of the largest distance.
    """

    distance: Vector
    error: Vector
    judged: np.ndarray[Any, np.dtype[np.bool_]]
    largest: float
    rms: float
    tau: float

    def __post_init__(self) -> None:
        for array in (self.distance, self.error, self.judged):
            freeze(array)

    def to_dict(self) -> dict[str, Any]:
        """Return the misfit as numbers and lists, ready for JSON."""
        return {
            "distance": self.distance.tolist(), "error": self.error.tolist(), "judged": self.judged.tolist(),
            "largest": self.largest, "rms": self.rms, "tau": self.tau,
        }  # fmt: skip

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> RelativeMisfit:
        """Restore a misfit from `values`, the output of `to_dict`."""
        arrays = {name: np.array(values[name], dtype=np.float64) for name in ("distance", "error")}
        judged = np.array(values["judged"], dtype=np.bool_)
        return cls(**{**values, **arrays, "judged": judged})


MANY = 30.0
"""Degrees of freedom above which a level is judged: its relative standard error is then below 26 %."""


def relative_misfit(fit: Fit) -> RelativeMisfit:
    """Compute the relative distance of a fitted model from its data."""
    wv = fit.wavelet_variance
    error = np.sqrt(2 / wv.degrees_of_freedom)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.where(wv.variance > 0, fit.implied / np.where(wv.variance > 0, wv.variance, 1.0) - 1, 0.0)
    judged = (wv.degrees_of_freedom > MANY) & (wv.variance > 0)
    beyond = np.where(judged, np.sqrt(np.maximum(distance**2 - error**2, 0.0)), 0.0)
    worst = int(np.argmax(beyond))
    count = max(int(np.count_nonzero(judged)), 1)
    square = float(np.sum(np.where(judged, distance**2 - error**2, 0.0))) / count
    return RelativeMisfit(
        distance=np.asarray(distance), error=np.asarray(error), judged=np.asarray(judged),
        largest=float(beyond[worst]), rms=float(np.sqrt(max(square, 0.0))), tau=float(wv.tau[worst]),
    )  # fmt: skip


def implausible_levels(fit: Fit, size: float = IMPLAUSIBLE) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Return which coarse levels (J,) are farther from the model than simulated recordings of the model would be.

    Levels with at most 30 degrees of freedom are tested, each with the chi-square law of the variance that the model
    implies, at `size` for all of them together.

    Parameters
    ----------
    fit : Fit
    size : float
        Probability that a recording of the model has such a level.
    """
    from scipy.special import gammainc, gammaincc

    wv = fit.wavelet_variance
    design = Design.of(wv)
    coarse = (design.degrees_of_freedom <= MANY) & (fit.implied > 0) & (wv.variance > 0)
    if not np.any(coarse):
        return np.zeros(len(wv), dtype=np.bool_)
    freedom = 2 * fit.implied**2 / np.where(coarse, variances(fit.model, design), np.inf)
    place = np.where(coarse, freedom * wv.variance / np.where(coarse, fit.implied, 1.0) / 2, 1.0)
    half = np.where(coarse, np.maximum(freedom, 1e-3) / 2, 1.0)
    tail = 2 * np.minimum(gammainc(half, place), gammaincc(half, place))
    return np.asarray(coarse & (tail < size / np.count_nonzero(coarse)))


def model_error(fit: Fit) -> float:
    """Estimate the relative error τ of a fitted model; 0 if the distance from the data is as small as by chance.

    The model is fitted again with the weights that follow from τ, and τ is estimated again from this fit.

    Parameters
    ----------
    fit : Fit
        A fit with weights of its own model ("optimal" or "diagonal").

    Returns
    -------
    float
        τ, at most 1.

    References
    ----------
    Paule and Mandel (1982), Consensus values and weighting factors, J. Res. NBS 87, 377-385.
    """
    error = Distance.of(fit).error()
    for _ in range(_ROUNDS if error else 0):
        try:
            again = nearly_fitted(fit.model, having_error(fit.wavelet_variance, error), fit.weighting)
        except GmwmError:
            break
        before, error = error, Distance.of(replace(again, wavelet_variance=fit.wavelet_variance)).error()
        if abs(error - before) <= _SETTLED * error:
            break
    return error


def having_error(wv: WaveletVariance, error: float) -> WaveletVariance:
    """Return the wavelet variance with a relative error of the model at each level."""
    return wv if error == wv.model_error else replace(wv, model_error=error)


def nearly_fitted(model: Model, wv: WaveletVariance, weighting: str) -> Fit:
    """Fit a model with weights that have converged to a few per cent, without a certificate of the global optimum. It
    is for comparing models."""
    return as_fit(nearly_settled(model, wv, weighting)[0], wv, weighting)


@dataclass(frozen=True, eq=False)
class Distance:
    """The distance of a fit from its data, over the levels that the goodness-of-fit test uses.

    Attributes
    ----------
    left : (J,) array
        ν̂² − ν², in unit².
    scatter : (J, J) array
        V.
    slopes : (J, p) array
        Relative derivatives of ν² with respect to the parameters.
    curve : (J,) array
        ν².
    """

    left: Vector
    scatter: Matrix
    slopes: Matrix
    curve: Vector

    @classmethod
    def of(cls, fit: Fit) -> Distance:
        """Compute the distance of a fit; its covariance includes the excess of the data."""
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
        """Degrees of freedom: levels minus parameters."""
        return int(self.left.size - self.slopes.shape[1])

    @property
    def surely(self) -> float:
        """The p-value if every level were a degree of freedom. It is at least the p-value of any sum within the fitted
        one."""
        from scipy.special import gammaincc

        return float(gammaincc(self.left.size / 2, self.statistic(0.0) / 2))

    def statistic(self, error: float) -> float:
        """Compute the chi-square statistic for a model with a relative error, without the part that the parameters can
        fit."""
        root = square_root(precision(self.scatter + np.diag((error * self.curve) ** 2)))
        return unexplained(root @ self.left, root @ self.slopes)[0]

    def error(self) -> float:
        """Return the relative error with which the statistic equals its degrees of freedom."""
        if self.freedom < 1 or self.statistic(0.0) <= self.freedom:
            return 0.0
        low, high = SMALLEST, LARGEST
        if self.statistic(high) > self.freedom:
            return LARGEST
        for _ in range(_HALVINGS):
            middle = float(np.sqrt(low * high))
            low, high = (middle, high) if self.statistic(middle) > self.freedom else (low, middle)
        return float(np.sqrt(low * high))
