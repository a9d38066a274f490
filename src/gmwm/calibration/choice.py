"""Choose and fit the model of one axis."""

from __future__ import annotations

from collections.abc import Callable

from gmwm.calibration.options import CalibrationOptions
from gmwm.choosing.selection.search import Searched, given_curve, given_model, search, within_family
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.reweighting import settle
from gmwm.measuring.spectrum import PowerSpectrum
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.model import Model


def chosen_model(
    wv: WaveletVariance, spectrum: PowerSpectrum | None, options: CalibrationOptions, *, check: Callable[[], None]
) -> Searched:
    """Choose the model of one axis as the options say.

    gmwm searches for the model, compares all models that are part of a largest model, or uses the model of the user.

    Parameters
    ----------
    wv : WaveletVariance
    spectrum : PowerSpectrum or None
    options : CalibrationOptions
        Options of this axis.
    check : function
        Function that is called between steps. It can raise an exception to stop the search.
    """
    if options.models:
        return given_model(options.general, wv, options.ranking)
    if options.searched:
        # The covariance of a robust estimate of a sinusoid is unknown.
        return search(wv, None if wv.robust else spectrum, options.ranking, check=check)
    return within_family(options.general, wv, options.ranking, check=check)


def final_fit(model: Model, wv: WaveletVariance, weighting: str) -> Fit:
    """Fit a model, repeating the fit until its weights have converged, and certify the optimum.

    The function issues no Python warnings, because threads share the warning filters. The fit contains the remarks.
    """
    return Fit.of(settle(model, wv, weighting, certify=True), wv, weighting)


def given_fit(model: Model, wv: WaveletVariance, options: CalibrationOptions) -> Fit:
    """Fit a given model in the same way as `calibrate` does for its argument `models`, without a ranking."""
    return final_fit(model, given_curve(model, wv, options.weighting), options.weighting)
