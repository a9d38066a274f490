"""Error budget of inertial navigation: attitude, velocity and position errors that sensor noise causes over time."""

from gmwm.budgets.api import GRAVITY, LATITUDE, budget
from gmwm.budgets.result import Budget, Growth

__all__ = ["GRAVITY", "LATITUDE", "Budget", "Growth", "budget"]
