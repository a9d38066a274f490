"""Fits of models to a measured wavelet variance (GMWM), with standard errors, intervals, tests and the bootstrap."""

from gmwm.fitting.estimation.conditions_fit import ConditionsFit, Estimate
from gmwm.fitting.estimation.estimator import fit
from gmwm.fitting.estimation.result import Diagnostics, Fit
from gmwm.fitting.estimation.starts import Sampled, Start

__all__ = ["ConditionsFit", "Diagnostics", "Estimate", "Fit", "Sampled", "Start", "fit"]
