"""Calibrating: every axis of a unit, from the recording to its recommended model and its numbers."""

from gmwm.calibration.agreement import agreement as agreement
from gmwm.calibration.calibrate import calibrate as calibrate
from gmwm.calibration.result import Calibration as Calibration
from gmwm.calibration.shared import Agreement as Agreement
