"""Compute the results of a session in jobs that call public functions of gmwm, and keep the results for later use."""

from __future__ import annotations

import threading
from collections.abc import Hashable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import gmwm
from gmwm.applications.app.folders import Folders
from gmwm.applications.app.jobs import Job, Jobs
from gmwm.applications.app.overview import overview
from gmwm.applications.app.session import Session
from gmwm.base.axis_names import by_sensor, sensor_of
from gmwm.base.errors import GmwmError
from gmwm.base.text import duration_text
from gmwm.base.threads import in_threads
from gmwm.calibration.calibrate_axis import choose_model, final_fit, given_fit
from gmwm.calibration.data import Recordings
from gmwm.calibration.measure import MeasuredAxis, measure
from gmwm.calibration.passes import Execution
from gmwm.choosing.selection.search import ModelChoice
from gmwm.choosing.selection.shared_form import with_shared_form
from gmwm.files.readers.streams import Stream, is_large
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.inspection import inspect
from gmwm.measuring.variance.result import WaveletVariances
from gmwm.recording.signals import Imu

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
