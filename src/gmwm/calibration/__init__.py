"""Calibrate recordings: choose and fit a noise model for every axis, and compute its datasheet numbers."""

from gmwm.calibration.agreement import agree
from gmwm.calibration.agreement_result import Agreement, SharedNumber
from gmwm.calibration.api import calibrate
from gmwm.calibration.options import CalibrationOptions
from gmwm.calibration.result import AxisCalibration, Calibration

__all__ = ["Agreement", "AxisCalibration", "Calibration", "CalibrationOptions", "SharedNumber", "agree", "calibrate"]
