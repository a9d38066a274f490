"""Estimation by the Generalized Method of Wavelet Moments (GMWM): fit the wavelet variance of a model to a measured
one."""

from gmwm.estimation.conditions_fit import ConditionsFit, Estimate
from gmwm.estimation.estimator import fit
from gmwm.estimation.result import Diagnostics, Fit
from gmwm.estimation.starts import Sampled, Start

__all__ = ["ConditionsFit", "Diagnostics", "Estimate", "Fit", "Sampled", "Start", "fit"]
