"""Files of a fleet in its folder, and which units need no new calibration."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from gmwm._files import write_text
from gmwm.calibration.document import FORMAT as CALIBRATION
from gmwm.calibration.document import VERSION as CALIBRATION_VERSION
from gmwm.calibration.recording_info import Recording
from gmwm.errors import ReadError
from gmwm.fleets.discovery import FILE, FleetUnits
from gmwm.fleets.rows import Row, from_plain
from gmwm.fleets.unit_job import PART, UnitOptions, stamp_of

FORMAT = "gmwm-fleet"
VERSION = 1
"""Of fleet.json. A reader takes its own version and older ones; new keys alone do not raise it."""
TABLE = "fleet.parquet"
UNITS = "units"


def unit_file(folder: Path, unit: str) -> Path:
    """Where the calibration of a unit stands."""
    return folder / UNITS / f"{unit}.json"


def write_unit(folder: Path, unit: str, document: str) -> None:
    """Write the calibration of a unit, whole or not at all."""
    file = unit_file(folder, unit)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_text(file, document)


def remove_unit(folder: Path, unit: str) -> None:
    """Remove the calibration of an earlier run if the unit cannot be calibrated now: it is of another recording."""
    unit_file(folder, unit).unlink(missing_ok=True)


def foreign_units(folder: Path, units: Mapping[str, Path]) -> list[str]:
    """Units with results in the folder that do not belong to this fleet."""
    inside = folder / UNITS
    there = (str(file.relative_to(inside).as_posix()).removesuffix(".json") for file in inside.rglob("*.json"))
    return sorted(unit for unit in there if unit not in units)


def finished_rows(folder: Path, unit: str, path: Path, options: UnitOptions) -> list[Row] | None:
    """The rows of a finished unit; None if it must be calibrated.

    A unit is finished if it was calibrated with the same settings, from the same recording, read in the same way.
    """
    try:
        content = json.loads(unit_file(folder, unit).read_text(encoding="utf-8"))
        if content["format"] != CALIBRATION or content["version"] > CALIBRATION_VERSION:
            return None
        made = content[PART]
        if any(made[name] != value for name, value in options.to_dict().items()):
            return None
        if not _is_same(path, made, content["recording"]):
            return None
        return [from_plain(row) | {"unit": unit, "file": str(path)} for row in made["rows"]]
    except (OSError, ValueError, KeyError, TypeError):
        return None  # none, cut short, or not ours: it is made anew


def _is_same(path: Path, made: Mapping[str, Any], recording: Mapping[str, Any]) -> bool:
    """Whether a recording is what it was: by size and time, or by its content where only its time is another one."""
    stamp = stamp_of(path)
    if stamp["size"] != made["size"]:
        return False
    if stamp["modified_ns"] == made["modified_ns"]:
        return True
    digest = recording["sha256"]
    return digest is not None and Recording.from_dict(recording).of_file(path).sha256 == digest


def write_facts(folder: Path, found: FleetUnits, options: UnitOptions) -> None:
    """Write what the fleet is: its units, and what was asked of them."""
    content = {
        "format": FORMAT,
        "version": VERSION,
        "gmwm": metadata.version("gmwm"),
        **options.to_dict(),
        "units": {unit: str(path) for unit, path in found.paths.items()},
        "left_out": list(found.left_out),
    }
    write_text(folder / FILE, json.dumps(content, allow_nan=False, ensure_ascii=False, indent=1) + "\n")


def read_facts(folder: Path) -> Mapping[str, Any]:
    """What `write_facts` wrote.

    Raises
    ------
    ReadError
        If the folder is none of a fleet, or of a newer version.
    """
    file = folder / FILE
    if not file.is_file():
        raise ReadError(f"{folder} is not the folder of a fleet: it has no {FILE}")
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ReadError(f"{file} is not of a fleet: no JSON, or cut short ({error})") from error
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise ReadError(f'{file} is not of a fleet: it does not begin with "format": "{FORMAT}"')
    if not isinstance(content.get("version"), int) or content["version"] > VERSION:
        raise ReadError(
            f"{file} is of version {content.get('version')} of its format, written by gmwm {content.get('gmwm')}; this "
            f"gmwm reads versions up to {VERSION}: install a newer one"
        )
    if missing := [name for name in ("settings", "units", "left_out") if name not in content]:
        raise ReadError(f"{file} is not whole: it has no {missing[0]!r}")
    return content
