"""The wavelet variance of one long recording, its parts measured by the workers of a Dask cluster and put together."""

from __future__ import annotations

import asyncio
import concurrent.futures
import pickle
import queue
import zlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from gmwm._threads import INTERRUPT_CHECK
from gmwm.errors import GmwmError, OptionError
from gmwm.options import as_confidence
from gmwm.readers.chunks import RowSummary
from gmwm.readers.parts import Part, PartReader
from gmwm.readers.reading_warnings import of_file, warn
from gmwm.readers.streams import Stream
from gmwm.streaming.passes import accumulators, feed
from gmwm.streaming.scheduling import connected, library
from gmwm.variance.accumulate import WaveletAccumulator
from gmwm.variance.biweight import EFFICIENCY, biweight, require_robust
from gmwm.variance.open_segments import EXACT
from gmwm.variance.result import WaveletVariance
from gmwm.variance.second_pass import SecondPass

if TYPE_CHECKING:
    from distributed import Client

A_THREAD = 4
"""Parts for each thread of the cluster, by default: where one is slow others are not kept waiting for long."""
PART_BYTES = 4 << 30
"""Bytes of the file in a part, at the most, by default: so much is read again if a worker is lost."""
AHEAD = 2
"""Parts for each thread that are asked for at once."""

G = TypeVar("G", WaveletAccumulator, SecondPass)


def spread_variance(
    stream: Stream,
    *,
    scheduler: str | Client | None = None,
    workers: int | None = None,
    parts: int | None = None,
    levels: int | None = None,
    exact: int = EXACT,
    robust: bool = False,
    efficiency: float = EFFICIENCY,
    passes: int = 2,
    confidence: float = 0.95,
    done: Callable[[int], None] | None = None,
    retries: int = 2,
) -> dict[str, WaveletVariance]:
    """The wavelet variance of each axis of one long recording, over processes or machines: that of one pass.

    Each worker reads parts of the file by itself; what it sends back does not grow with their length. If a worker is
    lost, others read its part again.

    Parameters
    ----------
    stream : Stream
        Of `gmwm.stream`. The workers must find its file under the same path.
    scheduler : str, distributed.Client or None
        Address of a Dask scheduler, or a client of one; None to begin worker processes on this machine.
    workers : int, optional
        How many processes to begin where there is no scheduler.
    parts : int, optional
        Into how many parts to divide the recording; four for each thread of the workers by default.
    levels, exact, robust, efficiency, passes, confidence
        As of `Stream.wavelet_variance`.
    done : callable, optional
        Called with the number of samples so far as parts come in, in the calling thread; in a second pass the count
        goes on, to twice the number of samples.
    retries : int
        How often a part is tried again after an error that is not about what the file holds.

    Returns
    -------
    dict of axis name to WaveletVariance

    Raises
    ------
    ReadError, DataError
        At what `read` refuses: the first in the file.
    OptionError
        If an option is not one of those it may be, or the scheduler does not answer.
    MissingDependencyError
        If Dask is not installed.
    GmwmError
        If workers die at a part again and again, or the scheduler is lost.

    Examples
    --------
    >>> import gmwm
    >>> def main() -> None:  # worker processes import the script that runs
    ...     curves = spread_variance(gmwm.stream("a_month.parquet"), workers=8)
    ...     curves = spread_variance(gmwm.stream("/shared/a_month.parquet"), scheduler="tcp://10.0.0.5:8786")
    """
    as_confidence(confidence)
    require_robust(robust, efficiency)
    if robust:
        pairs = spread_pairs(
            stream, scheduler=scheduler, workers=workers, parts=parts, levels=levels, exact=exact,
            efficiency=efficiency, passes=passes, confidence=confidence, done=done, retries=retries,
        )  # fmt: skip
        return {axis: pair[1] for axis, pair in pairs.items()}
    empty = accumulators(stream.axes, stream.rate, levels=levels, exact=exact)
    with connected(scheduler, workers) as client:
        crew = _Crew(client, stream, parts=parts, done=done, retries=retries)
        first = crew.measure({axis: partial(_beginning, one) for axis, one in empty.items()})
    _tell(stream, crew.summary)
    return {axis: one.result(confidence) for axis, one in first.items()}


def spread_pairs(
    stream: Stream,
    *,
    scheduler: str | Client | None = None,
    workers: int | None = None,
    parts: int | None = None,
    levels: int | None = None,
    exact: int = EXACT,
    efficiency: float = EFFICIENCY,
    passes: int = 2,
    confidence: float = 0.95,
    done: Callable[[int], None] | None = None,
    retries: int = 2,
) -> dict[str, tuple[WaveletVariance, WaveletVariance]]:
    """The classical and the robust wavelet variance of each axis of one long recording, over processes or machines.

    Parameters and errors are those of `spread_variance`.
    """
    as_confidence(confidence)
    biweight(efficiency)
    if passes not in (1, 2):
        raise OptionError(argument="passes", expected="2 or 1", got=passes)
    empty = accumulators(stream.axes, stream.rate, levels=levels, exact=exact, robust=True)
    with connected(scheduler, workers) as client:
        crew = _Crew(client, stream, parts=parts, done=done, retries=retries)
        first = crew.measure({axis: partial(_beginning, one) for axis, one in empty.items()})
        classical = {axis: one.result(confidence) for axis, one in first.items()}
        if passes == 1:
            found = {axis: one.result(confidence, robust=True, efficiency=efficiency) for axis, one in first.items()}
        else:
            second = crew.measure({axis: one.second_pass(efficiency).part for axis, one in first.items()})
            found = {axis: one.result(confidence) for axis, one in second.items()}
    _tell(stream, crew.summary)
    return {axis: (classical[axis], found[axis]) for axis in stream.axes}


