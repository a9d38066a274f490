"""Exact Gaussian likelihood, maximum-likelihood fits, residuals and estimates of latent processes with a Kalman
filter."""

from gmwm.likelihood.estimator import fit_ml
from gmwm.likelihood.innovations import Residuals, residuals
from gmwm.likelihood.result import LikelihoodFit
from gmwm.likelihood.tracks import Tracks, filter_tracks, predict_tracks, smooth_tracks

__all__ = [
    "LikelihoodFit", "Residuals", "Tracks", "filter_tracks", "fit_ml", "predict_tracks", "residuals", "smooth_tracks",
]  # fmt: skip
