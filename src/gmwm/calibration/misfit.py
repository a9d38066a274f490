"""The scale at which a model is farthest from the data, and the datasheet numbers that this scale affects."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.calibration.number_verdicts import OF_FILTER, memory_of_filter
from gmwm.calibration.result import AxisCalibration
from gmwm.choosing.datasheets.bias import SYMBOL
from gmwm.choosing.datasheets.effective import DEFAULT_HORIZON_S
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.variance.allan_regression import LAWS
from gmwm.theory.processes import Model
from gmwm.theory.processes.base import Process, registry

Mask = NDArray[np.bool_]


def line_in(model: Model) -> str | None:
    """Return the name of the first sinusoidal process in a model; None if there is none."""
    return next((process.name for process in model.processes if is_line(type(process))), None)


def line_process() -> str | None:
    """Return the name of the first sinusoidal process in the registry; None if there is none."""
    return next((name for name, kind in registry.items() if is_line(kind)), None)


def is_line(kind: type[Process]) -> bool:
    """Return whether a class is a sinusoidal process."""
    return kind.line is not Process.line


@dataclass(frozen=True, kw_only=True)
class LargestMisfit:
    """Scale `tau` (s) of the largest distance, its `ratio`, and the `numbers` of that end (short or long scales)."""

    tau: float
    ratio: float
    numbers: tuple[str, ...]

    @property
    def times(self) -> float:
        """`ratio` or its inverse, whichever is larger."""
        return max(self.ratio, 1 / self.ratio)


def misfit_of(found: AxisCalibration) -> LargestMisfit | None:
    """Return the largest misfit outside the data's limits, or None, among tested levels: others vary too much."""
    wv, apart = found.fit.wavelet_variance, _misfits(found)
    if not np.any(apart):
        return None
    worst = int(np.argmax(apart))
    tau, ratio = float(wv.tau[worst]), float(found.fit.implied[worst] / wv.variance[worst])
    slopes, is_long = {str(symbol): law.slope for symbol, law in LAWS.items()}, tau > _middle(found)
    # A filter follows what changes more slowly.
    is_slow = is_long or tau > memory_of_filter(found.datasheet)
    numbers = tuple(
        name for name in found.datasheet if name in slopes and (is_slow if slopes[name] >= 0 else not is_long)
    )
    return LargestMisfit(tau=tau, ratio=ratio, numbers=numbers)


def moves_white_noise(found: AxisCalibration) -> bool:
    """Return whether the misfit at scales within the horizon of a filter can move N, the root of a variance, beyond its
    interval, which contains the model error of a mean over all scales."""
    white, near = found.datasheet[OF_FILTER[0]], found.fit.wavelet_variance.tau <= 2 * DEFAULT_HORIZON_S
    return (
        white.high is not None and white.value * math.exp(np.max(_misfits(found)[near], initial=0.0) / 2) > white.high
    )


def _misfits(found: AxisCalibration) -> Vector:
    """Return the distances (J,) between the logarithms of model and data, 0 within the data's limits."""
    wv, outside = found.fit.wavelet_variance, _outside(found.fit) & in_any_recording(found, _outside)
    if found.test is not None:
        outside &= np.isin(wv.levels, found.test.levels)
    # The ratio is undefined if a variance is zero.
    outside &= (wv.variance > 0) & (found.fit.implied > 0)
    apart = np.zeros(len(wv))
    apart[outside] = np.abs(np.log(found.fit.implied[outside]) - np.log(wv.variance[outside]))
    return apart


def in_any_recording(found: AxisCalibration, levels: Callable[[Fit], Mask]) -> Mask:
    """Return the levels (J,) found in the fit of at least one recording: a mean of different recordings deviates
    significantly, which is no reason against each one's numbers."""
    mask = np.full(len(found.fit.wavelet_variance), found.replicates is None)
    for single in () if found.replicates is None else found.replicates.fits.values():
        in_single = levels(single)
        mask[: in_single.size] |= in_single[: mask.size]
    return mask


def _outside(fit: Fit) -> Mask:
    """Return a mask (J,) of the levels at which a model is outside the limits of the data."""
    return np.asarray((fit.implied < fit.wavelet_variance.lower) | (fit.implied > fit.wavelet_variance.upper))


def _middle(found: AxisCalibration) -> float:
    """Return the scale (s) of the minimal Allan deviation, or the geometric mean, between short and long scales."""
    bottom = found.datasheet.get(SYMBOL)
    wv = found.fit.wavelet_variance
    if bottom is not None and bottom.tau is not None and not bottom.upper_only:
        return 2 * bottom.tau  # a scale is twice the averaging time
    return math.sqrt(float(wv.tau[0] * wv.tau[-1]))
