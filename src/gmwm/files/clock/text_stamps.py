"""Read time stamps that are text: dates with times (ISO 8601) and times of day, to the nanosecond.

    2024-05-01T12:00:00.123456789Z   2024-05-01 12:00:00,123+02:00   2024/05/01 12:00:00   20240501T120000   12:00:00.5

`formats.line_forms` removes 05/01/2024, a day in January or May by country. Times without an offset are read as UTC."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base.errors import ReadError
from gmwm.base.lazy import polars as pl
from gmwm.base.remarks import Remark
from gmwm.files.contract import Layout

UNIT = "ns"
"""Unit of the time stamps. Dates are counted from 1970, and times of day from midnight."""

_SECOND = 10**9
_DAY = 86_400 * _SECOND

_CLOCK = r"^(?P<clock>\d{1,3}:\d\d:\d\d)(?:[.,](?P<fraction>\d+))?[Zz]?$"
# Nanoseconds since 1970 reach from 1677 to 2262.
_DATED = (
    r"^(?P<date>(?:1[7-9]|2[01])\d\d(?:-\d\d-\d\d|/\d\d/\d\d|\.\d\d\.\d\d|\d\d\d\d))[Tt]?\s*"
    r"(?P<clock>\d\d:\d\d(?::\d\d)?|\d{6})(?:[.,](?P<fraction>\d+))?"
    r"\s*(?P<zone>[Zz]|[+-]\d\d(?::?\d\d)?)?\s*(?P<name>UTC|GMT)?(?:\[[^\]]*\])?$"
)
_YEARS = (1700, 2199)
_SEPARATED = re.compile(r"\d[:Tt]\d")  # never in a number
_LOOKS = re.compile(r"\d[-/.]\d\d?[-/.]\d|\d{4}-?\d\d-?\d\d[Tt]|\d:\d\d")
_DATE_ALONE = re.compile(r"\d{4}([-/.])\d\d?\1\d\d?|\d\d?([-/.])\d\d?\2\d{2,4}")

_WANTED = "expected numbers, or dates and times such as 2024-05-01T12:00:00.123Z (ISO 8601)"
_OR_LEAVE_OUT = "or leave it out with {--columns=time:none} and pass {--rate}."


def is_stamp(cell: str) -> bool:
    """Return whether a cell is a date with a time, to the second or finer, or a time of day."""
    if not _SEPARATED.search(cell):
        return False
    shape = _match(_DATED, cell)
    return is_time_of_day(cell) if shape is None else len(re.sub(r"\D", "", shape["clock"])) == 6


def is_time_of_day(cell: str) -> bool:
    """Return whether a time stamp has no date."""
    return _match(_CLOCK, cell) is not None


def is_date(cell: str) -> bool:
    """Return whether a cell is a date without a time."""
    return _DATE_ALONE.fullmatch(cell) is not None


def parted_stamp(row: Sequence[str]) -> int | None:
    """Return the index of the cell in which a time stamp begins that ends in the next cell; None if there is none.

    The split is after the date, or before the fraction of a second.

    >>> parted_stamp(["2024-05-01", "12:00:00.5", "0.1"]), parted_stamp(["7", "2024-05-01 12:00:00", "500", "0.1"])
    (0, 1)
    """
    for k, (cell, following) in enumerate(pairwise(row)):
        fraction = is_stamp(cell) and re.search(r":\d\d$", cell) and re.fullmatch(r"\d{3}|\d{6}|\d{9}", following)
        dated = is_date(cell) or is_stamp(f"{cell} {following}")
        if fraction or (is_time_of_day(following) and dated):
            return k
    return None


def holds_stamps(layout: Layout, column: int) -> bool:
    """Return whether a column contains dates or times of day, by its first row."""
    return column < len(layout.first_row) and is_stamp(layout.first_row[column])


def form_remark(cell: str) -> Remark:
    """Make the remark on how a column that begins with this time stamp is read."""
    if is_time_of_day(cell):
        return Remark.of("time-read", case="read", form="clock")
    zone = _zone(cell)
    if zone and zone[0] not in "+-":
        return Remark.of("time-read", case="read", form="utc")
    if zone:
        return Remark.of("time-read", case="read", form="offset", offset=zone)
    return Remark.of("time-read", case="read", form="local")


def require_readable(cell: str, path: object) -> None:
    """Require that the first cell of a time column is a number, or a date or time that can be read."""
    text = cell.strip()
    if is_stamp(text) or not _LOOKS.search(text):
        return
    if is_date(text):
        raise ReadError(
            f"{path}: the time column holds dates without times ({text!r})",
            code="dates-without-times",
            advice="If another column holds the times, name it as time with {--columns}, " + _OR_LEAVE_OUT,
        )
    raise ReadError(
        f"{path}: the dates or times in the time column cannot be read ({text!r}); {_WANTED}",
        code="dates-unreadable",
        advice="Convert the column, " + _OR_LEAVE_OUT,
    )


def what_is_wrong(cell: str, first: str) -> str:
    """Describe a time stamp that cannot be read, compared with the first row of its column."""
    text = cell.strip()
    if is_stamp(text) and is_time_of_day(text) == is_time_of_day(first):
        if bool(_zone(text)) == bool(_zone(first)):
            return f"{text!r}, a time that does not exist"
        return f"{text!r}, {'with' if _zone(text) else 'without'} an offset from UTC, unlike the first row ({first!r})"
    return f"{text[:40]!r}, expected a time as in the first row ({first!r})"


def times_of(cells: pl.Series, first: str) -> NDArray[np.datetime64]:
    """Parse time stamps to datetime64[ns] in UTC, times of day on the first day of 1970. `first` shows dates or times
    of day, and offsets. Unreadable cells give NaT."""
    zoned = None if is_time_of_day(first) else bool(_zone(first))
    widths = cells.str.len_bytes().to_numpy()
    stamps = np.empty(widths.size, dtype="M8[ns]")
    # Some programs leave out zeros at the end, so the cells can have several widths.
    for width in np.unique(widths).tolist():
        those = widths == width
        alike = cells if those.all() else cells.filter(those)
        times = _side_by_side(alike, width, zoned)
        stamps[those] = _one_by_one(alike, zoned) if times is None else times
    return stamps


class Midnights:
    """Continue times of day beyond midnight: a step back of more than 12 h. A step of a day, or up to a minute less, is
    out of order next to midnight (tests/readers/test_stamps.py)."""

    def __init__(self) -> None:
        self._days, self._last = 0, -1

    def continue_days(self, times: NDArray[Any]) -> NDArray[np.int64]:
        """Return the next times of day (ns), continued from the previous ones.

        >>> Midnights().continue_days(np.array([86_399, 0, 1]) * 10**9) // 10**9
        array([86399, 86400, 86401])
        """
        steps = np.diff(times, prepend=times[0] if self._last < 0 else self._last)
        # Times of day differ by less than a day. Larger steps occur in times counted from the start of a recording.
        onward, back = (steps > -_DAY) & (steps < -_DAY // 2), (steps > _DAY - 60 * _SECOND) & (steps < _DAY)
        days = self._days + np.cumsum(onward.astype(np.int64) - back)
        self._days, self._last = int(days[-1]), int(times[-1])
        return np.asarray(times + _DAY * days)


def _match(pattern: str, cell: str) -> re.Match[str] | None:
    return re.match(pattern, cell.strip(), re.ASCII)


def _zone(cell: str) -> str:
    """Return the offset from UTC in a time stamp; "" if there is none."""
    shape = _match(_DATED, cell)
    return (shape["zone"] or shape["name"] or "") if shape else ""


def _offset(zone: str) -> int:
    """Convert an offset from UTC to nanoseconds."""
    digits = re.sub(r"\D", "", zone).ljust(4, "0")
    return (-1 if zone.startswith("-") else 1) * (int(digits[:2]) * 60 + int(digits[2:])) * 60 * _SECOND


def _side_by_side(cells: pl.Series, width: int, zoned: bool | None) -> NDArray[np.datetime64] | None:
    """Parse time stamps of the same width, form and offset; return None if they differ or one is not a time."""
    first = str(cells[0])
    shape = _match(_CLOCK if zoned is None else _DATED, first)
    if shape is None or (zoned is not None and bool(_zone(first)) != zoned):
        return None
    parts = shape.re.groupindex.keys() & {"date", "clock", "fraction"}
    places = {part: [k for k in range(*shape.span(part)) if first[k].isdigit()] for part in parts}
    # A row of the table is one character position in all time stamps.
    table = np.frombuffer(cells.str.join("").item().encode(), dtype=np.uint8).reshape(-1, width)
    table = np.ascontiguousarray(table.T) - np.uint8(ord("0"))
    moving = np.isin(np.arange(width), [k for part in places.values() for k in part])
    if np.any(table[~moving] != table[~moving, :1]) or np.any(table[moving] > 9):
        return None
    clock = places["clock"]
    hours, minutes, seconds = (_number(table, part) for part in (clock[:-4], clock[-4:-2], clock[-2:]))
    valid = len(clock) > 4 and minutes.max() < 60 and seconds.max() <= 60 and (zoned is None or hours.max() < 24)
    days = _days(table, places["date"]) if zoned is not None else np.int64(0)
    if days is None or not valid:
        return None
    digits = places["fraction"][:9]
    fraction = _number(table, digits) * 10 ** (9 - len(digits))
    times = (((days * 24 + hours) * 60 + minutes) * 60 + seconds) * _SECOND + fraction
    return np.asarray(times - (_offset(shape["zone"] or "") if zoned else 0)).view("M8[ns]")


def _number(table: NDArray[np.uint8], places: Sequence[int]) -> NDArray[np.int64]:
    """Return the numbers formed by the digits at some positions; 0 for no positions."""
    number = np.zeros(table.shape[1], dtype=np.int64)
    for place in places:
        number *= 10
        number += table[place]
    return number


def _days(table: NDArray[np.uint8], places: Sequence[int]) -> NDArray[np.int64] | None:
    """Return the days since 1970 of dates; None if one of the dates does not exist."""
    year, month, day = (_number(table, part) for part in (places[:4], places[4:6], places[6:]))
    if year.min() < _YEARS[0] or year.max() > _YEARS[1] or month.min() < 1 or month.max() > 12 or day.min() < 1:
        return None
    months = ((year - 1970) * 12 + month - 1).view("M8[M]")
    begin, end = (edge.astype("M8[D]").view(np.int64) for edge in (months, months + np.timedelta64(1, "M")))
    days = begin + day - 1
    return None if np.any(days >= end) else days


def _one_by_one(cells: pl.Series, zoned: bool | None) -> NDArray[np.datetime64]:
    """Parse time stamps of different forms and offsets, one by one. Some programs leave out seconds that are zero."""
    groups = cells.str.extract_groups(_CLOCK if zoned is None else _DATED).struct.unnest()
    clock, shift = groups["clock"], pl.Series([0])
    date = pl.Series(["19700101"])
    if zoned is None:
        clock = clock.str.pad_start(9, "0")
        shift = clock.str.head(3).cast(pl.Int64) * (-3600 * _SECOND)
        clock = "00" + clock.str.tail(6)
    else:
        date = groups["date"].str.replace_all(r"\D", "")
        zone = groups["zone"].fill_null("")
        offsets = zone.unique().to_list()
        shift = zone.replace_strict(offsets, [_offset(z) for z in offsets], return_dtype=pl.Int64)
        has_zone = (zone != "") | groups["name"].is_not_null()
        date = date.set(has_zone != zoned, None)
    clock = clock.str.replace_all(":", "", literal=True).str.pad_end(6, "0")
    text = date + "T" + clock + "." + groups["fraction"].fill_null("0")
    times = text.str.to_datetime("%Y%m%dT%H%M%S%.f", time_unit="ns", strict=False, cache=False)
    return (times.to_physical() - shift).cast(pl.Datetime("ns")).to_numpy()
