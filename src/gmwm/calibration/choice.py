"""Choose and fit the model of one axis."""

from __future__ import annotations

from collections.abc import Callable

from gmwm.calibration.options import CalibrationOptions
from gmwm.estimation.estimator import as_fit
from gmwm.estimation.result import Fit
from gmwm.estimation.reweighting import settle
from gmwm.processes.model import Model
from gmwm.selection.search import Searched, given_curve, given_model, search, within_family
from gmwm.spectrum import PowerSpectrum
from gmwm.variance.result import WaveletVariance


def chosen_model(
    wv: WaveletVariance, spectrum: PowerSpectrum | None, options: CalibrationOptions, *, check: Callable[[], None]
) -> Searched:
    """Search for a model, select within the sum that the user gave, or use the model that the user gave.

    Parameters
    ----------
    wv : WaveletVariance
    spectrum : PowerSpectrum or None
    options : CalibrationOptions
        Of the axis.
    check : function
        Called between steps; it may raise to end the search.
    """
    if options.models:
        return given_model(options.general, wv, options.ranking)
    if options.searched:
        # The covariance of a robust estimate of a sinusoid is unknown.
        return search(wv, None if wv.robust else spectrum, options.ranking, check=check)
    return within_family(options.general, wv, options.ranking, check=check)


def final_fit(model: Model, wv: WaveletVariance, weighting: str) -> Fit:
    """Fit a model with weights that have converged, and certify the optimum.

    It issues no warnings, because threads share the filters of Python's warnings. Remarks are in the fit.
    """
    return as_fit(settle(model, wv, weighting, certify=True), wv, weighting)


def given_fit(model: Model, wv: WaveletVariance, options: CalibrationOptions) -> Fit:
    """Fit a model as `calibrate` fits the model that the user gave, without its ranking."""
    return final_fit(model, given_curve(model, wv, options.weighting), options.weighting)
