"""The wavelet variances and the inspection of a recording in chunks, from the same two readings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from gmwm._text import duration_text
from gmwm.errors import GmwmError
from gmwm.inspection import Inspection, inspect
from gmwm.inspection.api import FirstPass, RecordingStatistics
from gmwm.readers.streams import Chunk, Stream
from gmwm.streaming.cluster import spread_pairs, spread_variance
from gmwm.streaming.passes import measured_pairs, stream_variance
from gmwm.streaming.scheduling import connected
from gmwm.variance.biweight import EFFICIENCY
from gmwm.variance.result import WaveletVariance

if TYPE_CHECKING:
    from distributed import Client


def measured_and_seen(
    stream: Stream,
    axes: Sequence[str],
    *,
    pairs: bool = True,
    robust: bool = False,
    efficiency: float = EFFICIENCY,
    threads: int | None = None,
    scheduler: str | Client | None = None,
    workers: int | None = None,
    done: Callable[[str], None] | None = None,
) -> tuple[dict[str, tuple[WaveletVariance, ...]], Inspection]:
    """The curves of some axes, and what `inspect` finds in all, from the same two readings.

    Parameters
    ----------
    stream : Stream
    axes : sequence of str
        Those that are measured.
    pairs : bool
        Whether both the classical and the robust curve are wanted, in this order; else one, as `robust` says.
    robust, efficiency, threads, scheduler, workers
        As of `stream_variance`. With workers, one of them inspects while the others measure.
    done : callable, optional
        Called as chunks are read, with how much was, in words.
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
            done=done,
        )
    seen = InspectedStream(stream, axes, done)
    if pairs:
        both = measured_pairs(seen, efficiency=efficiency, threads=threads)
        return dict(both), seen.inspection()
    curves = stream_variance(seen, robust=robust, efficiency=efficiency, threads=threads)
    return {axis: (curve,) for axis, curve in curves.items()}, seen.inspection()


def _spread(
    stream: Stream, axes: Sequence[str], pairs: bool, robust: bool, efficiency: float,
    scheduler: str | Client | None, workers: int | None, done: Callable[[str], None] | None,
) -> tuple[dict[str, tuple[WaveletVariance, ...]], Inspection]:  # fmt: skip
    """The same by the workers of a cluster, or processes of this machine."""

    def tell(samples: int) -> None:
        if done is not None:
            done(f"both readings: {duration_text(samples / stream.rate)}")

    with connected(scheduler, workers) as client:
        looking = client.submit(_inspected, stream, pure=False, retries=2)
        curves: dict[str, tuple[WaveletVariance, ...]]
        if pairs:
            curves = dict(spread_pairs(stream, scheduler=client, efficiency=efficiency, done=tell))
        else:
            found = spread_variance(stream, scheduler=client, robust=robust, efficiency=efficiency, done=tell)
            curves = {axis: (curve,) for axis, curve in found.items()}
        seen = looking.result()
    if isinstance(seen, GmwmError):
        raise seen
    return {axis: curves[axis] for axis in axes}, seen


def _inspected(stream: Stream) -> Inspection | GmwmError:
    """The work of one worker; what is wrong in the file is no better a second time."""
    try:
        return inspect(stream)
    except GmwmError as error:
        return error


class InspectedStream:
    """A stream that is inspected while it is read for something else, in its first two readings.

    Attributes
    ----------
    source : str
        Where it comes from.
    axes : tuple of str
        Those that the other one is to measure.
    rate : float
        Samples per second (Hz).
    """

    def __init__(self, stream: Stream, axes: Sequence[str], done: Callable[[str], None] | None = None) -> None:
        self.source, self.axes, self.rate = stream.source, tuple(axes), stream.rate
        self._stream, self._first = stream, FirstPass(stream)
        self._statistics: RecordingStatistics | None = None
        self._reading, self._done = 0, done

    def __iter__(self) -> Iterator[Chunk]:
        self._reading += 1
        if self._reading == 1:
            yield from self._first_reading()
        elif self._reading == 2:
            yield from self._second_reading(self._first.second_pass())
        else:
            yield from self._stream

    def inspection(self) -> Inspection:
        """The inspection; readings that are missing are done now."""
        while self._statistics is None:
            for _ in self:
                pass
        return self._statistics.result()

    def _first_reading(self) -> Iterator[Chunk]:
        for chunk in self._stream:
            self._tell(f"first reading: {self._length(chunk)}")
            self._first.update(chunk)
            yield chunk

    def _second_reading(self, statistics: RecordingStatistics) -> Iterator[Chunk]:
        self._statistics = statistics
        for chunk in self._stream:
            self._tell(f"second reading: {self._length(chunk)} of {duration_text(statistics.samples / self.rate)}")
            statistics.update(chunk)
            yield chunk

    def _length(self, chunk: Chunk) -> str:
        return duration_text((chunk.first + len(chunk)) / self.rate)

    def _tell(self, text: str) -> None:
        if self._done is not None:
            self._done(text)
