"""Monitor sensors at rest with control charts of the innovations of their calibrated models."""

from gmwm.monitor.api import Monitor
from gmwm.monitor.baseline import Baseline
from gmwm.monitor.events import Event
from gmwm.monitor.redundant import UnitEvent, redundant
from gmwm.monitor.reference import baselines
from gmwm.monitor.trace import Trace

__all__ = ["Baseline", "Event", "Monitor", "Trace", "UnitEvent", "baselines", "redundant"]
