"""Error budget of inertial navigation: the growth of attitude, velocity and position errors from noise models."""

from gmwm.budgets.api import GRAVITY, LATITUDE, budget
from gmwm.budgets.result import Budget, Growth

__all__ = ["GRAVITY", "LATITUDE", "Budget", "Growth", "budget"]
