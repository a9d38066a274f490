"""Exact Gaussian likelihood, maximum-likelihood fits, residuals and latent processes with a Kalman filter."""

from gmwm.fitting.likelihood.correlations import autocorrelation
from gmwm.fitting.likelihood.estimator import fit_ml
from gmwm.fitting.likelihood.estimator import loglikelihood as loglikelihood
from gmwm.fitting.likelihood.innovations import Evaluation, Forecasts, Residuals, evaluate, residuals
from gmwm.fitting.likelihood.integrated import ArimaFit, Forecast, fit_arima
from gmwm.fitting.likelihood.result import LikelihoodFit
from gmwm.fitting.likelihood.tracks import Tracks, filter_tracks, predict_tracks, smooth_tracks

__all__ = [
    "ArimaFit", "Evaluation", "Forecast", "Forecasts", "LikelihoodFit", "Residuals", "Tracks", "autocorrelation",
    "evaluate", "filter_tracks", "fit_arima", "fit_ml", "predict_tracks", "residuals", "smooth_tracks",
]  # fmt: skip
