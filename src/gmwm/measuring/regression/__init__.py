"""Regression of an axis on temperature, time or other conditions: `against` parses the option, `blocks` and
`covariates` compute columns, `least_squares` coefficients of one axis (`result`), and `conditions` treats all axes."""

from gmwm.measuring.regression.result import Coefficient, Effect, Regression

__all__ = ["Coefficient", "Effect", "Regression"]
