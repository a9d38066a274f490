"""The contract of a reader, and the registry by which a file finds the one that understands it.

A format is one file in this folder: a subclass of `Reader` under `@register`. It says which files are its
own, what their columns are before a number is read, and gives the numbers in chunks. Everything else, from
names and units to the time base, is decided once for all formats in `gmwm.readers.api`.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from numpy.typing import NDArray

from gmwm._text import defined_anew
from gmwm.errors import OptionError, ReadError

HEAD_BYTES = 1 << 16
"""How much of a file a reader sees when it is asked whether the file is its own."""

Rows = Mapping[int, NDArray[Any]]
"""Consecutive rows of a file: the values of each wanted column by its number, float64 or int64."""


@dataclass(frozen=True)
class Channel:
    """One column of a recording, as the file or its format describes it.

    Parameters
    ----------
    name : str
        Name of the column in the file; "" where the file names none.
    unit : str
        Unit by the format's own definition; "" where the format leaves it open. (A unit written in `name`
        is found later, for all formats alike.)
    axis : str
        "gyro_x" … "accel_z", "time" or "temperature" where the format fixes it; "" to go by the name.
    increments : bool
        Whether a value is the integral over its sample (rad, m/s), to be multiplied by the rate.
    scale : float
        What a number of the file is to be multiplied by before `unit` holds: counts to units.
    """

    name: str
    unit: str = ""
    axis: str = ""
    increments: bool = False
    scale: float = 1.0


@dataclass(frozen=True)
class Layout:
    """What a file says of one recording in it before a number is read.

    Parameters
    ----------
    channels : tuple of Channel
        The columns in their order.
    first_row : tuple of str
        The first row of numbers as text, for messages.
    topic : str
        Which recording of the file this is; "" where there is only one.
    rate : float or None
        Samples per second (Hz) where the format states it.
    units : mapping
        Units that the file states for a whole quantity: "gyro", "accel" or "time".
    notes : tuple of str
        What was understood, in plain words.
    state : object
        What the reader itself needs to find the numbers.
    inertial : bool
        Of several recordings in one file, whether this is one of an inertial sensor, by what the file says.
    stray_time : str
        Why stamps in the file cannot be this recording's, though it has none and no other column has their length.
    rate_of_samples : bool
        Whether `rate` is said of these very samples, not of a device's setting: stamps that say another are warned of.
    """

    channels: tuple[Channel, ...]
    first_row: tuple[str, ...] = ()
    topic: str = ""
    rate: float | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    state: Any = None
    inertial: bool = True
    stray_time: str = ""
    rate_of_samples: bool = False

    @property
    def named(self) -> bool:
        """Whether the columns have names."""
        return any(channel.name or channel.axis for channel in self.channels)


@dataclass(frozen=True)
class Mark:
    """Where a chunk of a recording begins: a file can be read from there on.

    Parameters
    ----------
    row : int
        Number of its first row, from 0; of the mark at the end how many rows there are.
    place : object
        What the reader itself needs to find it.
    """

    row: int
    place: Any = None


class Reader(ABC):
    """A format: who it is, which files are its own, and how their numbers come out.

    Methods take the `path` of the file; `head`, its first 64 kB; a `layout` that `layouts` found; `wanted`, the
    numbers of the columns, from 0; and a `mark` of `marks` to begin at. How to write one: docs/howto/add-a-reader.md.
    """

    name: ClassVar[str]
    """Name of the format, for `gmwm.read(…, format=)`."""
    extensions: ClassVar[tuple[str, ...]]
    """Usual file name extensions, lower case, with the dot; none for a format that only its name chooses."""
    folder_sign: ClassVar[str] = ""
    """Name of the file that stands for a directory in this format; "" where a recording is one file."""

    @abstractmethod
    def sniff(self, path: Path, head: bytes) -> float:
        """How well the first bytes of a file fit: 1 a signature, 0.5 plausible, 0 no.

        The content decides; the extension breaks a tie.
        """

    @abstractmethod
    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """The recordings in a file; one for most formats, one for each topic of a bag."""

    @abstractmethod
    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """The numbers of the wanted columns in consecutive chunks of bounded size.

        Raises
        ------
        ReadError
            At a cell that is missing or is no number, with its line.
        """

    def marks(self, path: Path, layout: Layout) -> tuple[Mark, ...]:
        """Where the chunks begin, and a last mark at the end; none for a format that is only read from its begin."""
        return ()

    def chunks_from(self, path: Path, layout: Layout, wanted: Sequence[int], mark: Mark) -> Iterator[Rows]:
        """The chunks from a mark on, those that `chunks` gives; by default what comes before is read and dropped."""
        row = 0
        for chunk in self.chunks(path, layout, wanted):
            if row >= mark.row:
                yield chunk
            row += next(iter(chunk.values())).size


R = TypeVar("R", bound=type[Reader])

_READERS: dict[str, Reader] = {}


def register(reader: R) -> R:
    """Add the format `reader`; use as a class decorator.

    A class that is defined anew, as in a notebook, takes the place of the older one.

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
                f"there is already a reader named {key!r}, {older.__qualname__} in {older.__module__}; give "
                f"{reader.__qualname__} another name"
            )
    _READERS[reader.name] = reader()
    return reader


def registered() -> tuple[Reader, ...]:
    """All formats, in the order in which they are tried."""
    return tuple(_READERS.values())


def existing_file(path: str | os.PathLike[str]) -> Path:
    """The path of a file that is there and is not empty, or an error that says what is wrong with it."""
    if not isinstance(path, str | os.PathLike):
        raise OptionError(
            f"path must be the path of a file, as text or pathlib.Path; got {type(path).__name__}"
            + ("; for numbers in memory there is Imu.from_arrays" if hasattr(path, "__len__") else "")
        )
    file = Path(os.fsdecode(path))
    if file.is_dir():
        file = _sign_of(file)
    if not file.exists():
        raise ReadError(f"{file} does not exist; looked in {file.absolute().parent}")
    if not file.is_file():
        raise ReadError(f"{file} is a pipe or a device, which cannot be read twice; save it to a file and pass that")
    if file.stat().st_size == 0:
        raise ReadError(f"{file} is empty (0 bytes); was the recording interrupted?")
    return file


def _sign_of(folder: Path) -> Path:
    """The file that stands for a directory which is one recording."""
    for reader in _READERS.values():
        if reader.folder_sign and (folder / reader.folder_sign).is_file():
            return folder / reader.folder_sign
    raise ReadError(f"{folder} is a directory; pass the path of one recording in it")


def find_reader(path: Path, format: str | None = None) -> Reader:
    """The reader of the file `path`: the one named `format`, or the one whose signs its first bytes show."""
    if format is not None:
        named = {name.casefold(): reader for name, reader in _READERS.items()}
        if not isinstance(format, str) or format.casefold() not in named:
            raise OptionError(f"format must be one of {', '.join(_READERS)}; got {format!r}")
        return named[format.casefold()]
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError as error:
        raise ReadError(f"{path} cannot be opened: {error.strerror}") from error
    suffix = path.suffix.lower()
    best = max(_READERS.values(), key=lambda r: (r.sniff(path, head), suffix in r.extensions))
    if best.sniff(path, head) > 0:
        return best
    known = "; ".join(f"{r.name} ({', '.join(r.extensions)})" for r in _READERS.values() if r.extensions)
    begin = " ".join(f"{byte:02x}" for byte in head[:8])
    raise ReadError(
        f"{path} is in none of the formats known here: {known}. It begins with the bytes {begin}; "
        "export it as CSV, or pass format= if it is one of them after all"
    )
