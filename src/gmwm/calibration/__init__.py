"""Calibration: from a recording to the recommended noise model and the datasheet numbers of every axis."""

from gmwm.calibration.agreement import agree
from gmwm.calibration.agreement_result import Agreement, SharedNumber
from gmwm.calibration.api import calibrate
from gmwm.calibration.options import CalibrationOptions
from gmwm.calibration.result import AxisCalibration, Calibration

__all__ = ["Agreement", "AxisCalibration", "Calibration", "CalibrationOptions", "SharedNumber", "agree", "calibrate"]
