"""Export the noise of a calibrated unit to files for filters, simulators, spreadsheets and papers."""

from gmwm.exporters import airsim as airsim
from gmwm.exporters import autopilots as autopilots
from gmwm.exporters import autoware as autoware
from gmwm.exporters import basalt as basalt
from gmwm.exporters import dlio as dlio
from gmwm.exporters import fastlio as fastlio
from gmwm.exporters import gazebo as gazebo
from gmwm.exporters import glim as glim
from gmwm.exporters import gnssinssim as gnssinssim
from gmwm.exporters import gtsam as gtsam
from gmwm.exporters import kalibr as kalibr
from gmwm.exporters import kfgins as kfgins
from gmwm.exporters import kimera as kimera
from gmwm.exporters import liosam as liosam
from gmwm.exporters import matlab as matlab
from gmwm.exporters import navego as navego
from gmwm.exporters import numbers as numbers
from gmwm.exporters import okvis2 as okvis2
from gmwm.exporters import openvins as openvins
from gmwm.exporters import orbslam3 as orbslam3
from gmwm.exporters import ros as ros
from gmwm.exporters import statespace as statespace
from gmwm.exporters import tables as tables
from gmwm.exporters import vins as vins
from gmwm.exporters.api import export, export_all, export_formats

__all__ = ["export", "export_all", "export_formats"]
