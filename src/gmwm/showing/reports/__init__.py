"""Reports of calibrations: collect the content as plain data, and render it as one self-contained HTML page."""

from gmwm.showing.reports.content import Section, report_data
from gmwm.showing.reports.write import report

__all__ = ["Section", "report", "report_data"]
