"""Recognise text tables of known programs and devices, which `known_tables.toml` defines."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

from gmwm.base.lazy import tomllib
from gmwm.base.units import TIME_UNITS

_AXIS = {"0": "x", "1": "y", "2": "z"}


@dataclass(frozen=True)
class KnownTable:
    """Definition of the table of one program, as in `known_tables.toml`."""

    program: str
    needed: Sequence[str]
    columns: Sequence[tuple[str, str, str]]
    file: str = ""
    above: str = ""
    names: Sequence[str] = ()


@cache
def _tables() -> list[KnownTable]:
    text = files("gmwm.files.columns").joinpath("known_tables.toml").read_text(encoding="utf-8")
    return [KnownTable(**table) for table in tomllib.loads(text)["table"]]


def names_by_file(path: Path, columns: int) -> tuple[str, ...]:
    """Return the names of the columns of a file without a header, by the name of the file; () if it is not known."""
    headers = (tuple(table.names) for table in _tables() if table.names and re.search(table.file, path.stem))
    return next((names for names in headers if len(names) == columns), ())


def known_table(names: Sequence[str], path: Path, above: Sequence[str]) -> tuple[str, Mapping[int, tuple[str, str]]]:
    """Recognise a table by its names and the lines `above`; return program ("" if unknown), and role and unit by
    column.

    >>> known_table(["TimeUS", "I", "GyrX"], Path("a.csv"), [])[1]
    {0: ('time', 'us'), 2: ('gyro_x', 'rad/s')}
    """
    head = "\n".join(above)
    for table in _tables():
        fits = all(any(re.fullmatch(pattern, name) for name in names) for pattern in table.needed)
        if fits and re.search(table.file, path.stem) and re.search(table.above, head):
            return table.program, _roles(table, names)
    return "", {}


def stated_scales(above: Sequence[str]) -> dict[str, tuple[str, float]]:
    """Return unit and scale of the sensors and of the time, from the lines above a decoded blackbox log or in a gcsv
    file. A gyro_scale of 1.0 is that of numbers in deg/s (Betaflight's blackbox-log-viewer, FlightLog).

    >>> stated_scales(['"acc_1G","2048"', '"gyro_scale","0x3f800000"'])
    {'accel': ('g', 0.00048828125), 'gyro': ('deg/s', 1.0)}
    >>> stated_scales(["tscale,0.001", "gscale,0.00122"])
    {'gyro': ('rad/s', 0.00122), 'time': ('ms', 1.0)}
    """
    text, units = "\n".join(above), dict[str, tuple[str, float]]()
    if gravity := re.search(r"\bacc_1G\W+(\d+)", text):
        units["accel"] = ("g", 1 / (int(gravity[1]) or 1))
    if re.search(r"\bgyro_scale\W+(?:0x3f800000|1\.0*\b)", text):
        units["gyro"] = ("deg/s", 1.0)
    scales = {key: float(number) for key, number in re.findall(r"(?m)^([tga])scale,(\d[\d.]*(?:e-?\d+)?)", text)}
    units |= {
        role: (unit, scales[key]) for key, role, unit in (("g", "gyro", "rad/s"), ("a", "accel", "g")) if key in scales
    }
    unit = next((unit for unit, count in TIME_UNITS.items() if round(count * scales.get("t", 0.0), 6) == 1), "")
    return units | ({"time": (unit, 1.0)} if unit else {})


def _roles(table: KnownTable, names: Sequence[str]) -> dict[int, tuple[str, str]]:
    roles: dict[str, tuple[int, str]] = {}
    for pattern, role, unit in table.columns:
        matches = [(k, match) for k, name in enumerate(names) if (match := re.fullmatch(pattern, name))]
        taken = {label for label, _ in roles.items()}
        for k, match in matches:
            axis = match[1].lower() if match.re.groups else ""
            full = f"{role}_{_AXIS.get(axis, axis)}" if axis else role
            if full not in taken:
                roles.setdefault(full, (k, unit))
    return {k: (role, unit) for role, (k, unit) in sorted(roles.items(), key=lambda item: item[1][0])}
