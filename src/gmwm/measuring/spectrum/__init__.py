"""Power spectral density of a signal, with the lines and bumps in it."""

from gmwm.measuring.spectrum.accumulate import SpectrumAccumulator
from gmwm.measuring.spectrum.api import psd
from gmwm.measuring.spectrum.axes_result import PowerSpectra
from gmwm.measuring.spectrum.line import Bump, Line
from gmwm.measuring.spectrum.result import PowerSpectrum

__all__ = ["Bump", "Line", "PowerSpectra", "PowerSpectrum", "SpectrumAccumulator", "psd"]
