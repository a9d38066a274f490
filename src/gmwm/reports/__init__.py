"""Reporting: a calibration as one HTML page that works without a network, from plain data through a template."""

from gmwm.reports.content import report_data
from gmwm.reports.write import report

__all__ = ["report", "report_data"]
