"""Wavelet variances of a stream in one or two passes: threads process the axes while the next chunk is read."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

from gmwm._arrays import Vector
from gmwm._threads import INTERRUPT_CHECK, in_threads, processors
from gmwm.axis_names import axis_quantity
from gmwm.errors import DataError, OptionError
from gmwm.options import as_confidence
from gmwm.readers.chunks import Chunk
from gmwm.readers.streams import Stream
from gmwm.units import SI_UNIT
from gmwm.variance.accumulate import WaveletAccumulator
from gmwm.variance.axes_result import WaveletVariances
from gmwm.variance.biweight import EFFICIENCY, biweight, require_robust
from gmwm.variance.open_segments import SegmentedAccumulator, exact_levels
from gmwm.variance.result import WaveletVariance

if TYPE_CHECKING:
    from distributed import Client


class Source(Protocol):
    """A Stream, or another object with the same attributes that yields chunks."""

    @property
    def source(self) -> str:
        """Name of the file or other source, for messages."""
        ...

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes to measure; chunks can have further axes."""
        ...

    @property
    def rate(self) -> float:
        """Samples per second (Hz)."""
        ...

    def __iter__(self) -> Iterator[Chunk]: ...


def stream_variance(
    stream: Source,
    *,
    levels: int | None = None,
    exact: int | None = None,
    robust: bool = False,
    efficiency: float = EFFICIENCY,
    passes: int = 2,
    confidence: float = 0.95,
    threads: int | None = None,
    scheduler: str | Client | None = None,
    workers: int | None = None,
    parts: int | None = None,
    done: Callable[[int], None] | None = None,
) -> WaveletVariances:
    """Wavelet variance of each axis of a recording of any length: see `Stream.wavelet_variance`."""
    as_confidence(confidence)
    require_robust(robust, efficiency)
    if scheduler is not None or workers is not None:
        from gmwm.streaming.cluster import spread_variance

        return WaveletVariances(
            curves=spread_variance(
                whole(stream), scheduler=scheduler, workers=workers, parts=parts, levels=levels, exact=exact,
                robust=robust, efficiency=efficiency, passes=passes, confidence=confidence, done=done,
            )
        )  # fmt: skip
    if robust:
        pairs = measured_pairs(
            stream, levels=levels, exact=exact, efficiency=efficiency, passes=passes, confidence=confidence,
            threads=threads, done=done,
        )  # fmt: skip
        return WaveletVariances(curves={axis: pair[1] for axis, pair in pairs.items()})
    measured = accumulators(stream.axes, stream.rate, levels=levels, exact=exact)
    _pass(stream, measured, threads, done)
    return WaveletVariances(curves=in_threads(lambda _, one: one.result(confidence), measured, threads=threads))


def measured_pairs(
    stream: Source,
    *,
    levels: int | None = None,
    exact: int | None = None,
    efficiency: float = EFFICIENCY,
    passes: int = 2,
    confidence: float = 0.95,
    threads: int | None = None,
    done: Callable[[int], None] | None = None,
) -> dict[str, tuple[WaveletVariance, WaveletVariance]]:
    """The classical and the robust wavelet variance of each axis of a recording of any length, from the same reading.

    Parameters and errors are those of `stream_variance`.
    """
    as_confidence(confidence)
    biweight(efficiency)
    if passes not in (1, 2):
        raise OptionError(argument="passes", expected="2 or 1", got=passes)
    first = accumulators(stream.axes, stream.rate, levels=levels, exact=exact, robust=True)
    samples = _pass(stream, first, threads, done)
    classical = in_threads(lambda _, one: one.result(confidence), first, threads=threads)
    if passes == 1 or all(one.holds_all for one in first.values()):
        robust = in_threads(
            lambda _, one: one.result(confidence, robust=True, efficiency=efficiency), first, threads=threads
        )
    else:
        second = in_threads(lambda _, one: one.second_pass(efficiency), first, threads=threads)
        _pass(stream, second, threads, done, again=samples)
        try:
            robust = in_threads(lambda _, one: one.result(confidence), second, threads=threads)
        except DataError as error:
            raise DataError(
                f"{stream.source} has changed between its two readings: {error}",
                advice="Read a copy that no program writes to, or read it only once with {--passes=1}.",
            ) from error
    return {axis: (classical[axis], robust[axis]) for axis in stream.axes}


def _pass(
    stream: Source,
    measured: Mapping[str, SegmentedAccumulator],
    threads: int | None,
    done: Callable[[int], None] | None,
    again: int | None = None,
) -> int:
    """Add all chunks to the accumulators of all axes; return the number of samples.

    In a second pass, `again` is the number of samples of the first pass, and the pass ends there.
    """
    pool = ThreadPoolExecutor(max(1, min(len(measured), threads or processors())))
    running: list[Future[None]] = []
    samples = segment = 0
    try:
        for chunk in stream:
            # The threads processed the previous chunk while this one was read.
            _await(running)
            if done is not None and samples:
                done(samples + (again or 0))
            after_gap = chunk.segment != segment
            kept = chunk if again is None else _until(chunk, again)
            running = [pool.submit(_take, one, kept[axis], after_gap) for axis, one in measured.items()]
            samples, segment = kept.first + len(kept), kept.segment
            if again is not None and samples >= again:
                break  # samples appended after the first pass are ignored
        _await(running)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    if done is not None:
        done(samples + (again or 0))
    return samples


def _until(chunk: Chunk, end: int) -> Chunk:
    """The samples of a chunk before sample number `end`."""
    if chunk.first + len(chunk) <= end:
        return chunk
    return replace(chunk, values={axis: v[: end - chunk.first] for axis, v in chunk.values.items()})


def whole(source: Source) -> Stream:
    """Require a `Stream`, which can be divided into parts."""
    if not isinstance(source, Stream):
        raise OptionError(argument="source", expected="a stream from gmwm.stream", got=source)
    return source


def accumulators(
    axes: Sequence[str], rate: float, *, levels: int | None = None, exact: int | None = None, robust: bool = False
) -> dict[str, WaveletAccumulator]:
    """Create an accumulator for each axis, in its SI unit; by default as exact as memory allows."""
    count = exact_levels(len(axes)) if exact is None else exact
    return {
        axis: WaveletAccumulator(
            rate, levels=levels, exact=count, unit=SI_UNIT[axis_quantity(axis)], axis=axis, robust=robust
        )
        for axis in axes
    }


def feed(chunks: Iterable[Chunk], measured: Mapping[str, SegmentedAccumulator]) -> None:
    """Add chunks to the accumulators of some axes, without threads."""
    segment = 0
    for chunk in chunks:
        for axis, one in measured.items():
            _take(one, chunk[axis], chunk.segment != segment)
        segment = chunk.segment


def _take(one: SegmentedAccumulator, values: Vector, after_gap: bool) -> None:
    if after_gap:
        one.gap()
    one.update(values)


def _await(running: Sequence[Future[None]]) -> None:
    """Wait until all are done, and raise their errors; Ctrl-C interrupts the wait."""
    pending: set[Future[None]] = set(running)
    while pending:
        _, pending = wait(pending, timeout=INTERRUPT_CHECK)
    for future in running:
        future.result()
