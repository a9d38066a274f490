"""Which recordings a fleet has: all in a folder, or those that are named; and what its units are called."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath

from gmwm.errors import OptionError
from gmwm.readers import registered
from gmwm.readers.base import HEAD_BYTES

FILE = "fleet.json"
"""Stands in the folder that a fleet is written to."""
_PLAUSIBLE = 0.5
"""What a reader says of a file that may be its own, see `Reader.sniff`."""
Recordings = str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | Mapping[str, str | os.PathLike[str]]


@dataclass(frozen=True)
class FleetUnits:
    """The recordings of a fleet by the names of their units, and the files beside them that are none."""

    paths: Mapping[str, Path]
    left_out: tuple[str, ...] = ()


def find_units(recordings: Recordings, output: Path, pattern: str | None) -> FleetUnits:
    """The units of a fleet; `pattern` is of files in a folder."""
    if isinstance(recordings, str | os.PathLike):
        return _in_folder(Path(recordings).absolute(), output.absolute(), pattern)
    if pattern is not None:
        raise OptionError(f"pattern={pattern!r} is of the files in a folder; leave it out where recordings are named")
    if isinstance(recordings, Mapping):
        paths = {str(unit): Path(path).absolute() for unit, path in recordings.items()}
    elif isinstance(recordings, Sequence):
        paths = _named([Path(path).absolute() for path in recordings])
    else:
        raise OptionError(
            "recordings must be a folder, a sequence of paths or a mapping of unit to path, got "
            f"{type(recordings).__name__}"
        )
    if not paths:
        raise OptionError("recordings must name one recording at least, got none")
    _check_names(paths)
    return FleetUnits(paths)


def _in_folder(folder: Path, output: Path, pattern: str | None) -> FleetUnits:
    if not folder.is_dir():
        what = "is a file; pass it as [path]" if folder.exists() else "does not exist"
        raise OptionError(f"recordings must be a folder, {folder} {what}")
    paths: dict[str, Path] = {}
    left_out: list[str] = []
    for path in _walk(folder, output):
        unit = path.relative_to(folder).as_posix()
        if pattern is not None:
            # A pattern with a folder in it is one of paths.
            if fnmatchcase(unit if "/" in pattern else path.name, pattern):
                paths[unit] = path
        elif path.is_dir() or _is_recording(path):
            paths[unit] = path
        else:
            left_out.append(unit)
    if not paths:
        wanted = "that a reader knows" if pattern is None else f"that fit the pattern {pattern!r}"
        raise OptionError(f"recordings must be a folder with recordings, {folder} has no files {wanted}")
    _check_names(paths)
    return FleetUnits(dict(sorted(paths.items())), tuple(sorted(left_out)))


def _walk(folder: Path, output: Path) -> Iterator[Path]:
    """All files beneath, and folders that are one recording; hidden ones and what fleets wrote are passed over."""
    signs = {reader.folder_sign for reader in registered()} - {""}
    for name, folders, files in os.walk(folder):
        here = Path(name)
        if here == output or FILE in files:
            folders.clear()
        elif here != folder and signs & set(files):
            folders.clear()
            yield here
        else:
            folders[:] = [one for one in folders if not one.startswith(".")]
            yield from (here / file for file in files if not file.startswith("."))


def _is_recording(path: Path) -> bool:
    """Whether the name or the content says that a file should be a recording; if it is none then, its unit fails.

    Of what is merely text only the name tells.
    """
    for reader in registered():
        # What stands for a folder is no recording by itself, and .yaml may be anything.
        if path.suffix.lower() in set(reader.extensions) - {Path(reader.folder_sign).suffix}:
            return True
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError:
        return False
    sure = max(reader.sniff(path, head) for reader in registered())
    return sure > _PLAUSIBLE or (sure == _PLAUSIBLE and not path.suffix)


def _named(paths: Sequence[Path]) -> dict[str, Path]:
    """Recordings by what follows the folder that they have in common."""
    if not paths:
        return {}
    try:
        common = Path(os.path.commonpath([path.parent for path in paths]))
    except ValueError as error:  # on drives of their own
        raise OptionError("recordings must lie on one drive; or name their units: a mapping of unit to path") from error
    named = {path.relative_to(common).as_posix(): path for path in paths}
    if len(named) < len(paths):
        twice = next(str(path) for k, path in enumerate(paths) if path in paths[:k])
        raise OptionError(f"recordings must name each recording once, {twice} is named twice")
    return named


def _check_names(units: Mapping[str, Path]) -> None:
    """A unit's name is that of its file beneath the output folder: it stays there, and no other is in its way."""
    for unit in units:
        parts = PurePosixPath(unit)
        if not unit or "\0" in unit or parts.is_absolute() or ".." in parts.parts or parts.as_posix() != unit:
            raise OptionError(f"the name of a unit must be a path beneath a folder, as 'lot 7/unit 12'; got {unit!r}")
        for above in map(str, parts.parents):
            if above.endswith(".json") and above.removesuffix(".json") in units:
                raise OptionError(
                    f"the units {above.removesuffix('.json')!r} and {unit!r} would both be written to {above}; name "
                    "the units yourself: a mapping of unit to path"
                )
