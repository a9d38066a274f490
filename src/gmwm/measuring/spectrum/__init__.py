"""Power spectral density of a signal, with the lines and bumps in it."""

from gmwm.measuring.spectrum.api import SpectrumAccumulator, psd
from gmwm.measuring.spectrum.line import Bump, Line
from gmwm.measuring.spectrum.result import PowerSpectra, PowerSpectrum

__all__ = ["Bump", "Line", "PowerSpectra", "PowerSpectrum", "SpectrumAccumulator", "psd"]
