"""Covariance of wavelet variances, computed exactly from a model or estimated from the data."""

from gmwm.measuring.covariance.api import (
    as_design,
    covariance,
    covariances,
    ratio_variances,
    variances,
    wavelet_covariance,
)
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.covariance.empirical import empirical_covariance

__all__ = [
    "Design", "as_design", "covariance", "covariances", "empirical_covariance", "ratio_variances", "variances",
    "wavelet_covariance",
]  # fmt: skip
