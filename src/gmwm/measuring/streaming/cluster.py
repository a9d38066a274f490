"""Compute the wavelet variance of a long recording in parts, on workers of a Dask cluster, and merge them."""

from __future__ import annotations

import asyncio
import concurrent.futures
import pickle
import queue
import zlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from gmwm.base.errors import GmwmError
from gmwm.base.extras import library
from gmwm.base.threads import INTERRUPT_CHECK
from gmwm.base.time_base import lost_samples
from gmwm.files.readers.builder import RowSummary
from gmwm.files.readers.parts import Part, PartReader
from gmwm.files.readers.streams import FileRows, Stream
from gmwm.measuring.streaming.passes import AxisCurves, Change, Feeding, measure
from gmwm.measuring.streaming.scheduling import connect
from gmwm.measuring.variance.accumulate import WaveletAccumulator
from gmwm.measuring.variance.open_segments import exact_levels
from gmwm.measuring.variance.second_pass import SecondPass
from gmwm.recording.batches import Batch, gather
from gmwm.recording.gaps import is_short

if TYPE_CHECKING:
    from distributed import Client

PART_BYTES = 64 << 20
"""Default limit of the size of a worker's result for a part (bytes). It is a choice; six axes have 19 exact levels."""
RETRIES = 2  # number of retries of a part after an error that is not caused by the content of the file

G = TypeVar("G", WaveletAccumulator, SecondPass)


def part_levels(axes: int) -> int:
    """Return the default number of exact levels, for results of workers of at most `PART_BYTES` bytes."""
    # The result has the samples at both ends: 16 bytes for each of 2^exact samples.
    return exact_levels(axes, PART_BYTES, 16)


def measure_in_parts(
    stream: Stream, curves: Mapping[str, AxisCurves], *, scheduler: str | Client | None = None,
    workers: int | None = None, parts: int | None = None, done: Callable[[int], None] | None = None,
    prepare: Callable[[Batch], Batch] | None = None,
) -> None:  # fmt: skip
    """Measure empty `curves` of a recording in one or two passes, in several processes or machines (`connect`).

    The result is that of one process. Workers read their parts under the same path; a lost worker's part is read again.
    By default each thread gets four `parts`. `done` gets the number of samples so far, over both passes."""
    with connect(scheduler, workers) as client:
        crew = _Crew(
            client, stream, {axis: axis_curves.change for axis, axis_curves in curves.items()}, parts=parts, done=done,
            prepare=prepare,
        )  # fmt: skip
        first = crew.measure({axis: axis_curves.first.part for axis, axis_curves in curves.items()})
        for axis, axis_curves in curves.items():
            axis_curves.first = first[axis]
        # A part that is the whole recording may need no second pass.
        again = {axis: axis_curves for axis, axis_curves in curves.items() if axis_curves.begin_again()}
        second = crew.measure(
            {axis: axis_curves.second.part for axis, axis_curves in again.items() if axis_curves.second is not None}
        )
        for axis, axis_curves in again.items():
            axis_curves.second = second[axis]
    stream._complete(crew.summary, stacklevel=6)


@dataclass(frozen=True, eq=False)
class _Measured(Generic[G]):
    """Result of a worker for a part: an accumulator for each axis, and a summary of the rows."""

    axes: Mapping[str, G]
    summary: RowSummary

    def has_short_gaps(self, rate: float) -> bool:
        """Return whether a gap of the part, or before it, may be filled: samples and rows then have other numbers."""
        late = [seconds - 1 / rate for _, seconds in self.summary.gaps]
        return bool(np.any(is_short(lost_samples(late, rate))))

    def followed_by(self, later: _Measured[G]) -> _Measured[G]:
        """Merge the results of this part and the next one, with a gap between them if the recording has one there."""
        axes: dict[str, G] = {}
        for axis, accumulator in self.axes.items():
            if later.summary.parted:
                accumulator.gap()
            axes[axis] = accumulator.merge(later.axes[axis])
        return _Measured(axes, self.summary.followed_by(later.summary))


@dataclass(frozen=True, eq=False)
class _Begin(Generic[G]):
    """Functions that create each axis's accumulator of a part; Dask would split a dict."""

    axes: Mapping[str, Callable[[int], G]]
    changes: Mapping[str, Change | None]
    prepare: Callable[[Batch], Batch] | None


def _unpack(packed: bytes) -> Any:
    """Restore an object that `_hold` compressed."""
    return pickle.loads(zlib.decompress(packed))


