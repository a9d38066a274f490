"""Calibrate many units of one type, and compute statistics of their noise parameters."""

from gmwm.fleets.engine import fleet
from gmwm.fleets.result import Fleet

__all__ = ["Fleet", "fleet"]
