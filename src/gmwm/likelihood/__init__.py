"""Exact Gaussian likelihood, maximum-likelihood fits, residuals and latent processes, by the Kalman filter."""

from gmwm.likelihood.estimator import fit_ml as fit_ml
from gmwm.likelihood.estimator import loglikelihood as loglikelihood
from gmwm.likelihood.innovations import Residuals as Residuals
from gmwm.likelihood.innovations import residuals as residuals
from gmwm.likelihood.result import LikelihoodFit as LikelihoodFit
from gmwm.likelihood.tracks import Tracks as Tracks
from gmwm.likelihood.tracks import filter_tracks as filter_tracks
from gmwm.likelihood.tracks import predict_tracks as predict_tracks
from gmwm.likelihood.tracks import smooth_tracks as smooth_tracks