def _measure(part: Part, begin: _Begin[G]) -> _Measured[G] | GmwmError:
    """Measure a part in a worker; return an error in the file, because Dask would repeat the work if it were raised."""
    reader = PartReader(part)
    axes = {axis: create(part.first) for axis, create in begin.axes.items()}
    try:
        measured = {axis: Feeding(accumulator.feed, begin.changes[axis]) for axis, accumulator in axes.items()}
        batches = gather(reader.samples(), tuple(axes), part.found.rate)
        measure(batches if begin.prepare is None else map(begin.prepare, batches), measured, threads=1)
    except GmwmError as error:
        return error
    return _Measured(axes, reader.summary)


class _Crew:
    """Distributes the parts of a recording over the workers of a cluster, at most a few for each worker at once."""

    summary: RowSummary

    def __init__(
        self, client: Any, stream: Stream, changes: Mapping[str, Change | None], *, parts: int | None,
        done: Callable[[int], None] | None, prepare: Callable[[Batch], Batch] | None,
    ) -> None:  # fmt: skip
        self._client, self._done, self._changes, self._prepare, self._samples = client, done, changes, prepare, 0
        self._source, self._dask, self._distributed = stream.source, import_module("dask"), library("distributed")
        if parts is None:
            path = None if not isinstance(stream._rows, FileRows) else stream._rows.path
            # Several parts for each thread, against slow workers, of at most 4 GiB, read again if a worker is lost.
            parts = max(4 * self._threads(), (path.stat().st_size if path else 0) // (4 << 30))
        self._parts: tuple[Part, ...] = stream.parts(parts)
        self._whole: tuple[Part, ...] = stream.parts(1)

    def measure(self, axes: Mapping[str, Callable[[int], G]]) -> Mapping[str, G]:
        """Measure all parts in order; raise the first error. With lost rows or filled gaps, measure again as one."""
        if not axes:
            return {}
        result = self._measure_parts(axes)
        if result is None:
            self._parts, self._samples = self._whole, 0
            result = self._measure_parts(axes)
        assert result is not None
        self.summary = result.summary
        return result.axes

    def _measure_parts(self, axes: Mapping[str, Callable[[int], G]]) -> _Measured[G] | None:
        """Measure all parts and merge them in order; None if they cannot be measured one by one."""
        arrived: queue.SimpleQueue[int] = queue.SimpleQueue()
        running: dict[int, Any] = {}
        answers: dict[int, _Measured[G] | GmwmError] = {}
        joined: _Measured[G] | None = None
        submitted = merged = 0
        rate = self._whole[0].found.rate
        begin = self._hold(_Begin(axes, self._changes, self._prepare))
        try:
            while joined is None or merged < len(self._parts):
                # Two parts for each thread are submitted at once.
                while submitted < min(len(self._parts), merged + 2 * self._threads()):
                    running[submitted] = self._ask(submitted, begin, arrived)
                    submitted += 1
                k = _next(arrived)
                answers[k] = self._answer(k, running.pop(k))
                while merged in answers:
                    part = answers.pop(merged)
                    if isinstance(part, GmwmError):
                        raise part
                    ends = joined.summary.stop if joined is not None else 0
                    if len(self._parts) > 1 and (part.has_short_gaps(rate) or ends != self._parts[merged].first):
                        return None
                    joined = part if joined is None else joined.followed_by(part)
                    merged += 1
        finally:
            with suppress(Exception):  # the scheduler may be gone
                self._client.cancel([*running.values(), begin], force=True)
        return joined

    def _threads(self) -> int:
        """Return the current number of threads of all workers. More workers may connect later."""
        return max(1, int(sum(self._client.nthreads().values())))

    def _hold(self, begin: _Begin[G]) -> Any:
        """Send the functions to the cluster once, as a task that Dask repeats if the worker that holds them is lost."""
        packed = zlib.compress(pickle.dumps(begin), 1)
        with self._dask.config.set({"distributed.admin.large-graph-warning-threshold": "1GB"}):
            return self._client.submit(_unpack, packed, pure=False, retries=RETRIES)

    def _ask(self, k: int, begin: Any, arrived: queue.SimpleQueue[int]) -> Any:
        future = self._client.submit(_measure, self._parts[k], begin, pure=False, retries=RETRIES)
        future.add_done_callback(lambda _: arrived.put(k))
        return future

    def _answer(self, k: int, future: Any) -> Any:
        """Return the result of a worker. Raise an error if the workers died or the scheduler is lost."""
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
    """Wait for the next finished part; Ctrl-C interrupts the wait."""
    while True:
        with suppress(queue.Empty):
            return arrived.get(timeout=INTERRUPT_CHECK)
