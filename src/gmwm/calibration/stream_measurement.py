"""Measure and inspect a recording in chunks, in two passes over the file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

from gmwm._text import duration_text
from gmwm.calibration.spectrum_measurement import smoothed_or_none
from gmwm.errors import GmwmError
from gmwm.inspection import Inspection
from gmwm.inspection.api import FirstPass, RecordingStatistics
from gmwm.outliers import Screen, Screening
from gmwm.readers.streams import Chunk, Stream
from gmwm.spectrum import PowerSpectrum
from gmwm.streaming.cluster import spread_pairs, spread_variance
from gmwm.streaming.passes import measured_pairs, stream_variance
from gmwm.streaming.scheduling import connected
from gmwm.streaming.spectra import SpectraOfStream
from gmwm.variance.biweight import EFFICIENCY
from gmwm.variance.result import WaveletVariance

if TYPE_CHECKING:
    from distributed import Client


class StreamMeasurement(NamedTuple):
    """What two passes over a recording give.

    Attributes
    ----------
    curves : dict of axis to tuple of WaveletVariance
        The classical and the robust wavelet variance, or one of them.
    inspection : Inspection
    screens : dict of axis to Screen
        What the samples say about outliers and tails; empty if only one curve is measured.
    spectra : dict of axis to PowerSpectrum or None
        Smoothed away from lines; None for a recording that is too short. Empty if only one curve is measured.
    """

    curves: dict[str, tuple[WaveletVariance, ...]]
    inspection: Inspection
    screens: dict[str, Screen]
    spectra: dict[str, PowerSpectrum | None]


def measured_and_inspected(
    stream: Stream,
    axes: Sequence[str],
    *,
    pairs: bool = True,
    robust: bool = False,
    efficiency: float = EFFICIENCY,
    threads: int | None = None,
    scheduler: str | Client | None = None,
    workers: int | None = None,
    progress: Callable[[str], None] | None = None,
) -> StreamMeasurement:
    """Estimate the wavelet variances and the spectra of some axes and inspect all axes, in the same two passes.

    Parameters
    ----------
    stream : Stream
        The recording.
    axes : sequence of str
        Axes whose wavelet variance is estimated.
    pairs : bool
        Return the classical and the robust wavelet variance of each axis, in this order, and its spectrum; otherwise
        the wavelet variance that `robust` selects, without a spectrum.
    robust, efficiency, threads, scheduler, workers
        As in `stream_variance`. With workers, one of them inspects while the others measure.
    progress : callable, optional
        Called with a description after each chunk.

    Returns
    -------
    StreamMeasurement
    """
    if scheduler is not None or workers is not None:
        return _spread(
            stream,
            axes,
            pairs=pairs,
            robust=robust,
            efficiency=efficiency,
            scheduler=scheduler,
            workers=workers,
            progress=progress,
        )
    inspected = InspectedStream(stream, axes, progress=progress, whole=pairs)
    curves: dict[str, tuple[WaveletVariance, ...]]
    if pairs:
        curves = dict(measured_pairs(inspected, efficiency=efficiency, threads=threads))
    else:
        found = stream_variance(inspected, robust=robust, efficiency=efficiency, threads=threads)
        curves = {axis: (curve,) for axis, curve in found.items()}
    return StreamMeasurement(curves, inspected.inspection(), inspected.screens(), inspected.spectra())


def _spread(
    stream: Stream, axes: Sequence[str], pairs: bool, robust: bool, efficiency: float,
    scheduler: str | Client | None, workers: int | None, progress: Callable[[str], None] | None,
) -> StreamMeasurement:  # fmt: skip
    """Measure and inspect with the workers of a cluster, or with local processes."""

    def report(samples: int) -> None:
        if progress is not None:
            progress(f"both passes: {duration_text(samples / stream.rate)}")

    with connected(scheduler, workers) as client:
        future = client.submit(_inspected, stream, tuple(axes) if pairs else (), pure=False, retries=2)
        curves: dict[str, tuple[WaveletVariance, ...]]
        if pairs:
            curves = dict(spread_pairs(stream, scheduler=client, efficiency=efficiency, done=report))
        else:
            found = spread_variance(stream, scheduler=client, robust=robust, efficiency=efficiency, done=report)
            curves = {axis: (curve,) for axis, curve in found.items()}
        result = future.result()
    if isinstance(result, GmwmError):
        raise result
    inspection, screens, spectra = result
    return StreamMeasurement({axis: curves[axis] for axis in axes}, inspection, screens, spectra)


def _inspected(
    stream: Stream, axes: tuple[str, ...]
) -> tuple[Inspection, dict[str, Screen], dict[str, PowerSpectrum | None]] | GmwmError:
    """Inspect and measure axes in a worker. An error is returned, because Dask would repeat work that raises."""
    try:
        inspected = InspectedStream(stream, axes, whole=bool(axes))
        return inspected.inspection(), inspected.screens(), inspected.spectra()
    except GmwmError as error:
        return error


class InspectedStream:
    """A stream that is inspected in its first two passes, and screened in the first, while another function reads it.

    Attributes
    ----------
    source : str
        Name of the recording.
    axes : tuple of str
        Axes that the other function measures.
    rate : float
        Sampling rate (Hz).
    """

    def __init__(
        self,
        stream: Stream,
        axes: Sequence[str],
        *,
        progress: Callable[[str], None] | None = None,
        whole: bool = False,
    ) -> None:
        self.source, self.axes, self.rate = stream.source, tuple(axes), stream.rate
        self._spectra = SpectraOfStream(self.axes if whole else (), stream.rate)
        self._stream, self._first = stream, FirstPass(stream)
        self._statistics: RecordingStatistics | None = None
        self._passes, self._progress = 0, progress
        self._screening = {axis: Screening(stream.rate) for axis in self.axes} if whole else {}

    def __iter__(self) -> Iterator[Chunk]:
        self._passes += 1
        if self._passes == 1:
            yield from self._first_pass()
        elif self._passes == 2:
            yield from self._second_pass(self._first.second_pass())
        else:
            yield from self._stream

    def inspection(self) -> Inspection:
        """Return the inspection, after as many passes as are still missing."""
        while self._statistics is None:
            for _ in self:
                pass
        return self._statistics.result()

    def screens(self) -> dict[str, Screen]:
        """Return what the samples of each axis say about outliers and tails, after the first pass."""
        return {axis: one.result() for axis, one in self._screening.items()}

    def spectra(self) -> dict[str, PowerSpectrum | None]:
        """Return the spectra of the axes after the first pass, smoothed away from lines."""
        return {axis: smoothed_or_none(one.result) for axis, one in self._spectra.accumulators.items()}

    def _first_pass(self) -> Iterator[Chunk]:
        segment = 0
        for chunk in self._stream:
            self._report(f"first pass: {self._length(chunk)}")
            self._first.update(chunk)
            for axis, one in self._screening.items():
                if chunk.segment != segment:
                    one.gap()
                one.update(chunk[axis])
            segment = chunk.segment
            self._spectra.update(chunk)
            yield chunk

    def _second_pass(self, statistics: RecordingStatistics) -> Iterator[Chunk]:
        self._statistics = statistics
        for chunk in self._stream:
            self._report(f"second pass: {self._length(chunk)} of {duration_text(statistics.samples / self.rate)}")
            statistics.update(chunk)
            yield chunk

    def _length(self, chunk: Chunk) -> str:
        return duration_text((chunk.first + len(chunk)) / self.rate)

    def _report(self, text: str) -> None:
        if self._progress is not None:
            self._progress(text)
