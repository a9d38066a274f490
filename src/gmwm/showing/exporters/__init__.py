"""Export the noise of a calibrated unit to files for filters, simulators, spreadsheets and papers."""

from gmwm.showing.exporters import airsim as airsim
from gmwm.showing.exporters import autopilots as autopilots
from gmwm.showing.exporters import autoware as autoware
from gmwm.showing.exporters import basalt as basalt
from gmwm.showing.exporters import dlio as dlio
from gmwm.showing.exporters import gazebo as gazebo
from gmwm.showing.exporters import glim as glim
from gmwm.showing.exporters import gnssinssim as gnssinssim
from gmwm.showing.exporters import gtsam as gtsam
from gmwm.showing.exporters import kfgins as kfgins
from gmwm.showing.exporters import matlab as matlab
from gmwm.showing.exporters import navego as navego
from gmwm.showing.exporters import numbers as numbers
from gmwm.showing.exporters import ros as ros
from gmwm.showing.exporters import statespace as statespace
from gmwm.showing.exporters import tables as tables
from gmwm.showing.exporters import yaml_keys as yaml_keys
from gmwm.showing.exporters.api import export, export_all, export_formats

__all__ = ["export", "export_all", "export_formats"]
