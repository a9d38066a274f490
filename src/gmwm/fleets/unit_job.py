"""Read and calibrate one unit of a fleet, in this process or in a worker."""

from __future__ import annotations

import errno
import gzip
import threading
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gmwm.calibration import Calibration
from gmwm.calibration.api import calibrate_recording
from gmwm.calibration.document import as_text
from gmwm.calibration.options import CalibrationOptions
from gmwm.errors import GmwmError, GmwmWarning
from gmwm.fleets.rows import Row, plain, rows_of
from gmwm.options import ReadOptions
from gmwm.readers.api import read_file, stream_file
from gmwm.readers.streams import Stream, is_large
from gmwm.remarks import Remark
from gmwm.signals import Imu

PART = "fleet"
"""Key in the document of a unit for its recording, its options and its rows of the table."""
_FINAL = frozenset({errno.EACCES, errno.EPERM, errno.ENOENT, errno.EISDIR, errno.ENOTDIR, errno.ELOOP})
"""Errors of the operating system that a retry does not remove."""
# The warning filters of Python are shared by all threads of a process, and a worker may have several.
_WARNINGS = threading.Lock()


@dataclass(frozen=True)
class UnitOptions:
    """The options for every unit: how its recording is read and calibrated."""

    calibration: CalibrationOptions
    reading: ReadOptions

    def with_topic(self, topic: str | None) -> UnitOptions:
        """Return the options for one recording of a file that holds several."""
        return self if topic is None else replace(self, reading=replace(self.reading, topic=topic))

    def to_dict(self) -> dict[str, Any]:
        """Return the options as numbers, lists and strings, after a round trip through JSON."""
        axes = None if self.calibration.wanted is None else list(self.calibration.wanted)
        return {"settings": self.calibration.to_dict(), "axes": axes, "reading": self.reading.to_dict()}


@dataclass(frozen=True)
class Job:
    """One unit to calibrate, with the number of threads for its axes."""

    unit: str
    path: str
    options: UnitOptions
    threads: int | None = None


@dataclass(frozen=True)
class Outcome:
    """The result of a job: the document of the unit and its rows of the table, or the reason of the failure.

    `passing` means that a retry may succeed.
    """

    unit: str
    document: str | None = None
    rows: tuple[Row, ...] = ()
    reason: str = ""
    passing: bool = False


def calibrate_unit(job: Job) -> Outcome:
    """Calibrate a unit. Every error except Ctrl-C is an outcome."""
    try:
        found, made = _calibrated(job)
        rows = rows_of(job.unit, job.path, found)
        content = {**found.to_dict(), PART: {**made, "rows": [plain(row) for row in rows]}}
        return Outcome(job.unit, as_text(content), tuple(rows))
    except GmwmError as error:
        return Outcome(job.unit, reason=error.reason, passing=_is_passing(error))
    except OSError as error:
        return Outcome(job.unit, reason=error.strerror or str(error), passing=_is_passing(error))
    except Exception as error:  # an unexpected error of one unit must not stop the others
        return Outcome(job.unit, reason=f"{type(error).__name__}: {error}")


def _calibrated(job: Job) -> tuple[Calibration, dict[str, Any]]:
    """Return the calibration, and the recording and the options that it was made from."""
    path, options = Path(job.path), job.options
    stamp = stamp_of(path)  # before reading, so that the next run sees a later change
    recording, warned = _read(path, options.reading)
    found = calibrate_recording(recording, options.calibration, threads=job.threads).of_file(path)
    new = tuple(remark for remark in warned if remark not in found.recording_remarks)
    found = replace(found, recording_remarks=(*found.recording_remarks, *new))
    return found, {**stamp, **options.to_dict()}


def _read(path: Path, options: ReadOptions) -> tuple[Imu | Stream, list[Remark]]:
    """Return the recording, as a stream if it is large, and the remarks from reading it."""
    chunked = is_large(path) and options.gaps == "keep"
    with _WARNINGS, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", GmwmWarning)
        recording = stream_file(path, options) if chunked else read_file(path, options)
    found = [one.message.remark for one in caught if isinstance(one.message, GmwmWarning)]
    return recording, list(dict.fromkeys(found))


def stamp_of(path: Path) -> dict[str, int]:
    """Return size and time of the last change of a recording, or of all files of a folder."""
    files = [path] if not path.is_dir() else [file for file in path.rglob("*") if file.is_file()]
    found = [file.stat() for file in files]
    return {
        "size": sum(one.st_size for one in found),
        "modified_ns": max((one.st_mtime_ns for one in found), default=0),
    }


def _is_passing(error: BaseException | None) -> bool:
    """Return whether the operating system, such as a network file system, caused the error, so that it may pass."""
    while error is not None:
        if isinstance(error, OSError) and not isinstance(error, gzip.BadGzipFile) and error.errno is not None:
            return error.errno not in _FINAL
        error = error.__cause__
    return False
