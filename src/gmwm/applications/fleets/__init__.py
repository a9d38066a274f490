"""Calibrate many units of one type, and compute statistics of their noise parameters."""

from gmwm.applications.fleets.engine import fleet
from gmwm.applications.fleets.result import Fleet

__all__ = ["Fleet", "fleet"]
