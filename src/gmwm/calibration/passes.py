"""Read a recording once or twice: accumulate the statistics of each axis, and inspect the recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from threading import Lock
from typing import TYPE_CHECKING, NamedTuple

from gmwm.base.errors import GmwmError
from gmwm.base.text import duration_text
from gmwm.base.threads import in_threads, return_memory
from gmwm.calibration.additions import axis_additions, recording_additions
from gmwm.measuring.inspection import Inspection
from gmwm.measuring.inspection.api import FirstPass
from gmwm.measuring.outliers import Replaced, Screen, Screening, cleaned
from gmwm.measuring.regression.conditions import NOTHING, Conditions
from gmwm.measuring.spectrum import PowerSpectrum, SpectrumAccumulator
from gmwm.measuring.streaming.passes import AxisCurves, Measurement, curves_of, measure, show_batches, unit_of
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.batches import Batches, Streamed, end_to_end, feed, join_batches, part_of
from gmwm.recording.gaps import fill_gaps
from gmwm.recording.repairs import axes_with_two_levels
from gmwm.recording.signals import Imu, Signal

if TYPE_CHECKING:
    from distributed import Client

    from gmwm.files.readers.streams import Stream


@dataclass(frozen=True, kw_only=True)
class Execution:
    """How a recording is read, without effect on numbers: threads, processes, and a function for progress."""

    threads: int | None = None
    scheduler: str | Client | None = None
    workers: int | None = None
    progress: Callable[[str], None] = field(default=lambda _: None)

    @property
    def remote(self) -> bool:
        """Whether other processes read a stream."""
        return self.scheduler is not None or self.workers is not None

    def with_name(self, recording: str) -> Execution:
        """Return the run with the name of a recording in front of each description; "" for a single recording."""
        if not recording:
            return self
        return replace(self, progress=lambda text: self.progress(f"{recording}: {text}"))


IN_THIS_PROCESS = Execution()


class Passes(NamedTuple):
    """What the passes over a recording give: accumulators by axis, inspection, findings of the additions."""

    axes: Mapping[str, AxisAccumulator]
    inspection: Inspection
    findings: tuple[object, ...] = ()


def clean(signal: Signal) -> Signal:
    """Return a signal with its isolated wrong samples and knocks replaced."""
    return cleaned(signal).signal


def needed_beginning() -> int:
    """Return the number of samples at the beginning of a recording that the additions need."""
    return max((addition.beginning for addition in axis_additions()), default=0)


class AxisAccumulator:
    """Wavelet variances (or None, elsewhere), outliers, tails and spectrum of one axis. `turn` is a lock for them that
    a stream's axes share to save memory; the first `beginning` samples are kept without knocks, with `keep` all until
    `forget`."""

    def __init__(
        self, rate: float, unit: str, axis: str, curves: AxisCurves | None = None, *,
        turn: AbstractContextManager[object] | None = None, beginning: int = 0, keep: bool = False,
        two_levels: bool = False,
    ) -> None:  # fmt: skip
        self.curves, self.turn, self.two_levels = curves, turn or nullcontext(), two_levels
        self.beginning: Signal | None = None
        self._screening = Screening(rate)
        self._spectrum = SpectrumAccumulator(rate, unit=unit, axis=axis)
        self.replaced = Replaced()
        self._reach, self._keep = beginning, keep
        self._samples: list[tuple[Signal, bool]] = []

    def clean(self, signal: Signal) -> Signal:
        """Return a batch with wrong samples and knocks replaced and counted, without pulses of two-level noise."""
        if not self.two_levels:
            result = cleaned(signal)
            self.replaced += result.replaced
            signal = result.signal
        return signal

    def _keep_beginning(self, signal: Signal) -> None:
        have = 0 if self.beginning is None else len(self.beginning)
        if have >= self._reach:
            return
        first = part_of(signal, 0, self._reach - have)
        if self.beginning is not None:
            before = self.beginning
            begin, end = before.segments[-1]
            follows = before.starts[-1] + (end - begin) / before.rate
            first = end_to_end([before, first], [False, abs(first.starts[0] - follows) < 0.5 / before.rate])
        elif len(first) < len(signal) and not self._keep:
            # Copy the values, because a view would keep the whole array in memory.
            first = replace(first, values=first.values.copy())
        self.beginning = first

    @property
    def ranges(self) -> tuple[object, ...]:
        """Parts of the samples that were kept, and whether each continues the one before."""
        return tuple((signal.segments, continues) for signal, continues in self._samples)

    def samples(self) -> Signal:
        """Return the samples that were kept, with short gaps filled."""
        signals, continues = zip(*self._samples, strict=True)
        return signals[0] if len(signals) == 1 else end_to_end(signals, continues)

    def forget(self) -> None:
        """Free the memory of the samples that were kept."""
        self._samples.clear()

    def update(self, signal: Signal, continues: bool) -> None:
        """Add a batch of the first pass. `continues` says whether it follows the previous batch without a gap."""
        self._keep_beginning(signal)
        if self._keep:
            self._samples.append((signal, continues))
        if self.curves is not None:
            self.curves.update(signal, continues)
        for accumulator in (self._screening, self._spectrum):
            feed(accumulator, signal, continues)

    def screen(self) -> Screen:
        """Return the bursts, the wrong samples and the tails of the distribution."""
        return self._screening.result(replaced=self.replaced)

    def spectrum(self, others: Sequence[AxisAccumulator] = ()) -> PowerSpectrum | None:
        """Return the spectrum of these recordings, smoothed except at lines; None if there are too few samples."""
        together = self._spectrum
        try:
            for other in others:
                together = together.beside(other._spectrum)
            return together.result().smoothed()
        except GmwmError:
            return None


def read_recording(
    recording: Imu | Streamed, axes: Sequence[str], efficiency: float, conditions: Conditions = NOTHING,
    run: Execution = IN_THIS_PROCESS,
) -> Passes:  # fmt: skip
    """Accumulate axes and inspect all in the same passes; effects in `conditions` are removed first, but for the
    inspection only in its test for trends."""
    if run.remote:
        from gmwm.files.readers.streams import Stream

        assert isinstance(recording, Stream)
        return _read_remotely(recording, axes, efficiency, conditions=conditions, run=run)
    batches = _batches_of(recording, run.progress)
    inspector = FirstPass(batches)
    accumulators = _first_pass(
        batches, axes, efficiency, conditions=conditions, inspector=inspector, threads=run.threads
    )
    curves = {axis: item.curves for axis, item in accumulators.items() if item.curves is not None}
    inspection = _inspect(batches, inspector, curves, run.threads, conditions=conditions)
    return Passes(accumulators, inspection, _findings(batches, accumulators, run.threads, conditions=conditions))


def curves_and_inspection(
    stream: Stream, axes: Sequence[str], *, robust: bool, efficiency: float, conditions: Conditions = NOTHING,
    run: Execution = IN_THIS_PROCESS,
) -> tuple[dict[str, WaveletVariance], Inspection]:  # fmt: skip
    """Compute the wavelet variance of some axes of a stream and inspect all axes, in the same passes."""
    if run.remote:
        curves, (inspection, _) = _measure_remotely(
            stream, axes, robust=robust, efficiency=efficiency, conditions=conditions, run=run
        )
    else:
        curves = curves_of(stream, axes, robust=robust, efficiency=efficiency)
        batches = _batches_of(stream, run.progress)
        inspector = FirstPass(batches)
        measure(map(conditions.batch, show_batches(batches, inspector.update)), curves)
        inspection = _inspect(batches, inspector, curves, conditions=conditions)

    def curve(axis: str, item: AxisCurves) -> WaveletVariance:
        regression, wv = conditions.applied_regression(axis), item.robust() if robust else item.classical()
        return wv if regression is None else regression.corrected(wv)

    return in_threads(curve, curves), inspection


def _first_pass(
    batches: Batches, axes: Sequence[str], efficiency: float, conditions: Conditions = NOTHING, *,
    inspector: FirstPass | None = None, threads: int | None = None,
) -> dict[str, AxisAccumulator]:  # fmt: skip
    """Run the first pass over a recording."""
    recording = batches.recording
    in_memory = isinstance(recording, Imu)
    keep = in_memory and any(addition.needs(axes) for addition in recording_additions())
    turn = nullcontext() if in_memory else Lock()
    rate, reach = recording.rate, needed_beginning()
    two_levels = axes_with_two_levels(recording.remarks)
    accumulators = {}
    for axis, curves in curves_of(recording, axes, efficiency=efficiency, change=clean).items():
        if axis in two_levels:
            curves.change = None
        accumulators[axis] = AxisAccumulator(
            rate, curves.first.unit, axis, curves, turn=turn, beginning=reach, keep=keep, two_levels=axis in two_levels
        )
    also = None if inspector is None else inspector.update
    measure(map(conditions.batch, show_batches(batches, also)), accumulators, threads)
    return accumulators


def _inspect(
    batches: Batches, inspector: FirstPass, curves: Mapping[str, AxisCurves], threads: int | None = None, *,
    conditions: Conditions = NOTHING,
) -> Inspection:  # fmt: skip
    statistics = inspector.second_pass()
    again: dict[str, Measurement] = {axis: item for axis, item in curves.items() if item.begin_again()}
    measure(map(conditions.batch, show_batches(batches, statistics.update)), again, threads)
    return statistics.result(conditions)


def _findings(
    batches: Batches, accumulators: Mapping[str, AxisAccumulator], threads: int | None, *, conditions: Conditions
) -> tuple[object, ...]:
    """Return the findings of the additions about a recording in memory, in the order of `recording_additions`."""
    in_memory = isinstance(batches.recording, Imu)
    needed = [in_memory and addition.needs(list(accumulators)) for addition in recording_additions()]
    if not any(needed):
        return ()
    again: dict[str, Signal] = {}
    if len({item.ranges for item in accumulators.values()}) > 1:
        # A sensor restarted at a gap that was filled on the axes of other sensors. Now, all axes are split there.
        with_gaps = join_batches([conditions.batch(batch) for batch in batches]).signals
        again = fill_gaps(in_threads(
            lambda axis, item: with_gaps[axis] if item.two_levels else clean(with_gaps[axis]), accumulators,
            threads=threads,
        ))  # fmt: skip
    return_memory()
    # The axes are joined one at a time, because together they need as much memory as the recording.
    findings = tuple(
        addition.of_recording(
            again.items() or ((axis, item.samples()) for axis, item in accumulators.items()), threads=threads
        ) if need else None
        for addition, need in zip(recording_additions(), needed, strict=True)
    )  # fmt: skip
    for item in accumulators.values():
        item.forget()
    return findings


def _batches_of(recording: Imu | Streamed, progress: Callable[[str], None]) -> Batches:
    """Return the batches of a recording. For a stream, the progress is reported after each chunk."""
    if isinstance(recording, Imu):
        return Batches(recording)

    def done(samples: int) -> None:
        length = duration_text(samples / recording.rate)
        if not batches.samples:
            progress(f"first pass: {length}")
        else:
            progress(f"second pass: {length} of {duration_text(batches.samples / recording.rate)}")

    batches = Batches(recording, done)
    return batches


def _read_remotely(
    stream: Stream, axes: Sequence[str], efficiency: float, *, conditions: Conditions, run: Execution
) -> Passes:
    """Read a stream like `read_recording`, with the workers of a cluster or with local processes."""
    curves, (inspection, accumulators) = _measure_remotely(
        stream, axes, inspected=tuple(axes), efficiency=efficiency, conditions=conditions, run=run, change=clean
    )  # fmt: skip
    for axis, item in accumulators.items():
        item.curves = curves[axis]
    return Passes(accumulators, inspection)


Remote = tuple[Inspection, dict[str, "AxisAccumulator"]]


def _measure_remotely(
    stream: Stream, axes: Sequence[str], *, efficiency: float, conditions: Conditions, run: Execution,
    robust: bool = True, inspected: tuple[str, ...] = (), change: Callable[[Signal], Signal] | None = None,
) -> tuple[dict[str, AxisCurves], Remote]:  # fmt: skip
    """Measure a stream's curves with workers, one of which inspects it and accumulates the axes `inspected`."""
    from gmwm.measuring.streaming.cluster import measure_in_parts, part_levels
    from gmwm.measuring.streaming.scheduling import connect

    curves = curves_of(
        stream, axes, exact=part_levels(len(axes)), robust=robust, efficiency=efficiency, change=change
    )  # fmt: skip
    with connect(run.scheduler, run.workers) as client:
        future = client.submit(_inspect_remotely, stream, inspected, conditions, pure=False, retries=2)
        measure_in_parts(
            stream, curves, scheduler=client, prepare=conditions.batch,
            done=lambda samples: run.progress(f"both passes: {duration_text(samples / stream.rate)}"),
        )  # fmt: skip
        result: Remote | GmwmError = future.result()
    if isinstance(result, GmwmError):
        raise result
    return curves, result


def _inspect_remotely(stream: Streamed, axes: tuple[str, ...], conditions: Conditions) -> Remote | GmwmError:
    """Inspect a stream in a worker process. A GmwmError is returned, because Dask would repeat a task that raises."""
    try:
        batches = Batches(stream)
        inspector = FirstPass(batches)
        reach = needed_beginning()
        accumulators = {
            axis: AxisAccumulator(stream.rate, unit_of(stream, axis), axis, beginning=reach) for axis in axes
        }
        measure(map(conditions.batch, show_batches(batches, inspector.update)), accumulators)
        return _inspect(batches, inspector, {}, conditions=conditions), accumulators
    except GmwmError as error:
        return error
