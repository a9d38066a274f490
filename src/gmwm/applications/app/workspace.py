"""Compute the results of a session in jobs that call public functions of gmwm, and keep the results for later use."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import gmwm
from gmwm.applications.app.folders import Folders
from gmwm.applications.app.jobs import Job, Jobs
from gmwm.applications.app.session import Session
from gmwm.base.arrays import Vector, runs_of
from gmwm.base.axis_names import by_sensor, sensor_of
from gmwm.base.errors import GmwmError
from gmwm.base.text import duration_text
from gmwm.base.threads import in_threads
from gmwm.base.time_base import TimeBase
from gmwm.base.units import SI_UNIT
from gmwm.calibration.calibrate_recordings import choose_model, final_fit, given_fit
from gmwm.calibration.data import Recordings
from gmwm.calibration.measure import MeasuredAxis, measure
from gmwm.calibration.passes import Execution
from gmwm.choosing.selection.search import ModelChoice
from gmwm.choosing.selection.shared_form import with_shared_form
from gmwm.files.readers.streams import Stream, is_large
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.inspection import inspect
from gmwm.measuring.variance.result import WaveletVariances
from gmwm.recording.chunks import Chunk
from gmwm.recording.signals import Imu, Signal

SCREEN_COLUMNS = 2048
"""Largest number of columns to which a recording is reduced, which is more than a screen shows."""


class Overview:
    """The smallest and the largest sample of each axis in each of at most `SCREEN_COLUMNS` equal parts of a recording.

    A part has `width` samples. Whenever the recording is longer than all parts together, the width is doubled, so the
    length of the recording need not be known in advance.
    """

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


CUTS = ("start", "stop", "skip", "gaps")
"""Options for reading that leave samples out."""


class Workspace:
    """The session and the results of one page in a browser.

    The methods that compute a result return a job. Jobs of other pages are not affected.

    Attributes
    ----------
    folders : Folders
        The files that the page may open.
    session : Session or None
        The last session of the page; None if the page has not changed its session since this workspace was created.
    lock : lock
        Lock that is held while the session changes, so that no change is lost if two changes come at the same time.
    """

    def __init__(self, folders: Folders) -> None:
        self.folders, self.jobs = folders, Jobs()
        self.session: Session | None = None
        self.lock = threading.Lock()

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
                # The selected part may be readable although the whole recording is not, for example because its
                # sampling rate changes.
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
