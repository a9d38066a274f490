"""Read and calibrate one unit of a fleet, in this process or in a worker."""

from __future__ import annotations

import errno
import gzip
import threading
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gmwm.applications.fleets.table import Row, plain, rows_of
from gmwm.base.errors import GmwmError, GmwmWarning
from gmwm.base.remarks import Remark
from gmwm.base.text import counted
from gmwm.calibration import Calibration
from gmwm.calibration.calibrate_recordings import calibrate_recording
from gmwm.calibration.document import as_text
from gmwm.calibration.options import CalibrationOptions
from gmwm.files.readers.api import read_file, stream_file
from gmwm.files.readers.streams import Stream, is_large
from gmwm.recording.options import ReadOptions
from gmwm.recording.signals import Imu

PART = "fleet"
"""Key of the size and time of the recording, options and table rows in the document of a unit."""
_FINAL = frozenset({errno.EACCES, errno.EPERM, errno.ENOENT, errno.EISDIR, errno.ENOTDIR, errno.ELOOP})
"""Error numbers of the operating system for which a retry is useless."""
# All threads of a process share Python's warning filters, and a worker may have several threads.
_WARNINGS = threading.Lock()


@dataclass(frozen=True)
class UnitOptions:
    """Options of a unit: how to read its recording, and how to calibrate it."""

    calibration: CalibrationOptions
    reading: ReadOptions

    def with_topic(self, topic: str | None) -> UnitOptions:
        """Return the options for one recording of a file with several recordings; None leaves them unchanged."""
        return self if topic is None else replace(self, reading=replace(self.reading, topic=topic))

    def to_dict(self) -> dict[str, Any]:
        """Return the options as numbers, lists and strings for JSON."""
        axes = None if self.calibration.wanted is None else list(self.calibration.wanted)
        return {"settings": self.calibration.to_dict(), "axes": axes, "reading": self.reading.to_dict()}


@dataclass(frozen=True)
class UnitJob:
    """One unit to calibrate, with its recording, its options and the number of threads for its axes."""

    unit: str
    path: str
    options: UnitOptions
    threads: int | None = None


@dataclass(frozen=True)
class UnitOutcome:
    """Document and table rows of a unit, or the reason of its failure, which may be `passing`: a retry may succeed."""

    unit: str
    document: str | None = None
    rows: tuple[Row, ...] = ()
    reason: str = ""
    passing: bool = False


def calibrate_unit(job: UnitJob) -> UnitOutcome:
    """Calibrate a unit. Every error except Ctrl-C is returned as an outcome."""
    try:
        calibration, provenance = _calibrate(job)
        rows = rows_of(job.unit, job.path, calibration)
        content = {**calibration.to_dict(), PART: {**provenance, "rows": [plain(row) for row in rows]}}
        return UnitOutcome(job.unit, as_text(content), tuple(rows))
    except GmwmError as error:
        return UnitOutcome(job.unit, reason=error.reason, passing=_is_passing(error))
    except OSError as error:
        return UnitOutcome(job.unit, reason=error.strerror or str(error), passing=_is_passing(error))
    except Exception as error:  # an unexpected error of one unit must not stop the others
        return UnitOutcome(job.unit, reason=f"{type(error).__name__}: {error}")


def lost_outcome(job: UnitJob, deaths: int) -> UnitOutcome:
    """Return the outcome of a job whose process ended each time, although no other job was running."""
    reason = f"its worker process died {counted(deaths, 'time')} without another job; it may need more memory"
    return UnitOutcome(job.unit, reason=f"{reason}, or the file may be damaged")


def _calibrate(job: UnitJob) -> tuple[Calibration, dict[str, Any]]:
    """Return the calibration of a unit, and the options, size and time of the recording that it was made from."""
    path, options = Path(job.path), job.options
    stamp = stamp_of(path)  # taken before the file is read, so that the next run notices a later change
    recording, warned = _read(path, options.reading)
    calibration = calibrate_recording(recording, options.calibration, threads=job.threads).of_file(path)
    new = tuple(remark for remark in warned if remark not in calibration.recording_remarks)
    calibration = replace(calibration, recording_remarks=(*calibration.recording_remarks, *new))
    return calibration, {**stamp, **options.to_dict()}


def _read(path: Path, options: ReadOptions) -> tuple[Imu | Stream, list[Remark]]:
    """Return the recording of a unit, as a stream if it is large, and the remarks that reading it produced."""
    chunked = is_large(path) and options.gaps == "keep"
    with _WARNINGS, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", GmwmWarning)
        recording = stream_file(path, options) if chunked else read_file(path, options)
    remarks = [warning.message.remark for warning in caught if isinstance(warning.message, GmwmWarning)]
    return recording, list(dict.fromkeys(remarks))


def stamp_of(path: Path) -> dict[str, int]:
    """Return the size and the modification time of a recording. For a folder, all its files are included."""
    files = [path] if not path.is_dir() else [file for file in path.rglob("*") if file.is_file()]
    stats = [file.stat() for file in files]
    return {
        "size": sum(stat.st_size for stat in stats),
        "modified_ns": max((stat.st_mtime_ns for stat in stats), default=0),
    }


def _is_passing(error: BaseException | None) -> bool:
    """Return whether an error of the operating system, for example of a network file system, may be temporary."""
    while error is not None:
        if isinstance(error, OSError) and not isinstance(error, gzip.BadGzipFile) and error.errno is not None:
            return error.errno not in _FINAL
        error = error.__cause__
    return False
