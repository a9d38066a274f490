"""Spectra of a recording of any length, in one pass."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from gmwm._threads import in_threads
from gmwm.axis_names import axis_quantity
from gmwm.options import as_confidence
from gmwm.readers.chunks import Chunk
from gmwm.spectrum import PowerSpectra, SpectrumAccumulator
from gmwm.spectrum.welch import Detrend
from gmwm.streaming.passes import Source
from gmwm.units import SI_UNIT


class SpectraOfStream:
    """Accumulators of the spectra of some axes, which take the chunks of a stream.

    Parameters
    ----------
    axes : sequence of str
        Axes of the chunks whose spectra are estimated.
    rate : float
        Sampling rate (Hz).
    length, detrend
        As for `SpectrumAccumulator`.

    Attributes
    ----------
    accumulators : dict of axis to SpectrumAccumulator
    """

    def __init__(
        self, axes: Sequence[str], rate: float, *, length: int | None = None, detrend: Detrend = "constant"
    ) -> None:
        self.accumulators = {
            axis: SpectrumAccumulator(
                rate, length=length, detrend=detrend, unit=SI_UNIT[axis_quantity(axis)], axis=axis
            )
            for axis in axes
        }
        self._segment = 0

    def update(self, chunk: Chunk) -> None:
        """Add the next chunk."""
        for axis, one in self.accumulators.items():
            if chunk.segment != self._segment:
                one.gap()
            one.update(chunk[axis])
        self._segment = chunk.segment


def stream_psd(
    stream: Source,
    *,
    length: int | None = None,
    detrend: Detrend = "constant",
    confidence: float = 0.95,
    done: Callable[[int], None] | None = None,
) -> PowerSpectra:
    """Power spectral density of each axis of a recording of any length: see `Stream.psd`."""
    as_confidence(confidence)
    measured = SpectraOfStream(stream.axes, stream.rate, length=length, detrend=detrend)
    for chunk in stream:
        measured.update(chunk)
        if done is not None:
            done(chunk.first + len(chunk))
    return PowerSpectra(spectra=in_threads(lambda _, one: one.result(confidence), measured.accumulators))
