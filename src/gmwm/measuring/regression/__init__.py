"""Regression of an axis on the temperature, on time or on other conditions of the recording.

The modules follow the order of the calculation. `against` parses the option, `blocks` divides a recording into blocks,
and `covariates` and `columns` compute the regression columns. `noise` and `least_squares` estimate the coefficients,
`result` contains the result for one axis, and `conditions` treats all axes of a recording.
"""

from gmwm.measuring.regression.result import Coefficient, Effect, Regression

__all__ = ["Coefficient", "Effect", "Regression"]
