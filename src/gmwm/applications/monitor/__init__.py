"""Monitor sensors at rest with control charts of the innovations of their calibrated models."""

from gmwm.applications.monitor.api import Monitor
from gmwm.applications.monitor.axis import Event
from gmwm.applications.monitor.baseline import Baseline, baselines
from gmwm.applications.monitor.consistency import AxisConsistency, Consistency, PredictionError, consistency
from gmwm.applications.monitor.redundant import UnitEvent, redundant
from gmwm.applications.monitor.trace import Trace

__all__ = [
    "AxisConsistency", "Baseline", "Consistency", "Event", "Monitor", "PredictionError", "Trace", "UnitEvent",
    "baselines", "consistency", "redundant",
]  # fmt: skip
