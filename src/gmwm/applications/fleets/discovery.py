"""Find the recordings of a fleet, and name its units."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import NoReturn

from gmwm.base.errors import OptionError
from gmwm.base.text import printable
from gmwm.files.contract import HEAD_BYTES
from gmwm.files.readers import registered
from gmwm.files.readers.topics import sensor_topics, topic_folder
from gmwm.recording.options import ReadOptions

FILE = "fleet.json"
"""Name of the file that marks the output folder of a fleet."""
Recordings = str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | Mapping[str, str | os.PathLike[str]]


@dataclass(frozen=True)
class FleetUnits:
    """Recordings of a fleet by unit, and the files of the folder that are not recordings."""

    paths: Mapping[str, Path]  # by unit
    left_out: tuple[str, ...] = ()  # files that no reader recognizes, pipes and devices
    # name of the recording inside its file, for units whose file contains several recordings
    topics: Mapping[str, str] = field(default_factory=dict)

    def by_topic(self, reading: ReadOptions) -> FleetUnits:
        """Return the fleet with a unit `file/topic`, such as `log.bin/IMU_1`, for each inertial recording of a file. If
        a file has recordings with all six axes, its other recordings are left out, because they repeat some of these
        axes. If the user chose a topic, only this recording of each file is used."""
        if reading.topic is not None:
            return self
        paths, topics = dict[str, Path](), dict[str, str]()
        for unit, path in self.paths.items():
            try:
                several = sensor_topics(path, reading.format)
            except Exception:  # Also an error of a library: it is reported when the unit is read.
                several = ()
            if len(several) < 2:
                paths[unit] = path
                continue
            for topic in several:
                name = f"{unit}/{topic_folder(topic)}"
                while name in paths:
                    name += "_"
                paths[name], topics[name] = path, topic
        _check_names(paths)
        return FleetUnits(paths, self.left_out, topics)


def find_units(recordings: Recordings, output: Path, pattern: str | None) -> FleetUnits:
    """Find the units of a fleet. `pattern` selects the files of a folder."""
    if isinstance(recordings, str | os.PathLike):
        return _in_folder(Path(recordings).absolute(), output.absolute(), pattern)
    if pattern is not None:
        raise OptionError(argument="pattern", expected="left out unless recordings is a folder", got=pattern)
    if isinstance(recordings, Mapping):
        paths = {str(unit): Path(path).absolute() for unit, path in recordings.items()}
    elif isinstance(recordings, Sequence):
        paths = _name_by_path([Path(path).absolute() for path in recordings])
    else:
        raise OptionError(
            argument="recordings", expected="a folder, a sequence of paths or a mapping of unit to path", got=recordings
        )
    if not paths:
        raise OptionError(argument="recordings", expected="at least one recording", got=recordings)
    _check_names(paths)
    return FleetUnits(paths)


def _in_folder(folder: Path, output: Path, pattern: str | None) -> FleetUnits:
    if not folder.is_dir():
        advice = "Pass a single file as a list." if folder.exists() else ""
        raise OptionError(argument="recordings", expected="an existing folder", got=str(folder), advice=advice)
    paths: dict[str, Path] = {}
    left_out: list[str] = []
    for path in _walk(folder, output):
        try:
            is_folder = path.is_dir()
            unit = printable(path.relative_to(folder).as_posix())
            if path.exists() and not path.is_file() and not is_folder:
                left_out.append(unit)  # it is a pipe or a device
                continue
        except OSError as error:  # its folder can be listed, but not entered
            _raise_unreadable(error)
        if pattern is not None:
            # A pattern with a slash is compared with the path, other patterns with the file name.
            if fnmatchcase(unit if "/" in pattern else path.name, pattern):
                paths[unit] = path
        elif is_folder or _is_recording(path):
            paths[unit] = path
        else:
            left_out.append(unit)
    if not paths:
        if pattern is not None:
            raise OptionError(argument="pattern", expected=f"the pattern of some file in {folder}", got=pattern)
        raise OptionError(
            argument="recordings", expected="a folder with files that a reader knows", got=str(folder),
            advice="Choose the files with {--pattern}.",
        )  # fmt: skip
    _check_names(paths)
    return FleetUnits(dict(sorted(paths.items())), tuple(sorted(left_out)))


def _walk(folder: Path, output: Path) -> Iterator[Path]:
    """Yield all files below a folder, and subfolders that are a recording, except hidden files and fleet outputs."""
    signs = {reader.folder_sign for reader in registered()} - {""}
    for name, folders, files in os.walk(folder, onerror=_raise_unreadable):
        here = Path(name)
        if here == output or FILE in files:
            folders.clear()
        elif here != folder and signs & set(files):
            folders.clear()
            yield here
        else:
            folders[:] = [folder_name for folder_name in folders if not folder_name.startswith(".")]
            yield from (here / file for file in files if not file.startswith("."))


def _raise_unreadable(error: OSError) -> NoReturn:
    """Raise an error for an unreadable folder, because its units would be missing from the fleet."""
    raise OptionError(
        f"{error.filename} cannot be read: {error.strerror}", argument="recordings", got=str(error.filename),
        advice="Change the permissions, or pass the recordings one by one.",
    ) from error  # fmt: skip


def _is_recording(path: Path) -> bool:
    """Return whether a file is a recording, by its name or content. A text file needs a known extension. A file that
    cannot be opened counts as a recording, so that the reason is reported."""
    for reader in registered():
        # The file that marks a folder as a recording is not a recording itself. A .yaml file may contain anything.
        if path.suffix.lower() in set(reader.extensions) - {Path(reader.folder_sign).suffix}:
            return True
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError:
        return True
    sure = max(reader.sniff(path, head) for reader in registered())
    # The reader may be able to read the file, see `Reader.sniff`.
    return sure > 0.5 or (sure == 0.5 and not path.suffix)


def _name_by_path(paths: Sequence[Path]) -> dict[str, Path]:
    """Name recordings by their paths relative to the deepest folder that contains all of them."""
    if not paths:
        return {}
    try:
        common = Path(os.path.commonpath([path.parent for path in paths]))
    except ValueError as error:  # the paths are on different drives
        raise OptionError(
            "the recordings are on different drives", advice="Name the units: pass a mapping of unit to path."
        ) from error
    named = {printable(path.relative_to(common).as_posix()): path for path in paths}
    if len(named) < len(paths):
        twice = next(str(path) for k, path in enumerate(paths) if path in paths[:k])
        raise OptionError(argument="recordings", expected="different paths", got=twice)
    return named


def _check_names(units: Mapping[str, Path]) -> None:
    """Check that each name is a valid path inside the output folder, and that no result would overwrite another."""
    for unit in units:
        parts = PurePosixPath(unit)
        if not unit or "\0" in unit or parts.is_absolute() or ".." in parts.parts or parts.as_posix() != unit:
            expected = "named by paths inside a folder, such as 'lot 7/unit 12'"
            raise OptionError(argument="recordings", expected=expected, got=unit)
        for above in map(str, parts.parents):
            if above.endswith(".json") and above.removesuffix(".json") in units:
                raise OptionError(
                    f"the units {above.removesuffix('.json')!r} and {unit!r} would have the same path {above}",
                    advice="Name the units: pass a mapping of unit to path.",
                )
