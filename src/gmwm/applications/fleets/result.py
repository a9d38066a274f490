"""The recordings of a fleet, the result of `fleet`, and the folder that stores it."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, NoReturn

from gmwm.applications.fleets.unit_job import PART, RUN_AGAIN, Row, UnitOptions, from_plain, read_table, stamp_of
from gmwm.base.atomic_files import read_json, write_text
from gmwm.base.errors import DataError, OptionError, ReadError
from gmwm.base.lazy import polars
from gmwm.base.remarks import Dialect, Remark, sorted_remarks
from gmwm.base.results import Plotted, register
from gmwm.base.text import Summarised, printable, version
from gmwm.calibration.document import FORMAT as CALIBRATION
from gmwm.calibration.document import VERSION as CALIBRATION_VERSION
from gmwm.calibration.document import read_document, require_format
from gmwm.calibration.options import CalibrationOptions
from gmwm.calibration.recording_info import Recording
from gmwm.calibration.result import Calibration
from gmwm.files.contract import HEAD_BYTES
from gmwm.files.readers import registered
from gmwm.files.readers.topics import sensor_topics, topic_folder
from gmwm.recording.options import ReadOptions

if TYPE_CHECKING:
    from gmwm.applications.fleets.statistics_result import FleetStatistics


FILE = "fleet.json"  # name of the file that marks the output folder of a fleet
Recordings = str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | Mapping[str, str | os.PathLike[str]]


@dataclass(frozen=True)
class FleetUnits:
    """Recordings of a fleet by unit, and the files of the folder that are not recordings."""

    paths: Mapping[str, Path]  # by unit
    left_out: tuple[str, ...] = ()  # files that no reader recognizes, pipes and devices
    # name of the recording inside its file, for units whose file contains several recordings
    topics: Mapping[str, str] = field(default_factory=dict)

    def by_topic(self, reading: ReadOptions) -> FleetUnits:
        """Return the fleet with a unit `file/topic`, such as `log.bin/IMU_1`, for each inertial recording, or the
        chosen topic. Recordings with all six axes replace others of the file, which repeat some of their axes."""
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
        folder = Path(recordings).absolute()
        if folder.exists() and output.exists() and folder.samefile(output):
            raise OptionError(argument="output", expected="another folder than that of the recordings", got=str(output))
        if (folder / FILE).exists():
            raise OptionError(argument="recordings", expected="a folder that no fleet was written to", got=str(folder))
        return _in_folder(folder, output.absolute(), pattern)
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
    """Return whether a file is a recording, by name or content; unreadable ones are, so the reason is reported."""
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


FORMAT = "gmwm-fleet"
VERSION = 1  # Version of fleet.json; gmwm reads no other. Adding a key does not change the version.
TABLE = "fleet.parquet"
UNITS = "units"


def unit_file(folder: Path, unit: str) -> Path:
    """Return the path of the file with the calibration of a unit."""
    return folder / UNITS / f"{unit}.json"


def write_unit(folder: Path, unit: str, document: str) -> None:
    """Write the calibration of a unit. If an error occurs, an existing file is unchanged."""
    file = unit_file(folder, unit)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_text(file, document)


def remove_unit(folder: Path, unit: str) -> None:
    """Remove the outdated calibration of a unit that an earlier run stored and that has now failed."""
    unit_file(folder, unit).unlink(missing_ok=True)


def foreign_units(folder: Path, units: Mapping[str, Path]) -> list[str]:
    """Return the names of units that have a result in the folder but are not in this fleet."""
    inside = folder / UNITS
    stored = (str(file.relative_to(inside).as_posix()).removesuffix(".json") for file in inside.rglob("*.json"))
    return sorted(unit for unit in stored if unit not in units)


def finished_rows(folder: Path, unit: str, path: Path, options: UnitOptions) -> list[Row] | None:
    """Return the table rows of a unit that was calibrated from the same recording with the same options, or None."""
    try:
        content = read_json(unit_file(folder, unit))
        if content["format"] != CALIBRATION or content["version"] != CALIBRATION_VERSION:
            return None
        provenance = content[PART]
        if any(provenance[name] != value for name, value in options.to_dict().items()):
            return None
        if not _is_same(path, provenance, content["recording"]):
            return None
        return [from_plain(row) | {"unit": unit, "file": printable(str(path))} for row in provenance["rows"]]
    except (OSError, ValueError, KeyError, TypeError, AttributeError, ReadError):
        return None  # the file is missing, incomplete, or of another kind


def _is_same(path: Path, made: Mapping[str, Any], recording: Mapping[str, Any]) -> bool:
    """Return whether a recording is unchanged. If only its modification time differs, the checksums are compared."""
    stamp = stamp_of(path)
    if stamp["size"] != made["size"]:
        return False
    if stamp["modified_ns"] == made["modified_ns"]:
        return True
    digest = recording["sha256"]
    return digest is not None and Recording.from_dict(recording).of_file(path).sha256 == digest


def write_facts(folder: Path, found: FleetUnits, options: UnitOptions) -> None:
    """Write fleet.json, with the units and the options of the fleet."""
    content = {
        "format": FORMAT, "version": VERSION, "gmwm": version(), **options.to_dict(),
        "units": {unit: str(path) for unit, path in found.paths.items()}, "topics": dict(found.topics),
        "left_out": list(found.left_out),
    }  # fmt: skip
    write_text(folder / FILE, json.dumps(content, allow_nan=False, ensure_ascii=False, indent=1) + "\n")


def read_facts(folder: Path) -> Mapping[str, Any]:
    """Read fleet.json."""
    file = folder / FILE
    if not file.is_file():
        raise ReadError(
            f"{folder} is not the folder of a fleet: it has no {FILE}", advice="Pass the output folder of `gmwm fleet`."
        )
    content: Mapping[str, Any] = read_document(file, "fleet", RUN_AGAIN)
    try:
        require_format(content, "fleet", FORMAT, VERSION, advice=RUN_AGAIN, anew="Run the fleet again.")
    except ReadError as error:
        raise error.at(str(file)) from error
    if missing := [name for name in _PARTS if name not in content]:
        raise ReadError(f"{file} is incomplete: it has no {missing[0]!r}", advice=RUN_AGAIN)
    for name, (kind, words) in _PARTS.items():
        value = content[name]
        texts = value.values() if isinstance(value, Mapping) else value if isinstance(value, list) else ()
        if not isinstance(value, kind) or (name in _TEXTS and not all(isinstance(text, str) for text in texts)):
            raise ReadError(f"{file} is not the file of a fleet: {name} must be {words}", advice=RUN_AGAIN)
    return content


_PARTS: Mapping[str, tuple[type, str]] = {
    "settings": (Mapping, "an object"), "units": (Mapping, "an object of strings"),
    "left_out": (list, "a list of strings"), "reading": (Mapping, "an object"),
}  # fmt: skip
"""Keys of fleet.json that are read, with the type of their values and its description in errors."""
_TEXTS = ("units", "left_out")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Fleet(Summarised, Plotted):
    """A fleet of calibrated units. `fleet["unit"]` loads the Calibration of one unit.

    Attributes
    ----------
    folder : Path
        Output folder, with fleet.json, fleet.parquet and a file units/<unit>.json for each unit.
    paths : mapping of unit to path
        Recording of each unit.
    table : polars.DataFrame
        A row for each unit and axis: `unit`, `axis`, `status` ("calibrated" or "failed"), `reason`, `file`, `sha256`,
        `samples`, `rate` (Hz), `duration` (s), `model`, `p_value` (of the fit), `robust`, `contaminated`, `certified`,
        `cautions` (number of cautions); and for each datasheet parameter, such as N, the columns N, N_low, N_high and
        N_unit in SI units. If only an upper limit is known, the value is missing, the low end is 0, and the high end is
        the limit (infinite if there is none). A unit that failed completely has one row without an axis.
    settings : CalibrationOptions
        Options of the calibrations.
    left_out : tuple of str
        Files in the input folder that are not recordings.
    kept, done : int
        Number of units calibrated by earlier runs, and by this run. For a loaded fleet, `done` is 0.
    reading : mapping
        Arguments of `read` that differ from its defaults.
    """

    folder: Path
    paths: Mapping[str, str]
    table: polars.DataFrame
    settings: CalibrationOptions
    left_out: tuple[str, ...] = ()
    kept: int = 0
    done: int = 0
    reading: Mapping[str, Any] = field(default_factory=dict)

    @property
    def units(self) -> tuple[str, ...]:
        """Names of all units."""
        return tuple(self.paths)

    @cached_property
    def failed(self) -> dict[str, str]:
        """Units that could not be calibrated, with the reason."""
        rows = self.table.filter(self.table["axis"].is_null()).select("unit", "reason").rows()
        return {str(unit): str(reason) for unit, reason in rows}

    @cached_property
    def statistics(self) -> FleetStatistics:
        """Statistics of each noise parameter: typical value, spread, outliers and differences between axes."""
        from gmwm.applications.fleets.statistics import fleet_statistics

        return fleet_statistics(self.table, confidence=self.settings.confidence)

    @property
    def outliers(self) -> Any:
        """The values that differ from the values of the other units by more than chance explains."""
        return self.statistics.outliers

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks on the fleet, the most severe first."""
        from gmwm.applications.fleets.statistics_result import of_units

        remarks = of_units(self.table, len(self.units), len(self.failed))
        return tuple(sorted_remarks([*remarks, *self.statistics.remarks]))

    def __getitem__(self, unit: str) -> Calibration:
        if unit not in self.paths:
            examples = ", ".join(list(self.paths)[:3])
            raise OptionError(
                argument="unit", expected=f"one of the {len(self.paths)} units, such as {examples}", got=unit
            )
        if unit in self.failed:
            raise DataError(f"{unit} could not be calibrated: {self.failed[unit]}", argument="unit", got=unit)
        return Calibration.load(unit_file(self.folder, unit))

    def __iter__(self) -> Iterator[str]:
        return (unit for unit in self.paths if unit not in self.failed)

    def __len__(self) -> int:
        return len(self.paths) - len(self.failed)

    def __contains__(self, unit: object) -> bool:
        return unit in self.paths and unit not in self.failed

    def summary(self, dialect: Dialect = Dialect.PYTHON) -> str:
        """Describe the fleet in text: number of units, failed units, tables, outliers, and remarks in a `dialect`."""
        from gmwm.applications.fleets import summary_text

        return summary_text.summary(self, dialect)

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> Fleet:
        """Load a fleet from an output `folder` of `gmwm.fleet` or of the command `gmwm fleet`.

        Another folder, another version, or a folder without a completed run raises a ReadError."""
        where = Path(folder)
        facts = read_facts(where)
        table = read_table(where / TABLE)
        try:
            settings = CalibrationOptions.from_dict(facts["settings"])
        except (ReadError, TypeError) as error:
            raise ReadError(f"{where} has unknown settings: {error}", advice=RUN_AGAIN) from error
        paths, listed = facts["units"], set(table["unit"])
        if any(unit not in listed for unit in paths):
            raise ReadError(f"{where}: the last run ended before it wrote the table", advice=RUN_AGAIN)
        loaded = cls(
            folder=where, paths=paths, table=table, settings=settings, left_out=tuple(facts["left_out"]),
            reading=facts["reading"],
        )  # fmt: skip
        return replace(loaded, kept=len(loaded))

    def __repr__(self) -> str:
        failed = f", {len(self.failed)} failed" if self.failed else ""
        return f"Fleet({len(self)} of {len(self.paths)} units calibrated{failed})"


register(Fleet, "gmwm.applications.fleets.plot:plot_fleet")
