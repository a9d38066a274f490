"""Calibrating: every axis of a unit, from the recording to its recommended model and its numbers."""

from gmwm.calibration.agreement import agreement as agreement
from gmwm.calibration.agreement_result import Agreement as Agreement
from gmwm.calibration.api import calibrate as calibrate
from gmwm.calibration.result import Calibration as Calibration
