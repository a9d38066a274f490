"""The relative error of a model: how far it is from the data at each level beyond what chance explains.

Long recordings reject every model. The error τ of a model is estimated as in random-effects models: each level of the
model is off by a factor 1 ± τ, independent of the others, in addition to the scatter of the data. The estimate makes
the chi-square statistic equal to its expectation (Paule and Mandel 1982).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gmwm._arrays import Vector, freeze
from gmwm.covariance import Design, covariance
from gmwm.errors import GmwmError
from gmwm.estimation.estimator import refitted
from gmwm.estimation.result import Fit
from gmwm.estimation.weighting import precision, square_root
from gmwm.inference.asymptotic import COLLINEAR, columns_of, relative_jacobian
from gmwm.inference.goodness import usable_levels
from gmwm.variance.result import WaveletVariance

LARGEST = 1.0
"""Largest error that is considered: a model that is off by a factor of two says nothing (tests/inference/
test_model_error.py)."""
_ROUNDS = 4
_HALVINGS = 40
KNOWN = 0.5
"""Largest relative standard error of a level for which a distance between model and data is stated: with more, the
distance is mostly chance (docs/validation/sensors.md)."""


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
        """The misfit as numbers and lists, ready for JSON."""
        return {
            "distance": self.distance.tolist(), "error": self.error.tolist(), "judged": self.judged.tolist(),
            "largest": self.largest, "rms": self.rms, "tau": self.tau,
        }  # fmt: skip

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> RelativeMisfit:
        """The misfit whose `to_dict` gave `values`."""
        arrays = {name: np.array(values[name], dtype=np.float64) for name in ("distance", "error")}
        judged = np.array(values["judged"], dtype=np.bool_)
        return cls(**{**values, **arrays, "judged": judged})


MANY = 30.0
"""Degrees of freedom above which a level is judged: its relative standard error is then below 26 %."""


def relative_misfit(fit: Fit) -> RelativeMisfit:
    """Compute the relative distance of a fitted model from its data."""
    wv = replace(fit.wavelet_variance, excess=None)
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


def model_error(fit: Fit) -> float:
    """Estimate the relative error τ of a fitted model; 0 if the goodness-of-fit test accepts the model.

    The model is fitted again with the weights that follow from τ, until both agree.

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
    bare = replace(fit.wavelet_variance, excess=None)
    other, error = fit.wavelet_variance.excess, 0.0
    current = fit
    for _ in range(_ROUNDS):
        before, error = error, _solved(current, bare, other)
        if error == 0.0 or abs(error - before) <= 0.02 * error:
            break
        try:
            current = refitted(current, having_error(fit.wavelet_variance, error))
        except GmwmError:
            break
    return error


def having_error(wv: WaveletVariance, error: float) -> WaveletVariance:
    """The wavelet variance with a relative error of the model at each level, in addition to its other excess."""
    if error == 0.0:
        return wv
    added = error**2 * np.eye(len(wv))
    return replace(wv, excess=added if wv.excess is None else wv.excess + added)


def _solved(fit: Fit, bare: WaveletVariance, other: Any) -> float:
    """The τ at which the statistic of a fit equals its degrees of freedom."""
    used = usable_levels(bare)
    design = Design.of(replace(bare, excess=other)).only(used)
    columns, _ = columns_of(fit.model, fit.diagnostics.acts_as)
    slopes = relative_jacobian(fit.model, design, columns)
    scatter, curve = covariance(fit.model, design), fit.implied[used]
    left = bare.variance[used] - curve
    freedom = left.size - slopes.shape[1]
    if freedom < 1:
        return 0.0

    def statistic(error: float) -> float:
        root = square_root(precision(scatter + np.diag((error * curve) ** 2)))
        weighted, miss = root @ slopes, root @ left
        length = np.linalg.norm(weighted, axis=0)
        axes, strength, _ = np.linalg.svd(weighted[:, length > 0] / length[length > 0], full_matrices=False)
        taken = axes[:, strength > COLLINEAR * strength.max(initial=0.0)].T @ miss
        return float(miss @ miss - taken @ taken)

    if statistic(0.0) <= freedom:
        return 0.0
    low, high = 1e-5, LARGEST
    if statistic(high) > freedom:
        return LARGEST
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if statistic(middle) > freedom else (low, middle)
    return float(np.sqrt(low * high))
