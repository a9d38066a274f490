"""Compute what a calibration needs from the samples: wavelet variances, outliers, spectra, and the inspection."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from threading import Lock
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gmwm.base.arrays import Vector, freeze
from gmwm.base.errors import DataError, GmwmError
from gmwm.base.text import duration_text
from gmwm.base.threads import in_threads
from gmwm.calibration.additions import axis_additions, recording_additions
from gmwm.calibration.misfit import line_in
from gmwm.calibration.options import CalibrationOptions
from gmwm.files.readers.streams import Stream
from gmwm.measuring.inspection import Inspection
from gmwm.measuring.inspection.api import FirstPass
from gmwm.measuring.outliers import (
    MATERIAL,
    TOLERANCE,
    Replaced,
    Screen,
    Screening,
    Verdict,
    cleaned,
    contamination,
    dependence,
    other_efficiency,
)
from gmwm.measuring.regression.conditions import NOTHING, Conditions
from gmwm.measuring.spectrum import PowerSpectrum, SpectrumAccumulator
from gmwm.measuring.streaming.cluster import part_levels, spread
from gmwm.measuring.streaming.passes import AxisCurves, Measurement, curves_of, measure, shown, unit_of
from gmwm.measuring.streaming.scheduling import connected
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.batches import Batch, Batches, Streamed, cut, end_to_end, feed
from gmwm.recording.signals import Imu, Signal

if TYPE_CHECKING:
    from distributed import Client


def beginning() -> int:
    """Return the number of samples at the beginning of a recording that the additions need."""
    return max((addition.beginning for addition in axis_additions()), default=0)


def clean(signal: Signal) -> Signal:
    """Return a signal with its isolated wrong samples and knocks replaced."""
    return cleaned(signal).signal


class Pair(NamedTuple):
    """The classical and the robust wavelet variance of one axis.

    If the samples were read, it also has the result of the outlier screening (`screen`), the spectrum, and a function
    (`other`) that returns the robust wavelet variance with the efficiency `other_efficiency`.
    """

    classical: WaveletVariance
    robust: WaveletVariance
    screen: Screen | None = None
    spectrum: PowerSpectrum | None = None
    other: Callable[[], WaveletVariance] | None = None

    @property
    def unit(self) -> str:
        """Unit of the axis."""
        return self.classical.unit


class AxisSamples:
    """Statistics of the samples of one axis other than wavelet variances: outliers, distribution tails and spectrum."""

    def __init__(self, rate: float, unit: str, axis: str) -> None:
        self._screening = Screening(rate)
        self._spectrum = SpectrumAccumulator(rate, unit=unit, axis=axis)
        self._replaced = Replaced()

    def clean(self, signal: Signal) -> Signal:
        """Return a batch with its isolated wrong samples and knocks replaced, and count them."""
        found = cleaned(signal)
        self._replaced += found.replaced
        return found.signal

    def update(self, signal: Signal, continues: bool) -> None:
        """Add a batch of samples. `continues` says whether it follows the previous batch without a gap."""
        for one in (self._screening, self._spectrum):
            feed(one, signal, continues)

    def screen(self) -> Screen:
        """Return the bursts, the wrong samples and the tails of the distribution that were found."""
        return self._screening.result(replaced=self._replaced)

    def spectrum(self) -> PowerSpectrum | None:
        """Return the power spectrum, smoothed except at lines; None if there are too few samples."""
        return self.spectrum_with(())

    def spectrum_with(self, others: Sequence[AxisSamples]) -> PowerSpectrum | None:
        """Return the power spectrum of this and other recordings together; None if there are too few samples."""
        whole = self._spectrum
        for other in others:
            whole = whole.beside(other._spectrum)
        try:
            return whole.result().smoothed()
        except DataError:
            return None


class AxisMeasurement:
    """All measurements of one axis. The wavelet variances may need a second pass over the samples.

    Parameters
    ----------
    curves : AxisCurves
    samples : AxisSamples
        Accumulators of the wavelet variances and of the other statistics, either empty or with all samples.
    turn : context manager
        Context in which the wavelet variances are computed. The axes of a stream share a lock as context, so that only
        one axis at a time needs the memory for this.
    keep : bool
        Whether to keep all samples, with isolated wrong samples and knocks replaced, until `taken` is called.

    Attributes
    ----------
    beginning : Signal or None
        The first `beginning()` samples, with isolated wrong samples and knocks replaced; None before the first batch.
    """

    def __init__(
        self, curves: AxisCurves, samples: AxisSamples, turn: AbstractContextManager[object], keep: bool = False
    ) -> None:
        self.curves, self.samples, self.turn, self.keep = curves, samples, turn, keep
        self._kept: list[Vector] = []
        self.beginning: Signal | None = None

    @property
    def unit(self) -> str:
        """Unit of the axis."""
        return self.curves.first.unit

    def clean(self, signal: Signal) -> Signal:
        """Return a batch with its isolated wrong samples and knocks replaced, and count them."""
        found = self.samples.clean(signal)
        have = 0 if self.beginning is None else len(self.beginning)
        if have < beginning():
            first = cut(found, 0, beginning() - have)
            if self.beginning is not None:
                first = _continued(self.beginning, first)
            elif len(first) < len(found):
                # Copy the values, because a view would keep the whole array in memory.
                first = replace(first, values=first.values.copy())
            self.beginning = first
        if self.keep:
            self._kept.append(found.values)
        return found

    def taken(self) -> Vector:
        """Return the samples that were kept, and free their memory."""
        kept, self._kept = self._kept, []
        return kept[0] if len(kept) == 1 else freeze(np.concatenate(kept))

    def update(self, signal: Signal, continues: bool) -> None:
        """Add a batch of the first pass. `continues` says whether it follows the previous batch without a gap."""
        self.curves.update(signal, continues)
        self.samples.update(signal, continues)

    def release(self) -> None:
        """Free the memory of the accumulators when the results are known. The first samples are kept."""
        del self.curves, self.samples

    def pair(self, efficiency: float) -> Pair:
        """Return the wavelet variances, the outlier screening and the spectrum."""
        return pair_of(self.curves, self.samples.screen(), self.samples.spectrum(), efficiency)


def _continued(before: Signal, after: Signal) -> Signal:
    """Return two consecutive parts of a signal as one signal, joined without a gap if no sample is missing between."""
    begin, end = before.segments[-1]
    follows = before.starts[-1] + (end - begin) / before.rate
    return end_to_end([before, after], [False, abs(after.starts[0] - follows) < 0.5 / before.rate])


def pair_of(curves: AxisCurves, screen: Screen, spectrum: PowerSpectrum | None, efficiency: float) -> Pair:
    """Return the `Pair` of one axis from its accumulated curves, its outlier screening and its spectrum."""

    def other() -> WaveletVariance:
        return curves.first.result(robust=True, efficiency=other_efficiency(efficiency))

    return Pair(curves.classical(), curves.robust(), screen=screen, spectrum=spectrum, other=other)


Measured = Signal | WaveletVariance | Pair | AxisMeasurement


def measured_axis(
    item: Measured, options: CalibrationOptions, *, comparisons: int = 1
) -> tuple[WaveletVariance, Verdict | None, PowerSpectrum | None]:
    """Return the wavelet variance of an axis to fit, the result of the outlier test, and the spectrum.

    Isolated wrong samples and knocks are replaced before anything is computed. With robust="auto", the robust curve is
    returned if remaining bursts (motion, or too many knocks) raise the classical curve. A classical curve includes the
    additional covariance from heavy tails. A robust curve is compared with a robust curve of another efficiency.

    Parameters
    ----------
    item : Signal, AxisMeasurement, Pair or WaveletVariance
    options : CalibrationOptions
    comparisons : int
        Number of axes that are tested together.

    Returns
    -------
    wv : WaveletVariance
    verdict : Verdict or None
        Result of the outlier test; None if `item` is a WaveletVariance, which is fitted unchanged.
    spectrum : PowerSpectrum or None
        Power spectrum, smoothed except at lines; None if `item` is a WaveletVariance, or the recording is too short.

    Raises
    ------
    DataError
        If the options require the robust curve, but `item` is a classical WaveletVariance.
    """
    if isinstance(item, WaveletVariance):
        if options.robust is True and not item.robust:
            raise DataError(
                "the wavelet variance is classical, but a robust one is required",
                advice="Pass the signal instead, or {--robust=auto}.",
            )
        return item, None, None
    if isinstance(item, Signal):
        axis = item.axis or "signal"
        item = _measure(Batches(Imu({axis: item})), (axis,), options)[axis]
    if isinstance(item, AxisMeasurement):
        with item.turn:
            found = measured_axis(item.pair(options.efficiency), options, comparisons=comparisons)
            item.release()
        return found
    # The screening accounts for heavy tails, so a smaller excess of the classical curve is significant.
    tolerance = TOLERANCE if item.screen is None else MATERIAL
    verdict = contamination(
        (item.classical, item.robust), comparisons=comparisons, tolerance=tolerance, screen=item.screen
    )
    wanted = verdict.contaminated and line_in(options.general) is None if options.robust == "auto" else options.robust
    if wanted:
        if item.other is not None:
            verdict = replace(verdict, dependence=dependence(item.robust, item.other(), verdict))
        return item.robust, verdict, item.spectrum
    excess = None if item.screen is None else item.screen.tails.excess(item.classical)
    return replace(item.classical, excess=excess), verdict, item.spectrum


class RecordingMeasurement(NamedTuple):
    """The measurements of the axes of a recording, its inspection, and the findings of the additions to recordings."""

    axes: Mapping[str, AxisMeasurement | Pair]
    inspection: Inspection
    findings: tuple[object, ...] = ()


def measured_recording(
    recording: Imu | Stream,
    axes: Sequence[str],
    options: CalibrationOptions,
    *,
    threads: int | None = None,
    scheduler: str | Client | None = None,
    workers: int | None = None,
    progress: Callable[[str], None] | None = None,
    conditions: Conditions = NOTHING,
) -> RecordingMeasurement:
    """Measure some axes of a recording and inspect all of its axes, in the same passes over the samples.

    Parameters
    ----------
    recording : Imu or Stream
    axes : sequence of str
        Axes to measure for a calibration.
    options : CalibrationOptions
    threads : int, optional
        Number of axes that are measured at the same time.
    scheduler, workers : optional
        Processes that read a stream, as in `calibrate`. One of them runs the inspection while the others measure.
    progress : callable, optional
        Function that is called with a description after each chunk.
    conditions : Conditions
        Effects that are removed from the samples before they are measured. The inspection uses the samples without this
        removal, except in its test for trends.
    """
    if isinstance(recording, Stream) and (scheduler is not None or workers is not None):
        return _spread(
            recording, axes, options, scheduler=scheduler, workers=workers, progress=progress, conditions=conditions
        )
    batches = _reported(recording, progress)
    inspector = FirstPass(batches)
    measured = _measure(batches, axes, options, threads=threads, inspector=inspector, conditions=conditions)
    inspection = _inspected(batches, inspector, _curves(measured), threads, conditions=conditions)
    return RecordingMeasurement(measured, inspection, _findings(recording, measured, threads))


def curves_and_inspection(
    stream: Stream,
    axes: Sequence[str],
    *,
    robust: bool,
    efficiency: float,
    scheduler: str | Client | None = None,
    workers: int | None = None,
    progress: Callable[[str], None] | None = None,
    conditions: Conditions = NOTHING,
) -> tuple[dict[str, WaveletVariance], Inspection]:
    """Compute the wavelet variance of some axes of a stream and inspect all axes, in the same passes over the samples.

    Parameters
    ----------
    stream, axes, scheduler, workers, progress, conditions
        As in `measured_recording`.
    robust, efficiency
        As in `wavelet_variance`.
    """
    remote = scheduler is not None or workers is not None
    exact = part_levels(len(axes)) if remote else None
    curves = curves_of(stream, axes, exact=exact, robust=robust, efficiency=efficiency)
    if remote:
        with connected(scheduler, workers) as client:
            future = client.submit(_inspection, stream, (), conditions, pure=False, retries=2)
            spread(stream, curves, scheduler=client, done=_both(stream, progress), prepare=conditions.batch)
            inspection = _result(future)[0]
    else:
        batches = _reported(stream, progress)
        inspector = FirstPass(batches)
        _first_pass(batches, curves, inspector, conditions=conditions)
        inspection = _inspected(batches, inspector, curves, conditions=conditions)

    def curve(axis: str, one: AxisCurves) -> WaveletVariance:
        found, wv = conditions.applied(axis), one.robust() if robust else one.classical()
        return wv if found is None else found.corrected(wv)

    return in_threads(curve, curves), inspection


def _measure(
    batches: Batches,
    axes: Sequence[str],
    options: CalibrationOptions,
    threads: int | None = None,
    inspector: FirstPass | None = None,
    conditions: Conditions = NOTHING,
) -> dict[str, AxisMeasurement]:
    """Run the first pass over a recording, and without an `inspector` also the second pass.

    If there is an inspector, the caller runs the second pass together with the inspection.
    """
    recording = batches.recording
    curves = curves_of(recording, axes, efficiency=options.efficiency, change=clean)
    turn = nullcontext() if isinstance(recording, Imu) else Lock()
    keep = isinstance(recording, Imu) and any(addition.needs(axes) for addition in recording_additions())
    made = {
        axis: AxisMeasurement(one, AxisSamples(recording.rate, one.first.unit, axis), turn, keep)
        for axis, one in curves.items()
    }
    _first_pass(batches, made, inspector, threads, conditions=conditions)
    if inspector is None:
        _second_pass(batches, curves, threads, conditions=conditions)
    return made


def _findings(
    recording: Imu | Streamed, measured: Mapping[str, AxisMeasurement], threads: int | None
) -> tuple[object, ...]:
    """Return the findings of the additions about a recording in memory, in the order of `recording_additions`."""
    needed = [isinstance(recording, Imu) and addition.needs(list(measured)) for addition in recording_additions()]
    if not isinstance(recording, Imu) or not any(needed):
        return ()
    samples = {axis: replace(recording[axis], values=item.taken()) for axis, item in measured.items()}
    return tuple(
        addition.of_recording(samples, threads=threads) if need else None
        for addition, need in zip(recording_additions(), needed, strict=True)
    )


def _curves(measured: Mapping[str, AxisMeasurement]) -> dict[str, AxisCurves]:
    return {axis: one.curves for axis, one in measured.items()}


def _first_pass(
    batches: Batches,
    measured: Mapping[str, Measurement],
    inspector: FirstPass | None,
    threads: int | None = None,
    *,
    conditions: Conditions = NOTHING,
) -> None:
    also = None if inspector is None else inspector.update
    measure(map(conditions.batch, shown(batches, also)), measured, threads)


def _second_pass(
    batches: Batches,
    curves: Mapping[str, AxisCurves],
    threads: int | None = None,
    also: Callable[[Batch], None] | None = None,
    *,
    conditions: Conditions = NOTHING,
) -> None:
    """Run the second pass for the wavelet variances that need one, and call `also`, if given, with each batch."""
    again = {axis: one for axis, one in curves.items() if one.begin_again()}
    if again or also:
        measure(map(conditions.batch, shown(batches, also)), again, threads)


def _inspected(
    batches: Batches, inspector: FirstPass, curves: Mapping[str, AxisCurves], threads: int | None = None, *,
    conditions: Conditions = NOTHING,
) -> Inspection:  # fmt: skip
    statistics = inspector.second_pass()
    _second_pass(batches, curves, threads, statistics.update, conditions=conditions)
    return statistics.result(conditions)


def _reported(recording: Imu | Streamed, progress: Callable[[str], None] | None) -> Batches:
    """Return the batches of a recording. For a stream, the progress is reported after each chunk."""
    if progress is None or isinstance(recording, Imu):
        return Batches(recording)

    def done(samples: int) -> None:
        length = duration_text(samples / recording.rate)
        if not batches.samples:
            progress(f"first pass: {length}")
        else:
            progress(f"second pass: {length} of {duration_text(batches.samples / recording.rate)}")

    batches = Batches(recording, done)
    return batches


def _both(stream: Stream, progress: Callable[[str], None] | None) -> Callable[[int], None] | None:
    """Return a function that reports how many samples the workers have read in both passes; None without progress."""
    return None if progress is None else lambda n: progress(f"both passes: {duration_text(n / stream.rate)}")


def _spread(
    stream: Stream, axes: Sequence[str], options: CalibrationOptions, *, scheduler: str | Client | None,
    workers: int | None, progress: Callable[[str], None] | None, conditions: Conditions,
) -> RecordingMeasurement:  # fmt: skip
    """Measure and inspect a stream like `measured_recording`, with the workers of a cluster or with local processes."""
    curves = curves_of(stream, axes, exact=part_levels(len(axes)), efficiency=options.efficiency, change=clean)
    with connected(scheduler, workers) as client:
        future = client.submit(_inspection, stream, tuple(axes), conditions, pure=False, retries=2)
        spread(stream, curves, scheduler=client, done=_both(stream, progress), prepare=conditions.batch)
        inspection, screens, spectra = _result(future)
    pairs = {axis: pair_of(one, screens[axis], spectra[axis], options.efficiency) for axis, one in curves.items()}
    return RecordingMeasurement(pairs, inspection)


Inspected = tuple[Inspection, dict[str, Screen], dict[str, PowerSpectrum | None]]


def _inspection(stream: Stream, axes: tuple[str, ...], conditions: Conditions) -> Inspected | GmwmError:
    """Inspect a stream in a worker process, and return the outlier screening and spectrum of the given axes too.

    A GmwmError is returned instead of raised, because Dask would repeat a task that raises.
    """
    try:
        batches = Batches(stream)
        inspector = FirstPass(batches)
        made = {axis: AxisSamples(stream.rate, unit_of(stream, axis), axis) for axis in axes}
        _first_pass(batches, made, inspector, conditions=conditions)
        inspection = _inspected(batches, inspector, {}, conditions=conditions)
        return inspection, {a: one.screen() for a, one in made.items()}, {a: one.spectrum() for a, one in made.items()}
    except GmwmError as error:
        return error


def _result(future: object) -> Inspected:
    """Wait for the result of `_inspection` and return it, or raise the error that it returned."""
    found: Inspected | GmwmError = future.result()  # type: ignore[attr-defined]
    if isinstance(found, GmwmError):
        raise found
    return found
