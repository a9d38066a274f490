"""Error budget of inertial navigation: attitude, velocity and position errors that sensor noise causes over time."""

from gmwm.applications.navigation.api import GRAVITY, LATITUDE, budget
from gmwm.applications.navigation.result import Budget, Growth

__all__ = ["GRAVITY", "LATITUDE", "Budget", "Growth", "budget"]
