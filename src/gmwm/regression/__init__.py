"""Regression of an axis on the temperature, on time or on other conditions of the recording.

In the order of the data: `against` (the option), `covariates` and `columns` on the `blocks` of the clock, generalised
`least_squares` with the `noise` of the axis, its `result`, and the `conditions` of all axes of a recording.
"""

from gmwm.regression.result import Coefficient, Effect, Regression

__all__ = ["Coefficient", "Effect", "Regression"]
