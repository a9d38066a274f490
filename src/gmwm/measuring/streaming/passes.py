"""Compute wavelet variances and spectra of recordings of any length, in one or two passes over their batches."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, Protocol

from gmwm.base.errors import DataError, OptionError
from gmwm.base.threads import in_threads
from gmwm.base.units import si_unit
from gmwm.measuring.spectrum import PowerSpectra, SpectrumAccumulator
from gmwm.measuring.spectrum.welch import Detrend
from gmwm.measuring.variance.accumulate import WaveletAccumulator
from gmwm.measuring.variance.biweight import EFFICIENCY, biweight, require_robust
from gmwm.measuring.variance.open_segments import exact_levels, held_samples
from gmwm.measuring.variance.result import WaveletVariance, WaveletVariances
from gmwm.measuring.variance.second_pass import SecondPass
from gmwm.recording.batches import Batch, Batches, Streamed, feed
from gmwm.recording.chunks import Chunk
from gmwm.recording.gaps import filled
from gmwm.recording.options import as_confidence
from gmwm.recording.signals import Imu, Signal

if TYPE_CHECKING:
    from distributed import Client

    from gmwm.files.readers.streams import Stream

Change = Callable[[Signal], Signal]  # function that changes the samples of an axis before their gaps are filled


class Measurement(Protocol):
    """Protocol of an object that measures one axis batch by batch; see `measure`."""

    def clean(self, signal: Signal, /) -> Signal:
        """Replace wrong samples of a batch, and return the batch. Its gaps are filled later."""

    def update(self, signal: Signal, continues: bool, /) -> None:
        """Add samples. Some of them may replace lost samples, and they may continue the last segment."""


class Feeding(NamedTuple):
    """Measurement by a function that takes the samples, such as `feed`; `change` is applied to every batch."""

    feed: Callable[[Signal, bool], None]
    change: Change | None = None

    def clean(self, signal: Signal) -> Signal:
        """Apply the change to the samples of a batch."""
        return signal if self.change is None else self.change(signal)

    def update(self, signal: Signal, continues: bool) -> None:
        """Add samples."""
        self.feed(signal, continues)


def measure(batches: Iterable[Batch], measured: Mapping[str, Measurement], threads: int | None = None) -> None:
    """Add all batches to the measurements, one thread per axis, with short gaps filled."""
    if not measured:
        for _ in batches:
            pass
        return

    def clean(batch: Batch) -> Batch:
        # The last axes, accelerometers, take longest, as they feel most knocks.
        last_first = dict(reversed(list(measured.items())))
        signals = in_threads(lambda axis, one: one.clean(batch.signals[axis]), last_first, threads=threads)
        return replace(batch, signals={axis: signals[axis] for axis in measured})

    def add(batch: Batch) -> None:
        in_threads(
            lambda axis, one: one.update(batch.signals[axis], batch.continues_on(axis)), measured, threads=threads
        )

    for batch in filled(map(clean, batches), threads):
        add(batch)
        del batch  # before the next one is gathered


def show_batches(batches: Iterable[Batch], to: Callable[[Batch], None] | None) -> Iterator[Batch]:
    """Yield each batch after passing it to a function."""
    for batch in batches:
        if to is not None:
            to(batch)
        yield batch
        del batch


class AxisCurves:
    """Classical and robust wavelet variance of one axis in one or two passes; `change` is applied to every batch."""

    def __init__(
        self, first: WaveletAccumulator, source: str, *, efficiency: float = EFFICIENCY, passes: int = 2,
        change: Change | None = None,
    ) -> None:  # fmt: skip
        self.first, self.second, self.change = first, None, change
        self._source, self._efficiency, self._passes = source, efficiency, passes

    first: WaveletAccumulator
    second: SecondPass | None
    change: Change | None

    def clean(self, signal: Signal) -> Signal:
        """Apply the change to the samples of a batch."""
        return signal if self.change is None else self.change(signal)

    def update(self, signal: Signal, continues: bool) -> None:
        """Add samples in the current pass."""
        (self.first if self.second is None else self.second).feed(signal, continues)

    def begin_again(self) -> bool:
        """Return, after the first pass, whether a second one is needed. `update` then belongs to the second pass."""
        if self.first.robust and self._passes == 2 and not self.first.holds_all:
            self.second = self.first.second_pass(self._efficiency)
        return self.second is not None

    def classical(self, confidence: float = 0.95) -> WaveletVariance:
        """Return the classical wavelet variance."""
        return self.first.result(confidence)

    def robust(self, confidence: float = 0.95) -> WaveletVariance:
        """Return the robust wavelet variance."""
        if self.second is None:
            return self.first.result(confidence, robust=True, efficiency=self._efficiency)
        try:
            return self.second.result(confidence)
        except DataError as error:
            raise DataError(
                f"{self._source} has changed between its two readings: {error.reason}",
                advice="Read a copy that no program writes to, or read it only once with {--passes=1}.",
            ) from error


def stream_variance(
    stream: Stream, *, levels: int | None = None, exact: int | None = None, robust: bool = False,
    efficiency: float = EFFICIENCY, passes: int = 2, confidence: float = 0.95, threads: int | None = None,
    scheduler: str | Client | None = None, workers: int | None = None, parts: int | None = None,
    done: Callable[[int], None] | None = None,
) -> WaveletVariances:  # fmt: skip
    """Compute the wavelet variance of each axis of a recording of any length; see `Stream.wavelet_variance`."""
    as_confidence(confidence)
    require_robust(robust, efficiency)
    measured = measured_curves(
        stream, stream.axes, levels=levels, exact=exact, robust=robust, efficiency=efficiency, passes=passes,
        threads=threads, scheduler=scheduler, workers=workers, parts=parts, done=done,
    )  # fmt: skip
    return WaveletVariances(
        curves=in_threads(
            lambda _, one: one.robust(confidence) if robust else one.classical(confidence), measured, threads=threads
        )
    )


def measured_curves(
    stream: Stream, axes: Sequence[str], *, levels: int | None = None, exact: int | None = None, robust: bool = True,
    efficiency: float = EFFICIENCY, passes: int = 2, threads: int | None = None, scheduler: str | Client | None = None,
    workers: int | None = None, parts: int | None = None, done: Callable[[int], None] | None = None,
) -> dict[str, AxisCurves]:  # fmt: skip
    """Measure curves of some axes in one or two passes; see `Stream.wavelet_variance` for parameters and errors."""
    biweight(efficiency)
    if passes not in (1, 2):
        raise OptionError(argument="passes", expected="2 or 1", got=passes)
    remote = scheduler is not None or workers is not None
    if remote:
        from gmwm.measuring.streaming.cluster import measure_in_parts, part_levels

        exact = part_levels(len(axes)) if exact is None else exact
    curves = curves_of(stream, axes, levels=levels, exact=exact, robust=robust, efficiency=efficiency, passes=passes)
    if remote:
        measure_in_parts(stream, curves, scheduler=scheduler, workers=workers, parts=parts, done=done)
        return curves
    before = 0
    batches = Batches(stream, None if done is None else lambda samples: done(before + samples))
    measure(batches, curves, threads)
    before = batches.samples
    if again := {axis: axis_curves for axis, axis_curves in curves.items() if axis_curves.begin_again()}:
        measure(batches, again, threads)
    return curves


def curves_of(
    recording: Imu | Streamed, axes: Sequence[str], *, levels: int | None = None, exact: int | None = None,
    robust: bool = True, efficiency: float = EFFICIENCY, passes: int = 2, change: Change | None = None,
) -> dict[str, AxisCurves]:  # fmt: skip
    """Make empty accumulators for some axes; by default with as many exact levels as memory allows."""
    accumulators_of = accumulators(recording, axes, levels=levels, exact=exact, robust=robust)
    return {
        axis: AxisCurves(accumulator, recording.source, efficiency=efficiency, passes=passes, change=change)
        for axis, accumulator in accumulators_of.items()
    }


def accumulators(
    recording: Imu | Streamed, axes: Sequence[str], *, levels: int | None = None, exact: int | None = None,
    robust: bool = False,
) -> dict[str, WaveletAccumulator]:  # fmt: skip
    """Make an empty accumulator for each axis."""
    rate = recording.rate
    count, held = (exact_levels(len(axes)), held_samples(len(axes))) if exact is None else (exact, None)
    return {
        axis: WaveletAccumulator(
            rate, levels=levels, held=held, exact=count, unit=unit_of(recording, axis), axis=axis, robust=robust
        )
        for axis in axes
    }


def unit_of(recording: Imu | Streamed, axis: str) -> str:
    """Return the unit of an axis; chunks are in SI units."""
    return recording.signals[axis].unit if isinstance(recording, Imu) else si_unit(axis)


def feed_chunks(chunks: Iterable[Chunk], measured: Mapping[str, WaveletAccumulator]) -> None:
    """Add chunks to accumulators as they arrive, with gaps filled in small blocks to keep the delay short."""

    # Samples whose gaps are filled together while watching: 80 s at 100 Hz, a choice.
    block = 1 << 13

    def batches() -> Iterator[Batch]:
        segment = -1
        for chunk in chunks:
            signals = {
                axis: Signal(chunk.values[axis], accumulator.rate, accumulator.unit, axis, starts=(chunk.start,))
                for axis, accumulator in measured.items()
            }
            yield Batch(signals, chunk.first, chunk.segment == segment)
            segment = chunk.segment

    for batch in filled(batches(), 1, block=block, context=block // 2):
        for axis, accumulator in measured.items():
            accumulator.feed(batch.signals[axis], batch.continues_on(axis))


def stream_psd(
    stream: Streamed, *, length: int | None = None, detrend: Detrend = "constant", confidence: float = 0.95,
    done: Callable[[int], None] | None = None,
) -> PowerSpectra:  # fmt: skip
    """Estimate the power spectral density of each axis of a recording of any length; see `Stream.psd`."""
    as_confidence(confidence)
    measured = {
        axis: SpectrumAccumulator(stream.rate, length=length, detrend=detrend, unit=si_unit(axis), axis=axis)
        for axis in stream.axes
    }
    measure(Batches(stream, done), {axis: Feeding(partial(feed, one)) for axis, one in measured.items()})
    return PowerSpectra(spectra=in_threads(lambda _, accumulator: accumulator.result(confidence), measured))
