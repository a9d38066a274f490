"""Inspect a recording before it is used: its time base, its resolution, and whether the sensor was at rest."""

from gmwm.measuring.inspection.api import inspect
from gmwm.measuring.inspection.result import AxisInspection, Inspection

__all__ = ["AxisInspection", "Inspection", "inspect"]
