"""Export the noise of a calibrated unit to files for filters, simulators, spreadsheets and papers."""

from gmwm.showing.exporters import autopilots as autopilots
from gmwm.showing.exporters import key_files as key_files
from gmwm.showing.exporters import markov as markov
from gmwm.showing.exporters import ros as ros
from gmwm.showing.exporters import statespace as statespace
from gmwm.showing.exporters import tables as tables
from gmwm.showing.exporters.base import export, export_all, export_formats

__all__ = ["export", "export_all", "export_formats"]
