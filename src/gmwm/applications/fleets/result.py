"""Result of `fleet`: the table, the calibrations and the statistics of many units, and the folder that stores them."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gmwm.applications.fleets.discovery import FILE, FleetUnits
from gmwm.applications.fleets.unit_job import PART, RUN_AGAIN, Row, UnitOptions, from_plain, read_table, stamp_of
from gmwm.base.atomic_files import read_json, write_text
from gmwm.base.errors import DataError, OptionError, ReadError
from gmwm.base.plotting import Plotted, register
from gmwm.base.remarks import Remark, sorted_remarks
from gmwm.base.text import Summarised, printable, version
from gmwm.calibration.document import FORMAT as CALIBRATION
from gmwm.calibration.document import VERSION as CALIBRATION_VERSION
from gmwm.calibration.options import CalibrationOptions
from gmwm.calibration.recording_info import Recording
from gmwm.calibration.result import Calibration

if TYPE_CHECKING:
    from polars import DataFrame

    from gmwm.applications.fleets.statistics_result import FleetStatistics

FORMAT = "gmwm-fleet"
VERSION = 1
"""Version of fleet.json; gmwm reads no other. Adding a key does not change the version."""
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
    try:
        content = read_json(file)
    except ValueError as error:
        raise ReadError(
            f"{file} is not the file of a fleet: it is not JSON or incomplete ({error})", advice=RUN_AGAIN
        ) from error
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise ReadError(f'{file} is not the file of a fleet: it does not have "format": "{FORMAT}"', advice=RUN_AGAIN)
    version = content.get("version")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise ReadError(
            f"{file} is not the file of a fleet: version must be a whole number from 1; got {version!r}",
            advice=RUN_AGAIN,
        )
    if version != VERSION:
        newer = version > VERSION
        raise ReadError(
            f"{file} has version {version} of the format, written by gmwm {content.get('gmwm')}; this gmwm reads "
            f"version {VERSION}",
            advice="Install a newer gmwm: `pip install --upgrade gmwm`." if newer else "Run the fleet again.",
        )
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
    table: DataFrame
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

    def summary(self) -> str:
        """Describe the fleet in text: number of units, failed units, tables, outliers and remarks."""
        from gmwm.applications.fleets import summary_text

        return summary_text.summary(self)

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> Fleet:
        """Load a fleet from an output `folder` of `gmwm.fleet` or of the command `gmwm fleet`.

        Another folder, another version, or a folder without a completed run raises a ReadError.
        """
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
