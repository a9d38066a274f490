"""Estimation by the Generalized Method of Wavelet Moments (GMWM), which fits models to a measured wavelet variance."""

from gmwm.estimation.conditions_fit import ConditionsFit, Estimate
from gmwm.estimation.estimator import fit
from gmwm.estimation.result import Diagnostics, Fit
from gmwm.estimation.starts import Sampled, Start

__all__ = ["ConditionsFit", "Diagnostics", "Estimate", "Fit", "Sampled", "Start", "fit"]
