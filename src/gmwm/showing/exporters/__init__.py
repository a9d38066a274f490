"""Export the noise of a calibrated unit to files for filters, simulators, spreadsheets and papers."""

from gmwm.showing.exporters import autopilots as autopilots
from gmwm.showing.exporters import jsonfile as jsonfile
from gmwm.showing.exporters import markov as markov
from gmwm.showing.exporters import numbers as numbers
from gmwm.showing.exporters import ros as ros
from gmwm.showing.exporters import statespace as statespace
from gmwm.showing.exporters import tables as tables
from gmwm.showing.exporters import yaml_keys as yaml_keys
from gmwm.showing.exporters.api import export, export_all, export_formats

__all__ = ["export", "export_all", "export_formats"]
