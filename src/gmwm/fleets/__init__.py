"""Calibrate many units of one type, and compute the statistics of their numbers."""

from gmwm.fleets.engine import fleet
from gmwm.fleets.result import Fleet

__all__ = ["Fleet", "fleet"]
