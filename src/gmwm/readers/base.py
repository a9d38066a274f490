"""Base class of readers, and the registry that finds the reader for a file.

A format is one module in this folder: a subclass of `Reader` under `@register`. A reader recognises its files,
describes their columns before any number is read, and gives the numbers in chunks. Axes, units and the time base are
decided in `gmwm.readers.api`, for all formats alike.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from numpy.typing import NDArray

from gmwm._text import defined_anew
from gmwm.errors import OptionError, ReadError
from gmwm.remarks import Remark

HEAD_BYTES = 1 << 16
"""Number of bytes at the beginning of a file that readers use to recognise the format."""

Rows = Mapping[int, NDArray[Any]]
"""Consecutive rows of a recording: the numbers of each wanted column, float64 or int64, by its index."""


@dataclass(frozen=True)
class Channel:
    """One column of a recording, as the file or its format describes it.

    Parameters
    ----------
    name : str
        Name of the column in the file; "" if it has none.
    unit : str
        Unit by the definition of the format; "" if the format does not fix it. A unit inside `name` is found later,
        for all formats alike.
    axis : str
        "gyro_x" … "accel_z", "time" or "temperature" if the format fixes it; "" to decide by the name.
    increments : bool
        Whether a value is the integral over its sample (rad, m/s), to be multiplied by the rate.
    scale : float
        Factor from the numbers of the file to `unit`, such as the size of a count.
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
        Data of the reader, to find the numbers.
    inertial : bool
        Whether the recording is of an inertial sensor, if the file has several recordings.
    stray_time : str
        Why the time stamps in the file do not belong to this recording; "" if they do, or if there are none.
    rate_of_samples : bool
        Whether `rate` describes these samples instead of a setting of the device. gmwm warns if the time stamps show
        another rate.
    preferred : bool
        Whether this recording is read if the user chooses none, although the file has others.
    extent : (int, float) or None
        Number of samples and duration (s), if the reader knows them.
    unreadable : ReadError or None
        Why the recording cannot be read.
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

    def read_as(self, bad_lines: str, stamped: bool) -> Layout:
        """Return the layout with the options for its rows.

        Parameters
        ----------
        bad_lines : "skip" or "error"
            Whether lines that cannot be read are left out.
        stamped : bool
            Whether the time stamps are used.
        """
        return replace(self, skip_bad_lines=bad_lines == "skip", stamped=stamped)

    @property
    def named(self) -> bool:
        """Whether the columns have names."""
        return any(channel.name or channel.axis for channel in self.channels)


@dataclass(frozen=True)
class Mark:
    """Beginning of a chunk, from which a file can be read.

    Parameters
    ----------
    row : int
        Number of the first row of the chunk, from 0; the number of rows for the mark at the end.
    place : object
        Data of the reader, to find the row.
    """

    row: int
    place: Any = None


class Reader(ABC):
    """Base class of a format: recognise a file, describe its columns, and give its numbers.

    Methods take the `path` of the file; `head`, its first 64 kB; a `layout` from `layouts`; `wanted`, the indices of
    the columns, from 0; and a `mark` from `marks` to begin at. How to write a reader: docs/howto/add-a-reader.md.
    """

    name: ClassVar[str]
    """Name of the format, for the `format` option."""
    extensions: ClassVar[tuple[str, ...]]
    """Usual file name extensions, lower case, with the dot; empty for a format that only its name chooses."""
    folder_sign: ClassVar[str] = ""
    """Name of the file in a directory of this format by which it is recognised; "" if a recording is a file."""

    @abstractmethod
    def sniff(self, path: Path, head: bytes) -> float:
        """Score how well the first bytes fit the format: 1 for a signature, 0.5 for plausible content, 0 for no match.

        The content decides. If two formats match equally well, the extension decides.
        """

    @abstractmethod
    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Describe the recordings in a file: one for most formats, one for each topic of a bag."""

    @abstractmethod
    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield the numbers of the wanted columns in consecutive chunks of bounded size.

        A missing value is NaN, or `gmwm.readers.lost_samples.MISSING` in a column of integers.

        Raises
        ------
        ReadError
            If a row cannot be read; the message states its line or row.
        """

    def marks(self, path: Path, layout: Layout) -> tuple[Mark, ...]:
        """Return a mark for the beginning of each chunk and one for the end; empty if reading must start at the
        beginning."""
        return ()

    def chunks_from(self, path: Path, layout: Layout, wanted: Sequence[int], mark: Mark) -> Iterator[Rows]:
        """Yield the chunks of `chunks` from a mark on. By default, the rows before the mark are read and dropped."""
        row = 0
        for chunk in self.chunks(path, layout, wanted):
            if row >= mark.row:
                yield chunk
            row += next(iter(chunk.values())).size


