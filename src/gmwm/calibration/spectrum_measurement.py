"""The spectrum of an axis that a calibration keeps."""

from __future__ import annotations

from collections.abc import Callable

from gmwm.errors import DataError
from gmwm.signals import Signal
from gmwm.spectrum import PowerSpectrum
from gmwm.spectrum.api import signal_psd


def measured_spectrum(signal: Signal) -> PowerSpectrum | None:
    """The spectrum of a signal, smoothed away from lines; None if the signal is too short for one."""
    return smoothed_or_none(lambda: signal_psd(signal))


def smoothed_or_none(measure: Callable[[], PowerSpectrum]) -> PowerSpectrum | None:
    """The result of `measure`, smoothed away from lines; None if there are too few samples."""
    try:
        return measure().smoothed()
    except DataError:
        return None