def _tell(stream: Stream, summary: RowSummary) -> None:
    """Raise the errors and give the warnings that concern the recording as a whole."""
    remarks = summary.remarks(stream._found)
    stream._ended(summary.time_base(stream._found))
    warn(of_file(remarks, stream.source), stacklevel=3)


@dataclass(frozen=True, eq=False)
class _Measured(Generic[G]):
    """What a worker knows of a part: each axis, and what is to be told at the end."""

    axes: Mapping[str, G]
    summary: RowSummary

    def followed_by(self, later: _Measured[G]) -> _Measured[G]:
        """Of two parts; a gap between them is one."""
        axes: dict[str, G] = {}
        for axis, one in self.axes.items():
            if later.summary.parted:
                one.gap()
            axes[axis] = one.merge(later.axes[axis])
        return _Measured(axes, self.summary.followed_by(later.summary))


@dataclass(frozen=True, eq=False)
class _Begin(Generic[G]):
    """What makes, of the number of a first sample, that which takes each axis: one thing to Dask, not a dict."""

    axes: Mapping[str, Callable[[int], G]]


def _beginning(one: WaveletAccumulator, start: int) -> WaveletAccumulator:
    """An empty one like another, for a part that begins with sample `start`."""
    return WaveletAccumulator(
        one.rate, levels=one.levels, exact=one.exact, start=start, unit=one.unit, axis=one.axis, robust=one.robust
    )


def _unpacked(packed: bytes) -> Any:
    """What was packed in this module."""
    return pickle.loads(zlib.decompress(packed))


def _measure(part: Part, begin: _Begin[G]) -> _Measured[G] | GmwmError:
    """The work of a worker. What is wrong in the file comes back as it is: it would be no better a second time."""
    reader = PartReader(part)
    axes = {axis: made(part.first) for axis, made in begin.axes.items()}
    try:
        feed(reader, axes)
    except GmwmError as error:
        return error
    return _Measured(axes, reader.summary)


class _Crew:
    """The workers of a cluster and the parts of a recording that they are given, at most some for each at once."""

    summary: RowSummary

    def __init__(
        self, client: Any, stream: Stream, parts: int | None, done: Callable[[int], None] | None, retries: int
    ) -> None:
        self._client, self._done, self._retries, self._samples = client, done, retries, 0
        self._source, self._dask, self._distributed = stream.source, import_module("dask"), library()
        if parts is None:
            path = None if stream._origin is None else stream._origin.path
            parts = max(A_THREAD * self._threads(), (path.stat().st_size if path else 0) // PART_BYTES)
        self._parts: tuple[Part, ...] = stream.parts(parts)

    def measure(self, axes: Mapping[str, Callable[[int], G]]) -> Mapping[str, G]:
        """All parts, in order, by what makes that which takes an axis; the first error in the file is raised."""
        arrived: queue.SimpleQueue[int] = queue.SimpleQueue()
        running: dict[int, Any] = {}
        found: dict[int, _Measured[G] | GmwmError] = {}
        joined: _Measured[G] | None = None
        asked = merged = 0
        begin = self._held(_Begin(axes))
        try:
            while joined is None or merged < len(self._parts):
                while asked < min(len(self._parts), merged + AHEAD * self._threads()):
                    running[asked] = self._ask(asked, begin, arrived)
                    asked += 1
                k = _next(arrived)
                found[k] = self._answer(k, running.pop(k))
                while merged in found:
                    part = found.pop(merged)
                    if isinstance(part, GmwmError):
                        raise part
                    joined = part if joined is None else joined.followed_by(part)
                    merged += 1
        finally:
            with suppress(Exception):  # the scheduler may be gone
                self._client.cancel([*running.values(), begin], force=True)
        self.summary = joined.summary
        return joined.axes

    def _threads(self) -> int:
        """Threads of all workers now; there may be more later."""
        return max(1, int(sum(self._client.nthreads().values())))

    def _held(self, begin: _Begin[G]) -> Any:
        """What parts are begun with, sent once: a task of its own, done again where a worker that has it is lost."""
        packed = zlib.compress(pickle.dumps(begin), 1)
        with self._dask.config.set({"distributed.admin.large-graph-warning-threshold": "1GB"}):
            return self._client.submit(_unpacked, packed, pure=False, retries=self._retries)

    def _ask(self, k: int, begin: Any, arrived: queue.SimpleQueue[int]) -> Any:
        future = self._client.submit(_measure, self._parts[k], begin, pure=False, retries=self._retries)
        future.add_done_callback(lambda _: arrived.put(k))
        return future

    def _answer(self, k: int, future: Any) -> Any:
        """What a worker found, or an error that says why there is nothing."""
        lost = (asyncio.CancelledError, concurrent.futures.CancelledError, self._distributed.comm.CommClosedError)
        try:
            answer = future.result()
        except self._distributed.KilledWorker as error:
            raise GmwmError(
                f"{self._source}: several workers died while reading {self._parts[k]!r}, possibly for lack of memory",
                advice="Start fewer workers per machine, or give `gmwm.stream` a smaller chunk.",
            ) from error
        except lost as error:
            raise GmwmError(
                f"{self._source}: the connection to the Dask scheduler was lost", advice="Start again."
            ) from error
        if isinstance(answer, _Measured):
            self._samples += answer.summary.stop - answer.summary.first
            if self._done is not None:
                self._done(self._samples)
        return answer


def _next(arrived: queue.SimpleQueue[int]) -> int:
    """The part that is done next, looking up for Ctrl-C."""
    while True:
        with suppress(queue.Empty):
            return arrived.get(timeout=INTERRUPT_CHECK)
