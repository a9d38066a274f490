"""Read and calibrate one unit of a fleet, in this process or in a worker, and make the table of all units."""

from __future__ import annotations

import errno
import gzip
import math
import threading
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

from gmwm.base.atomic_files import written_whole
from gmwm.base.errors import GmwmError, GmwmWarning, ReadError
from gmwm.base.lazy import polars as pl
from gmwm.base.remarks import Remark, Severity
from gmwm.base.text import counted, printable
from gmwm.base.threads import require_threads
from gmwm.calibration.calibrate_recordings import calibrate_recording
from gmwm.calibration.document import as_text
from gmwm.calibration.number_verdicts import NumberVerdict
from gmwm.calibration.options import CalibrationOptions
from gmwm.calibration.result import AxisCalibration, Calibration
from gmwm.calibration.tables import in_order
from gmwm.files.readers.api import read_file, stream_file
from gmwm.files.readers.streams import Stream, is_large
from gmwm.recording.options import ReadOptions
from gmwm.recording.signals import Imu

Row = dict[str, Any]
_INFINITE = "Infinity"


def rows_of(unit: str, path: str, found: Calibration) -> list[Row]:
    """Return a row for each axis of a unit, also without calibration: `<symbol>`, `<symbol>_low`, `<symbol>_high` and
    `<symbol>_unit` in SI. For an upper limit, the value is None; for a number that must not be used, the limits too."""
    base: Row = {
        "unit": unit,
        "file": printable(path),
        "cautions": sum(remark.severity < Severity.INFO for remark in found.recording_remarks),
    }
    if found.recording is not None:
        base |= {name: getattr(found.recording, name) for name in ("sha256", "samples", "rate", "duration")}
    rows = [
        base | {"axis": axis, "status": "calibrated", **_of_axis(axis_result, found.number_verdicts[axis])}
        for axis, axis_result in found.axes.items()
    ]
    return rows + [base | {"axis": axis, "status": "failed", "reason": why} for axis, why in found.failed.items()]


def failed_row(unit: str, path: str, reason: str) -> Row:
    """Return the table row of a unit that could not be calibrated."""
    return {"unit": unit, "file": printable(path), "status": "failed", "reason": printable(reason)}


def plain(row: Row) -> Row:
    """Return a row for JSON, with infinite limits replaced by a string.

    >>> from_plain(plain({"N": 1.0, "N_high": math.inf}))
    {'N': 1.0, 'N_high': inf}
    """
    return {name: _INFINITE if value == math.inf else value for name, value in row.items()}


def from_plain(row: Mapping[str, Any]) -> Row:
    """Restore a row from the result of `plain`."""
    return {name: math.inf if value == _INFINITE else value for name, value in row.items()}


def _of_axis(found: AxisCalibration, verdicts: Mapping[str, NumberVerdict]) -> Row:
    fit = found.fit
    row: Row = {
        "model": fit.model.structure,
        "p_value": None if found.test is None else float(found.test.pvalue),
        "robust": fit.wavelet_variance.robust,
        "contaminated": None if found.verdict is None else bool(found.verdict.contaminated),
        "certified": fit.gap is not None and bool(fit.gap <= 1e-3),  # docs/validation/optimum.md
    }
    for symbol, entry in found.datasheet.items():
        bound = entry.upper_only
        row |= dict.fromkeys((symbol, f"{symbol}_low", f"{symbol}_high")) | {f"{symbol}_unit": entry.unit}
        if not verdicts[symbol].refused:
            row[symbol] = None if bound else entry.value
            row |= {f"{symbol}_low": 0.0 if bound else entry.low, f"{symbol}_high": entry.high}
    return row


TEXTS = ("unit", "axis", "status", "reason", "file", "sha256")
"""Text columns that identify a row. The columns of the recording, the model and the parameters follow them."""
LIMITS = ("", "_low", "_high", "_unit")  # suffixes of the four columns of a parameter
RUN_AGAIN = "Run the fleet again: finished units are not repeated."  # advice for a run that was not completed


def as_table(rows: Iterable[Row]) -> pl.DataFrame:
    """Make the table from rows, with fixed columns and four columns for each parameter that any row has."""
    all_rows = list(rows)
    numbers: dict[str, Any] = {
        "samples": pl.Int64, "rate": pl.Float64, "duration": pl.Float64, "model": pl.String, "p_value": pl.Float64,
        "robust": pl.Boolean, "contaminated": pl.Boolean, "certified": pl.Boolean, "cautions": pl.Int64,
    }  # fmt: skip
    schema: dict[str, Any] = dict.fromkeys(TEXTS, pl.String) | numbers
    # Many rows have the same symbols, so each distinct list of symbols is used once.
    each = [[name.removesuffix("_unit") for name in row if name.endswith("_unit")] for row in all_rows]
    for symbol in in_order([list(symbols) for symbols in dict.fromkeys(map(tuple, each))]):
        schema |= {f"{symbol}{end}": pl.String if end == "_unit" else pl.Float64 for end in LIMITS}
    # A fleet without units has an empty table with all columns.
    return pl.DataFrame({name: [row.get(name) for row in all_rows] for name in schema}, schema=schema)


def write_table(table: pl.DataFrame, path: Path) -> None:
    """Write the table to a Parquet file. If an error occurs, an existing file is unchanged."""
    require_threads(path)
    with written_whole(path) as temporary, temporary.open("wb") as file:  # Polars opens no path that is not UTF-8
        table.write_parquet(file)


def read_table(path: Path) -> pl.DataFrame:
    """Read the table from a file that `write_table` wrote."""
    if not path.is_file():
        raise ReadError(f"{path} does not exist: no run of this fleet was completed", advice=RUN_AGAIN)
    try:
        table = pl.read_parquet(BytesIO(path.read_bytes()))  # see `write_table`
    except (OSError, pl.exceptions.PolarsError) as error:
        raise ReadError(f"{path} is not the table of a fleet: {error}", advice=RUN_AGAIN) from error
    if missing := [name for name in TEXTS if name not in table.columns]:
        raise ReadError(f"{path} is not the table of a fleet: it has no column {missing[0]!r}", advice=RUN_AGAIN)
    return table


PART = "fleet"  # key of the size and time of the recording, options and table rows in the document of a unit
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
