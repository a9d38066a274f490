"""Power spectral density of a signal, with the lines and bumps in it."""

from gmwm.spectrum.accumulate import SpectrumAccumulator
from gmwm.spectrum.api import psd
from gmwm.spectrum.axes_result import PowerSpectra
from gmwm.spectrum.line import Bump, Line
from gmwm.spectrum.result import PowerSpectrum

__all__ = ["Bump", "Line", "PowerSpectra", "PowerSpectrum", "SpectrumAccumulator", "psd"]
