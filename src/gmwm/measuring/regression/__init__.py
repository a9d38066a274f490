"""Regression of an axis on the temperature, on time or on other conditions of the recording.

`against` parses the option, `blocks` and `covariates` compute the regression columns, `least_squares` the coefficients
of one axis (`result`), and `conditions` treats all axes of a recording.
"""

from gmwm.measuring.regression.result import Coefficient, Effect, Regression

__all__ = ["Coefficient", "Effect", "Regression"]
