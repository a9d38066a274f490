"""Many units of one type: each calibrated, and what they tell together."""

from gmwm.fleets.engine import fleet
from gmwm.fleets.result import Fleet

__all__ = ["Fleet", "fleet"]
