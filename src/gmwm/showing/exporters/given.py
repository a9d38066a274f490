"""Convert noise parameters that were given instead of measured, and single fits, to calibrations for the exporters."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PureWindowsPath

import numpy as np

from gmwm.base.units import SI_UNIT
from gmwm.calibration.options import CalibrationOptions
from gmwm.calibration.result import AxisCalibration, Calibration
from gmwm.choosing.datasheets import datasheet
from gmwm.choosing.selection import Ranking
from gmwm.files.importers import Given
from gmwm.fitting.estimation.result import GIVEN, Diagnostics, Fit
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.model import Model
from gmwm.theory.processes.parameter import Fixed


def given_calibration(given: Given) -> Calibration:
    """Return given noise parameters as a calibration without confidence intervals.

    The weighting of its fits is "given". Because there are no data, an exporter raises an error if it needs an upper
    limit.

    Parameters
    ----------
    given : Given
        Result of `gmwm.importers.given_noise`.

    Raises
    ------
    MissingTheoryError
        If a process does not define its wavelet variance.

    Examples
    --------
    >>> from gmwm.importers import given_noise
    >>> found = given_calibration(given_noise("gyro: N=0.15deg/√h, K=1e-6rad/s/√s; accel: N=60µg/√Hz, B=9µg", 200.0))
    >>> [line for line in found.export().splitlines() if line.startswith("gyroscope_n")]
    ['gyroscope_noise_density: 4.363323e-05  # rad/s/sqrt(Hz)']
    """
    axes = {axis: _axis(axis, model, given.rate) for axis, model in given.models.items()}
    # The text of a datasheet is a source as well, and contains slashes: only a file has a name without folders.
    source = PureWindowsPath(given.source).name if given.written else given.source
    return Calibration(axes=axes, failed={}, settings=CalibrationOptions(), source=source)


def fitted_calibration(fits: Mapping[str, Fit], source: str = "") -> Calibration:
    """Return fits by axis as a calibration without intervals and tests, for formats that need only the noise models."""
    axes = {axis: _uncompared(fit) for axis, fit in fits.items()}
    return Calibration(axes=axes, failed={}, settings=CalibrationOptions(), source=source)


def _axis(axis: str, model: Model, rate: float) -> AxisCalibration:
    held = model.with_values(
        {name: Fixed(float(value)) for name, value in model.parameters.items() if value is not None}
    )
    # Given parameters are assumed to describe an hour: the correlation time of a Gauss-Markov bias for a random walk.
    samples = round(3600.0 * rate)
    levels = int(np.log2(samples))
    variance = held.wavelet_variance(levels, rate)
    unit = SI_UNIT["gyro" if axis.startswith("gyro") else "accel"]
    curve = WaveletVariance.from_values(variance, samples, rate, unit=unit, axis=axis)
    fit = Fit(
        wavelet_variance=curve, model=held,
        parameters={name: float(value) for name, value in held.parameters.items() if value is not None}, objective=0.0,
        lower_bound=None, relaxed_bound=0.0, implied=variance, decomposition=held.decomposition(levels, rate),
        weighting=GIVEN, weighting_matrix=np.diag(1.0 / variance**2),
        diagnostics=Diagnostics(acts_as={}, not_supported=(), nodes=0),
    )  # fmt: skip
    return _uncompared(fit)


def _uncompared(fit: Fit) -> AxisCalibration:
    """Return a fit as the calibration of an axis without a ranking of other models."""
    ranking = Ranking(
        candidates=(), within=fit.model, general=fit, weighting=fit.weighting, weighting_matrix=fit.weighting_matrix,
        wavelet=np.diag(fit.wavelet_variance.variance**2), confidence=0.95,
    )  # fmt: skip
    return AxisCalibration(fit=fit, intervals={}, test=None, datasheet=datasheet(fit), ranking=ranking)
