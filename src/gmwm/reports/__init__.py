"""HTML reports of calibrations: plain data, a template, and one self-contained page."""

from gmwm.reports.content import report_data
from gmwm.reports.write import report

__all__ = ["report", "report_data"]
