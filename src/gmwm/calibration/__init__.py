"""Calibrate recordings: choose and fit a noise model for every axis, and compute its datasheet numbers."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gmwm.calibration.agreement import agree
    from gmwm.calibration.agreement_result import Agreement, SharedNumber
    from gmwm.calibration.api import calibrate
    from gmwm.calibration.options import CalibrationOptions
    from gmwm.calibration.result import AxisCalibration, Calibration

__all__ = ["Agreement", "AxisCalibration", "Calibration", "CalibrationOptions", "SharedNumber", "agree", "calibrate"]

_MODULES = {
    "Agreement": "agreement_result", "AxisCalibration": "result", "Calibration": "result",
    "CalibrationOptions": "options", "SharedNumber": "agreement_result", "agree": "agreement", "calibrate": "api",
}  # fmt: skip


def __getattr__(name: str) -> object:
    """Import a name when it is used."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
