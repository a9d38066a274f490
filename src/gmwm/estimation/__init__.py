"""Confronting: the model whose wavelet variance is nearest to the one observed."""

from gmwm.estimation.estimator import fit
from gmwm.estimation.result import Fit

__all__ = ["Fit", "fit"]
