"""Many units of one type: each calibrated, and what they tell together."""

from gmwm.fleets.engine import fleet as fleet
from gmwm.fleets.result import Fleet as Fleet
