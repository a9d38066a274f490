"""Confronting: the model whose wavelet variance is nearest to the one observed."""

from gmwm.estimation.estimator import fit
from gmwm.estimation.result import Diagnostics, Fit
from gmwm.estimation.starts import Sampled, Start

__all__ = ["Diagnostics", "Fit", "Sampled", "Start", "fit"]
