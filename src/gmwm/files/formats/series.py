"""Read position series, one value a day, week or month: tenv3, .pos, PSMSL, and tables with dates.

Days and months get equal intervals. Sources: README of tenv3 (Nevada Geodetic Laboratory);
header of the .pos files of UNAVCO; PSMSL, "Format of monthly data"."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.base.errors import ReadError
from gmwm.base.remarks import Remark
from gmwm.base.units import AXES
from gmwm.files.clock.text_stamps import is_time_of_day
from gmwm.files.columns.column_names import recognise
from gmwm.files.contract import HEAD_BYTES, Channel, Layout, Reader, Rows, register
from gmwm.files.formats.byte_sources import FileSource, recoded
from gmwm.files.formats.dialect import split_line
from gmwm.files.formats.text_rows import OR_SKIP

_COLUMN = re.compile(
    r"[_ ]*d?[_ ]*(?P<axis>e|east|n|north|u|up|h|height|level)[_ ]*[\[(]?(?P<unit>[cm]?m)?[\])]?", re.I
)
_AXES = {"e": "east", "n": "north", "u": "up", "h": "up", "l": "level"}
_TIME = re.compile(r"\W*(date|epoch|mjd|year|dec\w*[ _]year|yyyy.yyyy)\b.*|", re.I)  # or no name
_DATE = re.compile(r"(\d{4})([-/.]?)(\d\d)\2(\d\d)(?:[T ](\d\d):(\d\d)(?::(\d\d(?:\.\d*)?))?Z?)?")
_MISSING = {"", "na", "nan", "null", "-99999"}
_Columns: TypeAlias = tuple[tuple[str, str, tuple[int, ...]], ...]
_KNOWN: tuple[tuple[str, str, _Columns], ...] = (
    (
        "tenv3", r"\w{4} \d\d[A-Z]{3}\d\d +\d{4}\.\d+ +\d{5} ",
        (("time", "", (3,)), ("east", "m", (7, 8)), ("north", "m", (9, 10)), ("up", "m", (11, 12))),
    ),
    (
        ".pos", r" ?\d{8} \d{6} \d{5}\.\d+ +(?:\S+ +){20}",
        (("time", "", (2,)), ("east", "m", (16,)), ("north", "m", (15,)), ("up", "m", (17,))),
    ),
    ("PSMSL", r" *\d{4}\.\d+; *-?\d+; *\w+;\d{3}", (("time", "", (0,)), ("level", "mm", (1,)))),
)  # fmt: skip
"""Name of a format, pattern of its rows, and the name and unit of each column with the cells whose sum it is."""


@dataclass(frozen=True)
class _Form:
    """Form of a file: the columns as in `_KNOWN`, the place of the time among them, the delimiter and the first row."""

    title: str
    columns: _Columns
    time: int
    delimiter: str
    first: int


@register
class SeriesReader(Reader):
    """Reader of position series."""

    name: ClassVar[str] = "series"
    extensions: ClassVar[tuple[str, ...]] = (".tenv3", ".pos", ".rlrdata", ".metdata")

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0.9 for a known form, or for a table with a time in days and a column such as up."""
        form = _form(head.decode("latin-1").splitlines()[:200], _TIME)
        names = [name for name, _, _ in form.columns] if form is not None else []
        return 0.9 * (any(map(_axis, names)) and not any(recognise(name).axis in AXES for name in names))

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return one recording, whose time stamps have equal intervals."""
        lines = _lines(path, HEAD_BYTES)
        form = _form(lines)
        if form is None:
            raise ReadError(
                f"{path} has no column of dates (2019-03-01), decimal years or modified Julian days", code="no-time",
                advice="Add one, or name another format with {--format}.",
            )  # fmt: skip
        remark = Remark.of("file-content", case="layout", format=f"{form.title} of positions")
        channels = [Channel(name, unit, _axis(name)) for name, unit, _ in form.columns]
        channels[form.time] = Channel(channels[form.time].name, "ns", "time")
        first = tuple(split_line(lines[form.first], form.delimiter))
        return (Layout(tuple(channels), first, remarks=(remark,), state=form),)

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield the rows with a value, in the order of their times, which are multiples of the interval."""
        form: _Form = layout.state
        rows = []
        for number, line in enumerate(_lines(path)[form.first :], form.first + 1):
            cells = split_line(line, form.delimiter)
            try:
                rows.append([
                    _time(cells[group[0]]) if k == form.time else sum(_number(cells[cell]) for cell in group)
                    for k, (_, _, group) in enumerate(form.columns)
                ])  # fmt: skip
            except (ValueError, IndexError):
                if cells != [""] and not layout.skip_bad_lines:
                    raise ReadError(
                        f"{path}, line {number}: {line.strip()[:60]!r} cannot be read", code="row-invalid",
                        advice="Repair the line." + OR_SKIP,
                    ) from None  # fmt: skip
        table = np.array(rows).T
        numbers = np.delete(table, form.time, axis=0)
        table = table[:, ~np.all(np.isnan(numbers), axis=0)]
        times = _regular(table[form.time], path)
        order = np.argsort(times)
        yield {k: (times if k == form.time else table[k])[order] for k in wanted}


