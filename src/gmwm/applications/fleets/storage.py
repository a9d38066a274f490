"""Read and write the files in the output folder of a fleet, and find finished units."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gmwm.applications.fleets.discovery import FILE, FleetUnits
from gmwm.applications.fleets.table import RUN_AGAIN, Row, from_plain
from gmwm.applications.fleets.unit_job import PART, UnitOptions, stamp_of
from gmwm.base.atomic_files import read_json, write_text
from gmwm.base.errors import ReadError
from gmwm.base.text import printable, version
from gmwm.calibration.document import FORMAT as CALIBRATION
from gmwm.calibration.document import VERSION as CALIBRATION_VERSION
from gmwm.calibration.recording_info import Recording

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
