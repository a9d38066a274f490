"""Covariance of wavelet variances, computed exactly from a model or estimated from the data."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
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
_MODULES = {"Design": "design", "empirical_covariance": "empirical"}


def __getattr__(name: str) -> object:
    """Import a name when it is used."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES.get(name, 'api')}"), name)
