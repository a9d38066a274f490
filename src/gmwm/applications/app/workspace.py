"""The pages that are open, and the jobs that compute their results and keep them for later use."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

import gmwm
from gmwm.applications.app.folders import Folders
from gmwm.applications.app.session import Session
from gmwm.base.arrays import Vector, runs_of
from gmwm.base.errors import GmwmError
from gmwm.base.text import duration_text
from gmwm.base.threads import in_threads, stoppable
from gmwm.base.time_base import TimeBase
from gmwm.base.units import SI_UNIT, by_sensor, sensor_of
from gmwm.calibration.averaging import averaged_intervals
from gmwm.calibration.calibrate_recordings import choose_model, final_fit, given_fit, sheet_of
from gmwm.calibration.data import Recordings
from gmwm.calibration.measure import MeasuredAxis, measure
from gmwm.calibration.passes import Execution
from gmwm.choosing.selection.search import ModelChoice
from gmwm.choosing.selection.shared_form import with_shared_form
from gmwm.files.readers.streams import Stream, is_large
from gmwm.fitting.estimation.intervals import Interval
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.summary import IntervalMethod, intervals_if_known
from gmwm.measuring.inspection import inspect
from gmwm.measuring.variance.result import WaveletVariances
from gmwm.recording.chunks import Chunk
from gmwm.recording.signals import Imu, Signal

State = Literal["running", "done", "failed", "cancelled"]
SILENT_S = 0.3  # time (s) to wait for a result before the progress of a job is shown, so that short jobs show none


class Cancelled(BaseException):
    """Exception that stops a cancelled job. It is not an `Exception`, so that no handler of errors catches it."""


class Job:
    """A computation that runs in its own thread."""

    def __init__(self, title: str, work: Callable[[Job], Any], finished: Callable[[], None]) -> None:
        self.title, self._work, self._finished = title, work, finished  # the user sees the title
        self.state: State = "running"
        self.text = ""  # description of the last step
        self.share: float | None = None  # finished fraction of the work; None if unknown
        self.value: Any = None  # the result, if the state is "done"
        self.error: Exception | None = None  # the error, if the state is "failed"
        self._stop, self._ended = threading.Event(), threading.Event()
        self._lock = threading.Lock()
        self._begun = time.monotonic()
        self._thread = threading.Thread(target=self._run, name=title, daemon=True)
        self._thread.start()

    def step(self, text: str, done: float = 0, total: float = 0) -> None:
        """Report progress: a description of the step, and the finished and total amounts of work if known."""
        self.check()
        self.text, self.share = text, min(done / total, 1.0) if total > 0 else None

    @property
    def progress(self) -> str:
        """Title, last step and running time, such as "Calibrating gyro_y, 4 s"."""
        return f"{f'{self.title} {self.text}'.rstrip()}, {time.monotonic() - self._begun:.0f} s"

    def check(self) -> None:
        """Raise `Cancelled` if the job was cancelled."""
        if self._stop.is_set():
            raise Cancelled

    def cancel(self) -> None:
        """Stop the job at its next call of `step` or `check`. Its result is not used, even if it ends before."""
        self._stop.set()
        self._end("cancelled")

    def join(self, seconds: float) -> bool:
        """Wait at most this time (s) for the end of the job, and return whether it has ended."""
        return self._ended.wait(seconds)

    def result_for(self, other: Job) -> Any:
        """Wait for the result of this job in another job, and return it. The other job shows its progress."""
        while not self.join(0.05):  # check for a cancellation every 0.05 s
            other.step(f"{self.title}: {self.text}" if self.text else self.title)
        if self.state == "cancelled":
            raise Cancelled
        if self.error is not None:
            raise self.error
        return self.value

    def _run(self) -> None:
        try:
            with stoppable(self.check):
                value = self._work(self)
        except Cancelled:
            self._end("cancelled")
        except Exception as error:
            self._end("failed", error=error)
        else:
            self._end("done", value=value)

    def _end(self, state: State, value: Any = None, error: Exception | None = None) -> None:
        with self._lock:
            if self.state != "running":
                return
            self.value, self.error, self.state = value, error, state
        self._finished()
        self._ended.set()


class Jobs:
    """The jobs of one page. The last jobs of each kind are kept, and older jobs are cancelled."""

    def __init__(self) -> None:
        self.revision = 0  # increases whenever a job ends
        self._jobs: dict[str, OrderedDict[Hashable, Job]] = {}
        self._lock = threading.RLock()

    def ask(
        self, kind: str, key: Hashable, title: str, work: Callable[[Job], Any], *, kept: int = 2, alone: bool = True
    ) -> Job:
        """Return the job with a key, and start it if there is none."""
        with self._lock:
            of_kind = self._jobs.setdefault(kind, OrderedDict())
            job = of_kind.get(key)
            if job is not None:
                of_kind.move_to_end(key)
                return job
            for other in of_kind.values() if alone else ():
                other.cancel()
            while len(of_kind) >= kept:
                of_kind.popitem(last=False)[1].cancel()
            job = of_kind[key] = Job(title, work, self._count_end)
            return job

    def running(self) -> list[Job]:
        """Return the jobs that are still running."""
        with self._lock:
            return [job for of_kind in self._jobs.values() for job in of_kind.values() if job.state == "running"]

    def cancel(self) -> None:
        """Cancel all running jobs."""
        for job in self.running():
            job.cancel()

    def again(self) -> None:
        """Remove the jobs that failed or were cancelled, so that the next call of `ask` starts them again."""
        with self._lock:
            for of_kind in self._jobs.values():
                for key in [key for key, job in of_kind.items() if job.state in ("failed", "cancelled")]:
                    del of_kind[key]
        self._count_end()

    def _count_end(self) -> None:
        with self._lock:
            self.revision += 1


SCREEN_COLUMNS = 2048  # largest number of columns to which a recording is reduced, which is more than a screen shows


class Overview:
    """Smallest and largest sample of each axis in at most `SCREEN_COLUMNS` parts of a recording. Their `width`
    (samples) is doubled as it grows, since its length is not known before."""

    def __init__(self, axes: Iterable[str], rate: float) -> None:
        self.axes, self.rate = tuple(axes), rate
        self.width = 1
        shape = len(self.axes), SCREEN_COLUMNS
        self.least, self.greatest = np.full(shape, np.inf), np.full(shape, -np.inf)
        self._origin: float | None = None
        self._end = 0

    def update(self, chunk: Chunk) -> None:
        """Add the samples of the next chunk."""
        if self._origin is None:
            self._origin = chunk.start
        # If the clock was set back, these samples are placed directly after the previous ones.
        begin = max(round((chunk.start - self._origin) * self.rate), self._end)
        self._end = begin + len(chunk)
        while self._end > SCREEN_COLUMNS * self.width:
            self._halve()
        place = np.arange(begin, self._end) // self.width
        starts = np.flatnonzero(np.diff(place, prepend=-1))
        columns = place[starts]
        for k, axis in enumerate(self.axes):
            values = chunk[axis]
            self.least[k, columns] = np.minimum(self.least[k, columns], np.minimum.reduceat(values, starts))
            self.greatest[k, columns] = np.maximum(self.greatest[k, columns], np.maximum.reduceat(values, starts))

    def result(self, source: str) -> Imu:
        """Return a recording with two samples for each part, its smallest and its largest sample. Gaps are kept."""
        finite = np.isfinite(self.least[0])
        runs = runs_of(finite).tolist()
        lengths = np.cumsum([0, *(2 * (b - a) for a, b in runs)]).tolist()
        segments = tuple(pairwise(lengths))
        starts = tuple(a * self.width / self.rate for a, _ in runs)
        rate = 2 * self.rate / self.width
        signals = {}
        for k, axis in enumerate(self.axes):
            pairs: Vector = np.stack([self.least[k, finite], self.greatest[k, finite]], axis=1).ravel()
            unit = next((si for sensor, si in SI_UNIT.items() if axis.startswith(sensor)), "")
            signals[axis] = Signal(pairs, rate, unit=unit, axis=axis, segments=segments, starts=starts)
        return Imu(signals, source, time_base=TimeBase(rate))

    def _halve(self) -> None:
        self.width *= 2
        for sums, empty, combine in ((self.least, np.inf, np.minimum), (self.greatest, -np.inf, np.maximum)):
            half = combine(sums[:, ::2], sums[:, 1::2])
            sums[:, : SCREEN_COLUMNS // 2], sums[:, SCREEN_COLUMNS // 2 :] = half, empty


def overview(recording: Imu | Stream, done: Callable[[int], None]) -> Imu:
    """Return a recording that can be drawn over time. A stream is reduced to its overview; an Imu is unchanged."""
    if isinstance(recording, Imu):
        return recording
    summary, samples = Overview(recording.axes, recording.rate), 0
    for chunk in recording:
        summary.update(chunk)
        samples += len(chunk)
        done(samples)
    return summary.result(recording.source)


def shown_times(relayout: dict[str, Any] | None) -> tuple[float, float] | None:
    """Return the time range that the user marked in a figure, in the unit of its time axis; None if there is none.

    >>> shown_times({"selections": [{"x0": 20.0, "x1": 10.0}]})
    (10.0, 20.0)
    """
    marked = (relayout or {}).get("selections") or [{}]
    last = marked[-1] if isinstance(marked, list) else {}
    ends = [last.get(name) for name in ("x0", "x1")] if isinstance(last, dict) else []
    times = sorted(float(end) for end in ends if isinstance(end, int | float))
    return (times[0], times[1]) if len(times) == 2 else None


CUTS = ("start", "stop", "skip", "gaps")  # options for reading that leave samples out


class Workspace:
    """The session and the results of one page in a browser. Methods that compute a result return a job."""

    def __init__(self, folders: Folders) -> None:
        self.folders, self.jobs = folders, Jobs()
        self.session: Session | None = None  # None if the page has not changed its session since this was created
        self.lock = threading.Lock()  # held while the session changes, so that no change is lost

    def path(self, session: Session) -> Path:
        """Return the path of the recording of a session. Raises an error if the page may not open it."""
        return self.folders.file(session.file)

    def recording(self, session: Session, *, cut: bool = True) -> Job:
        """Read the recording, or open it as a stream if it is large. If `cut` is False, no samples are left out."""
        path = self.path(session)
        reading = _uncut(session.reading) if not cut else dict(session.reading)

        def work(job: Job) -> Imu | Stream:
            job.step(path.name)
            return gmwm.stream(path, **reading) if is_large(path) else gmwm.read(path, **reading)

        return self.jobs.ask("recording", (*_stamp(path), repr(reading)), "Reading", work, alone=False)

    def overview(self, session: Session) -> Job:
        """Reduce the recording for a plot over time, including the samples that the session leaves out."""
        uncut = self.recording(session, cut=False)

        def work(job: Job) -> Imu:
            try:
                recording = uncut.result_for(job)
            except GmwmError:
                # A part may be readable although the whole recording is not, for example if its rate changes.
                recording = self.recording(session).result_for(job)
            return overview(recording, lambda n: job.step(_length(n, recording)))

        return self.jobs.ask("overview", self._recording_key(session, cut=False), "Drawing", work)

    def inspection(self, session: Session) -> Job:
        """Inspect the recording."""
        return self._of_recording("inspection", session, "Inspecting", lambda recording, job: inspect(recording))

    def curves(self, session: Session, *, robust: bool = False) -> Job:
        """Compute the classical or robust wavelet variance of all axes."""

        def work(recording: Imu | Stream, job: Job) -> WaveletVariances:
            if isinstance(recording, Stream):
                return recording.wavelet_variance(robust=robust, done=lambda n: job.step(_length(n, recording)))
            variances: WaveletVariances = gmwm.wavelet_variance(recording, robust=robust)
            return variances

        return self._of_recording(f"curves{robust}", session, "Measuring", work)

    def spectrum(self, session: Session) -> Job:
        """Estimate the power spectral density of all axes."""

        def work(recording: Imu | Stream, job: Job) -> Any:
            if isinstance(recording, Stream):
                return recording.psd(done=lambda n: job.step(_length(n, recording)))
            return gmwm.psd(recording)

        return self._of_recording("spectrum", session, "Spectrum", work)

    def data(self, session: Session) -> Job:
        """Measure all axes like `gmwm calibrate`, with wrong samples replaced and temperature effects removed."""

        def work(recording: Imu | Stream, job: Job) -> dict[str, MeasuredAxis | GmwmError]:
            options = replace(session.calibration, models={})
            return measure(Recordings.of(recording, options), options, Execution(progress=job.step)).axes

        return self._of_recording("data", session, "Measuring", work)

    def fit(self, session: Session, axis: str) -> Job:
        """Fit the model of an axis like `gmwm calibrate`: the model of the user, or the recommended model."""
        options = session.calibration.of_axis(axis)

        def work(job: Job) -> Fit:
            if options.models:
                return given_fit(options.general, self._axis(session, axis, job).curve(options), options)
            choice: ModelChoice = self.search(session, axis).result_for(job)
            return final_fit(choice.ranking.recommended.model, choice.with_error, options.weighting)

        key = self._axis_key(session, axis, session.models.get(axis))
        # Removing a term and adding it again takes no time.
        return self.jobs.ask("fit", key, f"Fitting {axis}", work, kept=64)

    def intervals(self, session: Session, axis: str) -> Job:
        """Compute the intervals of the parameters of `fit` like `gmwm calibrate`."""
        fitted, level = self.fit(session, axis), session.confidence

        def work(job: Job) -> dict[str, Interval]:
            fit, spectrum = fitted.result_for(job), self._axis(session, axis, job).spectrum
            choice = None if axis in session.models else self.search(session, axis).result_for(job)
            intervals = intervals_if_known(fit, IntervalMethod(level))[0]
            return averaged_intervals(fit, intervals, sheet_of(fit, spectrum, level, choice)) if intervals else {}

        key = self._axis_key(session, axis, session.models.get(axis))
        return self.jobs.ask("intervals", key, f"Intervals of {axis}", work, kept=64)

    def search(self, session: Session, axis: str) -> Job:
        """Search for the model of an axis like `gmwm calibrate`, with the form that the axes of its sensor share."""

        def work(job: Job) -> ModelChoice:
            self._axis(session, axis, job)
            choice: ModelChoice | GmwmError = self._choices(session, sensor_of(axis)).result_for(job)[axis]
            if isinstance(choice, GmwmError):
                raise choice
            return choice

        return self.jobs.ask("search", self._axis_key(session, axis), f"Comparing models of {axis}", work, kept=12)

    def _choices(self, session: Session, sensor: str) -> Job:
        """Search for the models of the axes of a sensor; an axis without a model has an error."""
        options = replace(session.calibration, models={})

        def choose(measured: MeasuredAxis | GmwmError, job: Job) -> ModelChoice | GmwmError:
            try:
                if isinstance(measured, GmwmError):
                    return measured
                return choose_model(measured.curve(options), measured.spectrum, options, check=job.check)
            except GmwmError as error:
                return error

        def work(job: Job) -> dict[str, ModelChoice | GmwmError]:
            axes = by_sensor(self.data(session).result_for(job))[sensor]
            results = in_threads(lambda _, measured: choose(measured, job), axes)
            choices = {axis: choice for axis, choice in results.items() if not isinstance(choice, GmwmError)}
            return results | with_shared_form(choices)

        return self.jobs.ask("choices", self._axis_key(session, sensor), "Comparing models", work, kept=4)

    def calibration(self, session: Session) -> Job:
        """Calibrate all axes like `gmwm calibrate`."""
        path = self.path(session)

        def work(recording: Imu | Stream, job: Job) -> Any:
            calibration = gmwm.calibrate(
                recording, robust=session.robust, confidence=session.confidence, models=session.models,
                progress=lambda done, total, text: job.step(text, done, total),
            )  # fmt: skip
            return calibration.of_file(path)

        more = (session.robust, session.confidence, repr(session.models))
        return self._of_recording("calibration", session, "Calibrating", work, *more)

    def _of_recording(self, kind: str, session: Session, title: str, work: Any, *more: Hashable) -> Job:
        def begin(job: Job) -> Any:
            return work(self.recording(session).result_for(job), job)

        return self.jobs.ask(kind, (*self._recording_key(session), *more), title, begin)

    def _axis(self, session: Session, axis: str, job: Job) -> MeasuredAxis:
        measured: MeasuredAxis | GmwmError = self.data(session).result_for(job)[axis]
        if isinstance(measured, GmwmError):
            raise measured
        return measured

    def _recording_key(self, session: Session, *, cut: bool = True) -> tuple[Hashable, ...]:
        reading = dict(session.reading) if cut else _uncut(session.reading)
        return (*_stamp(self.path(session)), repr(reading))

    def _axis_key(self, session: Session, axis: str, *more: Hashable) -> tuple[Hashable, ...]:
        return (*self._recording_key(session), session.robust, session.confidence, axis, *more)


def _uncut(reading: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in reading.items() if name not in CUTS}


def _length(samples: int, recording: Imu | Stream) -> str:
    return duration_text(samples / recording.rate)


def _stamp(path: Path) -> tuple[str, int, int]:
    """Return path, time of change and size of a file, which identify its content."""
    state = path.stat()
    return str(path), state.st_mtime_ns, state.st_size


class Desk:
    """The open pages of a server. A new page starts with the session `first`."""

    def __init__(self, folders: Folders, first: Session) -> None:
        self.folders, self.first = folders, first
        self.places: list[str] = []  # page elements that are drawn again when the state changes
        self._pages: OrderedDict[str, Workspace] = OrderedDict()
        self._lock = threading.Lock()

    def workspace(self, page: str) -> Workspace:
        """Return the workspace of a page by its identifier. A new page gets a new workspace."""
        with self._lock:
            workspace = self._pages.setdefault(page, Workspace(self.folders))
            self._pages.move_to_end(page)
            while len(self._pages) > 8:  # the results of an older page are computed again
                _, oldest = self._pages.popitem(last=False)
                oldest.jobs.cancel()
            return workspace

    def session(self, data: dict[str, Any] | None) -> Session:
        """Return the session for the data that a page has stored. Raises an error if a value is not allowed."""
        return self.first if data is None else Session.from_dict(data)

    def close(self) -> None:
        """Cancel the jobs of all pages."""
        for workspace in self._pages.values():
            workspace.jobs.cancel()