def _lines(path: Path, size: int = -1) -> list[str]:
    with recoded(FileSource(path)).open() as file:
        return file.read(size).decode("utf-8-sig", "replace").splitlines()


def _axis(name: str) -> str:
    """Return the axis of a column; "" if its name is not known."""
    match = _COLUMN.fullmatch(name)
    return _AXES[match["axis"][0].lower()] if match else ""


def _form(lines: Sequence[str], time: re.Pattern[str] | None = None) -> _Form | None:
    """Return the form of the rows of a file; None if they have no time in days. A column of numbers is a time if its
    name matches `time`."""
    for k, line in enumerate(lines):
        delimiter = next((sign for sign in ";,\t" if sign in line), " ")
        for title, pattern, columns in _KNOWN:
            if re.match(pattern, line):
                return _Form(title, columns, time=0, delimiter=delimiter, first=k)
        cells = split_line(line, delimiter)
        header = split_line(re.sub(r"^[#%* ]+", "", lines[k - 1]), delimiter) if k else []
        names = header if len(header) == len(cells) else [""] * len(cells)
        timed = [j for j, cell in enumerate(cells) if _is_time(cell, time is None or bool(time.fullmatch(names[j])))]
        if timed and len(cells) > 1 and not any(map(is_time_of_day, cells)):
            units = [match["unit"] or "" if (match := _COLUMN.fullmatch(name)) else "" for name in names]
            columns = tuple((name, units[j], (j,)) for j, name in enumerate(names))
            return _Form("a table", columns, time=timed[0], delimiter=delimiter, first=k)
    return None


def _is_time(cell: str, number: bool) -> bool:
    """Return whether a cell is a date or, if it can be a number, a year or a modified Julian day."""
    if _DATE.fullmatch(cell) and not cell.isdecimal():
        return True
    try:
        return number and math.isfinite(_time(cell))
    except ValueError:
        return False


def _time(cell: str) -> float:
    """Convert a date to days since 1970. Decimal years are negative, because their length depends on the file."""
    if match := _DATE.fullmatch(cell):
        year, _, month, day, *clock = match.groups()
        days = float(np.datetime64(f"{year}-{month}-{day}").astype(np.int64))
        return days + sum(float(part or 0) / size for part, size in zip(clock, (24, 1440, 86_400), strict=True))
    number = float(cell)
    if 1700 <= number < 2200:
        return -number
    if 15_000 <= number < 100_000:
        return number - 40_587  # the modified Julian day of 1970-01-01
    raise ValueError(cell)


def _number(cell: str) -> float:
    return np.nan if cell.casefold() in _MISSING else float(cell)


def _regular(times: Vector, path: Path) -> NDArray[np.int64]:
    """Return the time stamps (ns) of rows as multiples of one interval from the first one."""
    days = _from_years(-times) if times.max() < -1700 else times
    interval = float(np.median(np.diff(np.sort(days)))) if days.size > 1 else 1.0
    if 27 < interval < 32:
        place = np.floor(days).astype("M8[D]").astype("M8[M]").astype(np.float64)
        interval = 365.25 / 12
    else:
        interval = max(1.0, round(interval)) if interval > 0.9 else max(round(interval * 86_400, 3), 1e-3) / 86_400
        place = (days - days.min()) / interval
    steps = np.rint(place - place.min()).astype(np.int64)
    _, first, counts = np.unique(steps, return_index=True, return_counts=True)
    off = np.append(np.flatnonzero(np.abs(place - place.min() - steps) > 0.4), first[counts > 1])
    if off.size:
        date = np.datetime64(round(days[off[0]] * 86_400), "s")
        raise ReadError(
            f"{path}: the time {date} is repeated, or no multiple of the interval of {interval:g} days from the first "
            "one", code="time-order", advice="Remove the row, or name the column of the time with {--columns}.",
        )  # fmt: skip
    ns = 86_400 * 10**9
    return np.asarray(round(days.min() * ns) + round(interval * ns) * steps)


def _from_years(years: Vector) -> Vector:
    """Convert decimal years to days since 1970: years of 365.25 days from 2000, or calendar years, whichever gives the
    same time of the day in all rows."""
    calendar_years = np.floor(years).astype(np.int64)
    begin = (calendar_years - 1970).astype("M8[Y]").astype("M8[D]").astype(np.float64)
    end = (calendar_years - 1969).astype("M8[Y]").astype("M8[D]").astype(np.float64)
    # 2000.0 is 2000-01-01 12:00 in the decimal years of tenv3.
    both = ((years - 2000) * 365.25 + 10_957.5, begin + (years - calendar_years) * (end - begin))
    return max(both, key=lambda days: abs(np.mean(np.exp(2j * np.pi * days))))
