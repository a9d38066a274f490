"""Spectra of the axes of a recording, in memory or in the first pass over a stream."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from gmwm.axis_names import axis_quantity
from gmwm.errors import DataError
from gmwm.readers.chunks import Chunk
from gmwm.signals import Signal
from gmwm.spectrum import PowerSpectrum, SpectrumAccumulator
from gmwm.spectrum.api import signal_psd
from gmwm.units import SI_UNIT


def measured_spectrum(signal: Signal) -> PowerSpectrum | None:
    """The spectrum of a signal, smoothed away from lines; None if the signal is too short for one."""
    return _smoothed(lambda: signal_psd(signal))


def _smoothed(measure: Callable[[], PowerSpectrum]) -> PowerSpectrum | None:
    try:
        return measure().smoothed()
    except DataError:
        return None


class SpectraOfStream:
    """Accumulators of the spectra of some axes, which take the chunks of a stream.

    Parameters
    ----------
    axes : sequence of str
        Axes of the chunks whose spectra are estimated.
    rate : float
        Sampling rate (Hz).
    """

    def __init__(self, axes: Sequence[str], rate: float) -> None:
        self._accumulators = {
            axis: SpectrumAccumulator(rate, unit=SI_UNIT[axis_quantity(axis)], axis=axis) for axis in axes
        }
        self._segment = 0

    def update(self, chunk: Chunk) -> None:
        """Add the next chunk."""
        for axis, one in self._accumulators.items():
            if chunk.segment != self._segment:
                one.gap()
            one.update(chunk[axis])
        self._segment = chunk.segment

    def results(self) -> dict[str, PowerSpectrum | None]:
        """The spectrum of each axis, smoothed away from lines; None if the recording is too short for one."""
        return {axis: _smoothed(one.result) for axis, one in self._accumulators.items()}