R = TypeVar("R", bound=type[Reader])

_READERS: dict[str, Reader] = {}


def register(reader: R) -> R:
    """Register a format; use as a class decorator.

    A class of the same name that is defined again, as in a notebook, replaces the older one.

    Parameters
    ----------
    reader : class
        A subclass of `Reader`. Its `name` must differ from the names of the other formats; case does not count.

    Returns
    -------
    class
        The same class.

    Raises
    ------
    OptionError
        If gmwm or another class has a format of this name.
    """
    key = next((name for name in _READERS if name.casefold() == reader.name.casefold()), reader.name)
    if key in _READERS:
        older = type(_READERS[key])
        if not defined_anew(reader, older) or key != reader.name:
            raise OptionError(
                f"the name {key!r} of {reader.__qualname__} already belongs to {older.__qualname__} in "
                f"{older.__module__}",
                advice="Give the new reader another name.",
            )
    _READERS[reader.name] = reader()
    return reader


def registered() -> tuple[Reader, ...]:
    """Return all formats, in the order in which they are tried."""
    return tuple(_READERS.values())


def existing_file(path: str | os.PathLike[str]) -> Path:
    """Return the path of a file, after a check that it exists and is not empty.

    Raises
    ------
    ReadError
        If the file does not exist, is empty, or is a pipe, a device or a directory that is not a recording.
    OptionError
        If `path` is not a path.
    """
    given: object = path
    if not isinstance(given, str | os.PathLike):
        raise OptionError(
            argument="path",
            expected="the path of a file, as text or pathlib.Path",
            got=given,
            advice="For numbers in memory use `gmwm.Imu.from_arrays`." if hasattr(given, "__len__") else "",
        )
    file = Path(os.fsdecode(path))
    if file.is_dir():
        file = _sign_of(file)
    if not file.exists():
        raise ReadError(
            f"{file} does not exist in {file.absolute().parent}", code="not-found", argument="path", got=str(file)
        )
    if not file.is_file():
        raise ReadError(
            f"{file} is a pipe or a device, which cannot be read twice",
            code="not-a-file",
            advice="Save it to a file and pass the file.",
        )
    if file.stat().st_size == 0:
        raise ReadError(
            f"{file} is empty (0 bytes)", code="empty", advice="Check whether the recording was interrupted."
        )
    return file


def _sign_of(folder: Path) -> Path:
    """Return the file by which a directory is recognised as one recording."""
    for reader in _READERS.values():
        if reader.folder_sign and (folder / reader.folder_sign).is_file():
            return folder / reader.folder_sign
    raise ReadError(f"{folder} is a directory", code="is-directory", advice="Pass the path of one recording in it.")


def find_reader(path: Path, format: str | None = None) -> Reader:
    """Find the reader of a file by the name of the format or by the first bytes of the file.

    Parameters
    ----------
    path : Path
        The file; it is opened only if `format` is None.
    format : str, optional
        Name of the format; case does not count. By default, the reader that recognises the file best.

    Returns
    -------
    Reader

    Raises
    ------
    ReadError
        If the file cannot be opened, or no reader recognises it.
    OptionError
        If there is no reader of this name.
    """
    if format is not None:
        named = {name.casefold(): reader for name, reader in _READERS.items()}
        if not isinstance(format, str) or format.casefold() not in named:
            raise OptionError(argument="format", expected=f"one of {', '.join(_READERS)}", got=format)
        return named[format.casefold()]
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError as error:
        raise ReadError(
            f"{path} cannot be opened: {error.strerror}",
            code="not-readable",
            advice="Check the permissions of the file.",
        ) from error
    suffix = path.suffix.lower()
    best = max(_READERS.values(), key=lambda r: (r.sniff(path, head), suffix in r.extensions))
    if best.sniff(path, head) > 0:
        return best
    known = "; ".join(f"{r.name} ({', '.join(r.extensions)})" for r in _READERS.values() if r.extensions)
    begin = " ".join(f"{byte:02x}" for byte in head[:8])
    raise ReadError(
        f"{path} begins with the bytes {begin}, which none of the formats has: {known}",
        code="unknown-format",
        advice="Export it as CSV, or name its format with {--format}.",
    )
