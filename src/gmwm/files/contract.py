"""Contract between formats and the reading of files: what a reader is, and the registry that finds one for a file.

A reader recognises files, describes their columns, and yields numbers in chunks. gmwm's are in `gmwm/files/formats`,
others are entry points "gmwm.readers". `gmwm.files.readers` treats all formats alike."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from numpy.typing import NDArray

from gmwm.base.errors import OptionError, ReadCode, ReadError
from gmwm.base.extras import admit_guests
from gmwm.base.remarks import Remark
from gmwm.base.text import defined_anew

CHUNK_ROWS = 1 << 16  # number of rows of a text in a chunk, which take 4 MB for six axes
HEAD_BYTES = 1 << 16  # number of bytes at the beginning of a file that readers use to recognise the format

Rows = Mapping[int, NDArray[Any]]
"""Consecutive rows: the index of each wanted column, and its numbers (float64 or int64)."""


def damage_error(what: str, code: ReadCode = "damaged") -> ReadError:
    """Return the error for a file whose bytes are damaged or cut off."""
    return ReadError(what, code=code, advice="Copy the file again.")


@dataclass(frozen=True)
class Channel:
    """One column of a recording, as the file or its format describes it.

    Parameters
    ----------
    name : str
        Name of the column in the file; "" if it has none.
    unit : str
        Unit if the format defines it; "" otherwise. A unit in `name` is recognised later, in the same way for every
        format.
    axis : str
        "gyro_x" … "accel_z", "time" or "temperature" if the format defines it, "spare" if only the user can choose the
        column; "" if the name decides.
    increments : bool
        Whether the values are integrals over the sample interval (rad, m/s). gmwm multiplies them by the rate.
    scale : float
        Factor that converts the numbers in the file to `unit`, such as the size of a count.
    """

    name: str
    unit: str = ""
    axis: str = ""
    increments: bool = False
    scale: float = 1.0


@dataclass(frozen=True)
class Layout:
    """Description of one recording in a file, before any number is read.

    Parameters
    ----------
    channels : tuple of Channel
        The columns in their order; empty if `unreadable`.
    first_row : tuple of str
        The first row of numbers as text, for messages.
    topic : str
        Name of the recording, if the file has several; "" otherwise.
    rate : float or None
        Samples per second (Hz), if the file states it.
    units : mapping
        Units that the file states for a whole quantity: "gyro", "accel" or "time".
    remarks : tuple of Remark
        Remarks on how gmwm reads the file.
    state : object
        Data with which the reader finds the numbers.
    inertial : bool
        Whether the recording is of an inertial sensor, if the file has several recordings.
    stray_time : str
        Reason why the time stamps in the file do not belong to this recording; "" if they do, or if there are none.
    rate_of_samples : bool
        Whether `rate` describes these samples instead of a setting of the device. gmwm warns if the time stamps show
        another rate.
    preferred : bool
        Whether this recording is read if the user chooses none, although the file has others.
    extent : (int, float) or None
        Number of samples and duration (s), if the reader knows them.
    unreadable : ReadError or None
        The error to raise if the recording cannot be read; None otherwise.
    skip_bad_lines : bool
        Whether lines that cannot be read become rows of missing values instead of an error.
    stamped : bool
        Whether the time stamps of the recording are used.
    """

    channels: tuple[Channel, ...]
    first_row: tuple[str, ...] = ()
    topic: str = ""
    rate: float | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    remarks: tuple[Remark, ...] = ()
    state: Any = None
    inertial: bool = True
    stray_time: str = ""
    rate_of_samples: bool = False
    preferred: bool = False
    extent: tuple[int, float] | None = None
    unreadable: ReadError | None = None
    skip_bad_lines: bool = False
    stamped: bool = True

    @property
    def named(self) -> bool:
        """Whether the columns have names."""
        return any(channel.name or channel.axis for channel in self.channels)


@dataclass(frozen=True)
class Mark:
    """A position in a file from which rows can be read: the beginning of a chunk.

    Parameters
    ----------
    row : int
        Number of the first row of the chunk, from 0. For the mark at the end of the file, the number of rows.
    place : object
        Data with which the reader finds the row.
    """

    row: int
    place: Any = None


class Reader(ABC):
    """Base class of readers. A reader recognises files of one format, describes their columns, and yields their
    numbers.

    The methods take the `path` of the file; `head`, its first 64 kB; `layout`, a result of `layouts`; `wanted`, the
    indices of the columns (from 0); and `mark`, a result of `marks` at which reading begins. The page
    docs/contributing/add-a-reader.md shows how to write a reader."""

    name: ClassVar[str]
    """Name of the format, for the `format` option."""
    extensions: ClassVar[tuple[str, ...]] = ()
    """Usual file name extensions, lower case, with the dot; empty if the user must name the format."""
    folder_sign: ClassVar[str] = ""
    """Name of the file that identifies the format of a directory; "" if a recording is a file."""
    single: ClassVar[bool] = False
    """Whether every file of the format holds exactly one recording, so that nobody opens it to look for others."""

    signatures: ClassVar[tuple[bytes, ...]] = ()
    """First bytes of the files, for `sniff`."""

    def sniff(self, path: Path, head: bytes) -> float:
        """Score how well the first bytes fit the format: 1 for a signature, 0.5 for plausible content, 0 for no match,
        as for every file of a format without signatures, which the user names.

        The content decides. If two formats match equally well, the extension decides."""
        return float(head.startswith(self.signatures))

    @abstractmethod
    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Describe the recordings in a file: one for most formats, one for each topic of a bag."""

    @abstractmethod
    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield the numbers of the wanted columns in consecutive chunks of bounded size.

        A missing value is NaN, or `gmwm.readers.MISSING` in a column of integers.

        Raises
        ------
        ReadError
            If a row cannot be read; the message states its line or row.
        """

    def marks(self, path: Path, layout: Layout) -> tuple[Mark, ...]:
        """Return a mark for the beginning of each chunk and one for the end of the file. The tuple is empty if reading
        must start at the beginning of the file."""
        return ()

    def chunks_from(self, path: Path, layout: Layout, wanted: Sequence[int], mark: Mark) -> Iterator[Rows]:
        """Yield the same chunks as `chunks`, from a mark on. By default, the rows before the mark are read and
        discarded."""
        row = 0
        for chunk in self.chunks(path, layout, wanted):
            if row >= mark.row:
                yield chunk
            row += next(iter(chunk.values())).size


R = TypeVar("R", bound=type[Reader])

_READERS: dict[str, Reader] = {}


def register(reader: R) -> R:
    """Register a format; use as a class decorator.

    If a class is defined again, as in a notebook, it replaces the older class.

    Parameters
    ----------
    reader : class
        A subclass of `Reader`. Its `name` must differ from the names of the other formats by more than upper and lower
        case.

    Raises
    ------
    OptionError
        If another class has already registered a format of this name.
    """
    readers = _loaded_formats()
    key = next((name for name in readers if name.casefold() == reader.name.casefold()), reader.name)
    if key in readers:
        older = type(readers[key])
        if not defined_anew(reader, older) or key != reader.name:
            raise OptionError(
                f"the name {key!r} of {reader.__qualname__} already belongs to {older.__qualname__} in "
                f"{older.__module__}",
                advice="Give the new reader another name.",
            )
    readers[reader.name] = reader()
    return reader


def registered() -> tuple[Reader, ...]:
    """Return the readers of all formats, those of other packages included, in the order in which they are tried."""
    return tuple(_with_guests().values())


def without_guests() -> tuple[Reader, ...]:
    """Return the readers without those of other packages that have not been needed yet."""
    return tuple(_loaded_formats().values())


def _loaded_formats() -> dict[str, Reader]:
    """Import the formats of gmwm, which register themselves, and return the registry."""
    import_module("gmwm.files.formats")
    return _READERS


def _with_guests() -> dict[str, Reader]:
    """Register the formats of other packages too. Their entry points name subclasses of `Reader`."""
    _loaded_formats()
    admit_guests("gmwm.readers", _admit)
    return _READERS


def _admit(name: str, reader: Any) -> None:
    if not (isinstance(reader, type) and issubclass(reader, Reader)):
        raise TypeError(f"{name} is not a subclass of gmwm.readers.Reader")
    register(reader)


def existing_file(path: str | os.PathLike[str]) -> Path:
    """Return the path of a file that exists and is not empty, or the identifying file of a directory."""
    argument: object = path
    if not isinstance(argument, str | os.PathLike):
        raise OptionError(
            argument="path", expected="the path of a file, as text or pathlib.Path", got=argument,
            advice="For numbers in memory use `gmwm.Imu.from_arrays`." if hasattr(argument, "__len__") else "",
        )  # fmt: skip
    file = Path(os.fsdecode(path))
    if file.is_dir():
        file = _sign_of(file)
    if str(file) == "-":
        raise ReadError(
            "- is standard input, which only `gmwm watch` and `gmwm monitor` read", code="not-found", argument="path",
            got="-", advice="Save it in a file.",
        )  # fmt: skip
    if not file.exists():
        raise ReadError(
            f"{file} does not exist in {file.absolute().parent}", code="not-found", argument="path", got=str(file)
        )
    if not file.is_file():
        raise ReadError(
            f"{file} is a pipe or a device, which cannot be read twice", code="not-a-file",
            advice="Save it to a file and pass the file.",
        )  # fmt: skip
    if file.stat().st_size == 0:
        raise ReadError(
            f"{file} is empty (0 bytes)", code="empty", advice="Check whether the recording was interrupted."
        )
    return file


_DATA_SETS = (
    "mav0/imu0/data.csv", "imu0/data.csv", "data.csv", "oxts/timestamps.txt", "ms25.csv", "sensor_data/xsens_imu.csv",
    "accelerometer.txt",
)  # fmt: skip
"""Inertial data of EuRoC, TUM VI, KITTI, NCLT, KAIST Urban, TUM RGB-D; others (M2DGR) have a bag beside."""


def _sign_of(folder: Path) -> Path:
    """Return the file that identifies a directory as one recording."""
    for readers in (_loaded_formats, _with_guests):
        for reader in readers().values():
            if reader.folder_sign and (folder / reader.folder_sign).is_file():
                return folder / reader.folder_sign
    data_set = next((folder / name for name in _DATA_SETS if (folder / name).is_file()), None)
    logs = sorted(path for path in folder.iterdir() if path.suffix.lower() in (".bag", ".mcap", ".db3", ".ulg"))
    if data_set is None and len(logs) != 1:
        names = ", ".join(path.name for path in logs[:5])
        raise ReadError(
            f"{folder} is a directory" + (f" with {len(logs)} recordings: {names}" if logs else ""),
            code="is-directory", advice="Pass the path of one recording in it.",
        )  # fmt: skip
    return data_set or logs[0]


def find_reader(path: Path, format: str | None = None) -> Reader:
    """Find the reader of a file by the name of the format or by the first bytes of the file.

    Formats of other packages are tried too, unless a format of gmwm recognises its signature.

    Parameters
    ----------
    path : Path
        The file; it is opened only if `format` is None.
    format : str, optional
        Name of the format, in upper or lower case. By default, the reader with the highest score is chosen.

    Raises
    ------
    ReadError
        If the file cannot be opened, or no reader recognises it.
    OptionError
        If there is no reader of this name.
    """
    if format is not None:
        for readers in (_loaded_formats, _with_guests):
            for name, reader in readers().items():
                if isinstance(format, str) and name.casefold() == format.casefold():
                    return reader
        raise OptionError(argument="format", expected=f"one of {', '.join(_READERS)}", got=format)
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError as error:
        raise ReadError(
            f"{path} cannot be opened: {error.strerror}", code="not-readable",
            advice="Check the permissions of the file.",
        ) from error  # fmt: skip
    suffix = path.suffix.lower()
    for readers in (_loaded_formats, _with_guests):
        score, _, reader = max(
            ((reader.sniff(path, head), suffix in reader.extensions, reader) for reader in readers().values()),
            key=lambda entry: entry[:2],
        )
        if score >= 1:
            return reader
    if score > 0:
        return reader
    formats = "; ".join(f"{r.name} ({', '.join(r.extensions)})" for r in _READERS.values() if r.extensions)
    begin = " ".join(f"{byte:02x}" for byte in head[:8])
    raise ReadError(
        f"{path} begins with the bytes {begin}, which none of the formats has: {formats}", code="unknown-format",
        advice="Export it as CSV, or name its format with {--format}.",
    )  # fmt: skip
