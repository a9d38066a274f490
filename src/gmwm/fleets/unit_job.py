"""One unit of a fleet: its recording read, calibrated and made a document; the same in this process and in another."""

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
from gmwm.readers.api import read_file
from gmwm.readers.streams import Stream, is_large, stream_file
from gmwm.remarks import Remark
from gmwm.signals import Imu

PART = "fleet"
"""The key of a unit's document under which stands what it was made of and how, and its rows of the table."""
_FINAL = frozenset({errno.EACCES, errno.EPERM, errno.ENOENT, errno.EISDIR, errno.ENOTDIR, errno.ELOOP})
"""Errors of the system that another try does not mend."""
# Python's filters of warnings belong to the whole process: a worker may have several threads.
_WARNINGS = threading.Lock()


@dataclass(frozen=True)
class UnitOptions:
    """Options of every unit: how its recording is read, and how it is calibrated."""

    calibration: CalibrationOptions
    reading: ReadOptions

    def to_dict(self) -> dict[str, Any]:
        """All of it as plain numbers, lists and texts, as JSON gives them back."""
        axes = None if self.calibration.wanted is None else list(self.calibration.wanted)
        return {"settings": self.calibration.to_dict(), "axes": axes, "reading": self.reading.to_dict()}


@dataclass(frozen=True)
class Job:
    """One unit to be calibrated, axes in so many threads."""

    unit: str
    path: str
    options: UnitOptions
    threads: int | None = None


@dataclass(frozen=True)
class Outcome:
    """The outcome of a unit: the text of its document and its rows of the table, or the reason of the failure.

    `passing` is whether another try may go better.
    """

    unit: str
    document: str | None = None
    rows: tuple[Row, ...] = ()
    reason: str = ""
    passing: bool = False


def calibrate_unit(job: Job) -> Outcome:
    """Calibrate a unit; whatever goes wrong is an outcome, but for Ctrl-C."""
    try:
        found, made = _calibrated(job)
        rows = rows_of(job.unit, job.path, found)
        content = {**found.to_dict(), PART: {**made, "rows": [plain(row) for row in rows]}}
        return Outcome(job.unit, as_text(content), tuple(rows))
    except GmwmError as error:
        # The table has the path beside it.
        why = str(error).removeprefix(f"{job.path}: ").replace(job.path, Path(job.path).name)
        return Outcome(job.unit, reason=why, passing=_is_passing(error))
    except OSError as error:
        return Outcome(job.unit, reason=error.strerror or str(error), passing=_is_passing(error))
    except Exception as error:  # one unit must not end thousands
        return Outcome(job.unit, reason=f"{type(error).__name__}: {error}")


def _calibrated(job: Job) -> tuple[Calibration, dict[str, Any]]:
    """The calibration, and what it was made of and how."""
    path, options = Path(job.path), job.options
    stamp = stamp_of(path)  # before it is read: what changes from here on is seen next time
    recording, warned = _read(path, options.reading)
    found = calibrate_recording(recording, options.calibration, threads=job.threads).of_file(path)
    new = tuple(remark for remark in warned if remark not in found.recording_remarks)
    found = replace(found, recording_remarks=(*found.recording_remarks, *new))
    return found, {**stamp, **options.to_dict()}


def _read(path: Path, options: ReadOptions) -> tuple[Imu | Stream, list[Remark]]:
    """The recording, a large one in chunks, and what reading it warned of, without the file's name."""
    chunked = is_large(path) and options.gaps == "keep"
    with _WARNINGS, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", GmwmWarning)
        recording = stream_file(path, options) if chunked else read_file(path, options)
    found = [one.message.remark for one in caught if isinstance(one.message, GmwmWarning)]
    return recording, list(dict.fromkeys(found))


def stamp_of(path: Path) -> dict[str, int]:
    """Size and time of the last change of a recording; of a folder that is one, of all files in it."""
    files = [path] if not path.is_dir() else [file for file in path.rglob("*") if file.is_file()]
    told = [file.stat() for file in files]
    return {
        "size": sum(one.st_size for one in told),
        "modified_ns": max((one.st_mtime_ns for one in told), default=0),
    }


def _is_passing(error: BaseException | None) -> bool:
    """Whether the system was at fault, as a network file system is now and then, not the file."""
    while error is not None:
        if isinstance(error, OSError) and not isinstance(error, gzip.BadGzipFile) and error.errno is not None:
            return error.errno not in _FINAL
        error = error.__cause__
    return False
