"""Detect the dialect of a text file from 64 kB: delimiter, decimal sign, comments, header, first line of numbers.

Lines above are titles, headers, units and comments (thresholds: tests/readers/test_text.py, test_headers.py)."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from gmwm.base.errors import ReadError
from gmwm.base.units import TIME_UNITS, find_time_unit
from gmwm.files.clock.text_stamps import is_stamp, parted_stamp
from gmwm.files.columns.column_names import clean, is_unit, recognise, unit_of
from gmwm.files.formats.line_forms import (
    COLOURS,
    MINUS,
    WITHOUT_GROUPS,
    WITHOUT_POINTS,
    LineForms,
    StampParts,
    find_parts,
    is_grouped,
    is_number,
    line_forms,
    plain_header,
    require_clear_commas,
)

Commas = Literal["", "decimal", "thousands"]  # what a comma within a number is; "" if the numbers decide
BLANKS = " "  # delimiter that stands for any number of blanks and tabs


COMMENT_SIGNS = ("#", "%", "//", "!")

MISSING_WORDS = (
    "NA", "N/A", "#N/A", "n/a", "na", "null", "NULL", "Null", "none", "None", "<NA>",
    *(f"{sign}{word}" for sign in ("", "-") for word in ("nan(ind)", "1.#IND", "1.#IND00", "1.#QNAN", "1.#QNAN0")),
)  # fmt: skip
"""Words that programs write instead of a missing number, besides NaN and an empty cell; the last are those of C."""

_NAME_IN_BLANKS = re.compile(r"[^\s\[(]+(?:\s*[\[(][^\]()\[]*[\])])?|\([^()]*\)|\[[^\]\[]*\]")


@dataclass(frozen=True)
class TextDialect:
    """The dialect of a text file."""

    delimiter: str  # one character; " " for any number of blanks
    decimal_comma: bool  # whether the decimal sign is a comma, so that 0,5 is one half
    fields: int  # number of fields in a row of numbers, including an empty one after a trailing delimiter
    columns: int  # number of columns, without the empty field after a trailing delimiter
    first_line: int  # line in which the numbers begin, counted from 1
    names: tuple[str, ...]  # names of the columns; empty if the file has none
    column_units: tuple[str, ...]  # units from a row below or above the names; empty if there is none
    units: dict[str, str]  # units that a comment states for a whole quantity
    comment: str  # sign with which comment lines begin; "" if there are none
    first_row: tuple[str, ...]  # the first row of numbers, as text
    integers: tuple[bool, ...]  # for each column, whether the first rows hold only integers
    rate: float | None = None  # samples per second (Hz), if a comment states it
    # for each column, whether the first rows hold dates with times or times of day that are not all the same
    stamps: tuple[bool, ...] = ()
    # The lines above the numbers that have more than one cell. Some programs repeat them between the numbers
    header: tuple[str, ...] = ()
    above: tuple[str, ...] = ()  # all lines above the numbers
    # in a file with rows of several sensors, the column that states the sensor, and its values; None otherwise
    sensors: tuple[int, tuple[str, ...]] | None = None
    # index of this column, and its value in the rows to read; None to read all rows
    sensor: tuple[int, str] | None = None
    stamp_parts: StampParts | None = None  # the two columns of the time stamps if they have two; None otherwise
    # Replacements in each line before it is split_line. They remove labels of numbers, and arrows after a time
    cleaning: tuple[tuple[bytes, bytes], ...] = ()
    others: tuple[str, ...] = ()  # first words of lines that are left out
    # the last cell of the file, and the last cell of the line before, if the file ends within a number; empty otherwise
    cut: tuple[str, ...] = ()


def split_line(line: str, delimiter: str) -> list[str]:
    """Split a line into cells, without the blanks and quotes around them; quotes protect a delimiter."""
    if delimiter == BLANKS:
        # Quotes protect blanks, as in the headers of R.
        cells = re.findall(r'"[^"]*"|\S+', line) if '"' in line else line.split()
        return [cell.strip("\"'") for cell in cells]
    if '"' in line:
        pattern = rf'\s*(?:"([^"]*)"|([^{re.escape(delimiter)}]*))\s*(?:{re.escape(delimiter)}|$)'
        cells = [(m[1] if m[1] is not None else m[2]).strip() for m in re.finditer(pattern, line)]
        # The pattern matches once more at the end of the line, unless the line ends with a delimiter.
        return cells if line.rstrip().endswith(delimiter) else cells[:-1]
    return [cell.strip() for cell in line.split(delimiter)]


def comment_sign(line: str) -> str:
    """Return the comment sign with which a line begins, or ""."""
    text = line.lstrip()
    return next((sign for sign in COMMENT_SIGNS if text.startswith(sign)), "")


def detect(lines: list[str], path: object, commas: Commas = "", names: tuple[str, ...] = ()) -> TextDialect:
    """Detect the dialect from the first lines, with known `commas` and with `names` that are not in the lines."""
    odd = tuple(pair for mark, pair in (("\x1b[", COLOURS), ("−", MINUS)) if any(mark in line for line in lines))
    for pattern, plain in odd:
        lines = [re.sub(pattern.decode(), plain.decode(), line) for line in lines]
    lines = plain_header(lines)
    body = [(k, line) for k, line in enumerate(lines, 1) if line.strip() and not comment_sign(line)]
    if not body:
        raise ReadError(
            f"{path} holds no rows, only comments or blank lines",
            code="empty",
            advice="Check whether the recording was interrupted.",
        )
    forms = LineForms(names=names) if names else line_forms([line for _, line in body])
    cleaning = (*odd, *forms.replacements)
    body = [(k, text) for k, line in body if (text := forms.rewritten(line)).strip()]
    delimiter, decimal_comma = _delimiter([line for _, line in body], commas)
    grouped = WITHOUT_POINTS if decimal_comma else None
    if commas == "thousands" and delimiter != ",":
        grouped = WITHOUT_GROUPS
    if grouped is not None:
        cleaning = (*cleaning, grouped)
        body = [(k, re.sub(grouped[0].decode(), "", line)) for k, line in body]
    rows = [(k, split_line(line, delimiter)) for k, line in body]
    numeric = _numeric_columns([cells for _, cells in rows], decimal_comma)
    start = next((i for i, (_, cells) in enumerate(rows) if _is_row(cells, numeric, decimal_comma)), None)
    if start is None or not any(numeric):
        shown = body[-1][1].strip()[:80]
        raise ReadError(
            f"{path} has no row of numbers in its first {len(lines)} lines; the last of them is {shown!r}",
            code="no-numbers",
            advice="Check that the file is a table of numbers.",
        )
    first_line, fields = rows[start][0], len(numeric)
    _require_equal_rows(body[:start], (path, first_line))
    data = [cells for _, cells in rows[start:] if len(cells) == fields]
    named = any(len(cells) == fields and cells[-1] for _, cells in rows[:start])
    trailing = fields > 1 and not named and all(cells[-1] == "" for cells in data)
    columns = fields - trailing
    header = [(k, _trim(cells, columns)) for k, cells in rows[:start]]
    numbered = len(data) > 1 and all(cells[0] == str(k) for k, cells in enumerate(data[:9], 1))
    if numbered and header and len(header[-1][1]) == columns - 1:
        # `write.table` of R does not name the column of the row names.
        header[-1] = (header[-1][0], ["", *header[-1][1]])
    # Length of the longest comment (characters) that is searched for names and units
    comments = [line for line in lines[: first_line - 1] if comment_sign(line) and len(line) <= 8192]
    where = (path, first_line)
    names, units = (
        (forms.names, ())
        if len(forms.names) == columns
        else _split_stamp_header(
            header, body, comments=comments, row=data[0][:columns], delimiter=delimiter, where=where
        )
        or _header(header, body, comments=comments, columns=columns, delimiter=delimiter, where=where)
    )
    units = forms.units if len(forms.units) == columns else units
    sign = next((comment_sign(line) for line in lines if comment_sign(line)), "")
    complete = [cells for _, cells in rows[start:] if _is_row(cells, numeric, decimal_comma)]
    if decimal_comma and not commas:
        require_clear_commas(complete, names, f"{path}, from line {first_line} on")
    filled = [[row[c] for row in complete if row[c]] for c in range(columns)]
    # Without a value, as SampleTimeFine of some exports, a column is not the time.
    timeless = [not cells and recognise(name).axis == "time" for name, cells in zip(names, filled, strict=False)]
    names = tuple("" if empty else name for name, empty in zip(names, timeless, strict=True))
    integers = tuple(bool(cells) and all(re.fullmatch(r"[+-]?\d+", cell) for cell in cells) for cells in filled)
    stated = _stated_units(comments)
    first_row = tuple(data[0][:columns])
    stamps = tuple(is_stamp(first_row[c]) and len({row[c] for row in data}) > 1 for c in range(columns))
    return TextDialect(
        delimiter=delimiter, decimal_comma=decimal_comma, fields=fields, columns=columns, first_line=first_line,
        names=names, column_units=units, units=stated, comment=sign, first_row=first_row, integers=integers,
        rate=_stated_rate(comments, [line for k, line in body[:start]]), stamps=stamps,
        header=tuple(line for k, line in body[:start] if len(split_line(line, delimiter)) > 1),
        above=tuple(lines[: first_line - 1]), sensors=_sensors(names, complete),
        stamp_parts=find_parts(names, complete), cleaning=cleaning, others=forms.others,
    )  # fmt: skip


def _sensors(names: Sequence[str], rows: list[list[str]]) -> tuple[int, tuple[str, ...]] | None:
    """Find the column that states each row's sensor, by number or word; return index and first values."""
    for k, name in enumerate(names or [""] * len(rows[0] if rows else ())):
        values = sorted({row[k] for row in rows})
        numbered = name.casefold() in _SENSOR_COLUMNS and all(value.isdecimal() for value in values)
        if 1 < len(values) <= 16 and len(rows[0]) > 3 and (numbered or any(map(sensor_word, values))):
            return k, tuple(values)
    return None


def sensor_word(value: str) -> str:
    """Return the sensor that a cell names, "gyro" or "accel"; "" if it names none, or a quantity without gravity.

    >>> [sensor_word(cell) for cell in ("android.sensor.gyroscope", "ACC", "linear_acceleration", "0.1")]
    ['gyro', 'accel', '', '']
    """
    if not value[:1].isalpha() or re.search(r"linear|gravity|user|vector|orient|temp", value, re.IGNORECASE):
        return ""
    return (
        recognise(f"{value.rpartition('.')[2]}_x")
        .axis.removesuffix("_x")
        .replace("time", "")
        .replace("temperature", "")
    )


_SENSOR_COLUMNS = ("i", "imu", "imu_id", "sensor", "sensor_id", "device", "device_id", "instance")


def _delimiter(lines: list[str], commas: Commas) -> tuple[str, bool]:
    """Return the delimiter and decimal sign with most numbers and most lines of the same number of cells."""
    sample = lines[len(lines) // 2 :][-200:] if len(lines) > 4 else lines[-2:]
    best, best_score = (",", False), (-1.0, -1.0, False, -1)
    for delimiter in (",", ";", "\t", "|", BLANKS):
        for decimal_comma in (True,) if commas == "decimal" else (False, True):
            if delimiter == "," and decimal_comma and not all('"' in line for line in sample):
                continue
            rows = [split_line(line, delimiter) for line in sample]
            fields, same = Counter(map(len, rows)).most_common(1)[0]
            cells = [cell for row in rows for cell in row]
            numbers = sum(
                is_number(cell, decimal_comma) or is_stamp(cell) or (decimal_comma and is_grouped(cell))
                for cell in cells
                if cell
            )
            filled = sum(bool(cell) for cell in cells) or 1
            # A blank may also be within a cell, as in a date with a time.
            score = (round(numbers / filled, 1), round(same / len(rows), 1), delimiter != BLANKS, fields)
            if score > best_score and numbers:
                best, best_score = (delimiter, decimal_comma), score
    return best


def _require_equal_rows(above: list[tuple[int, str]], where: tuple[object, int]) -> None:
    """Raise a ReadError if the lines directly above the first row are rows in another form."""
    count = next((n for n, (_, line) in enumerate(reversed(above)) if not _is_numbers(line)), len(above))
    if count > 1:
        raise ReadError(
            f"{where[0]}: the {count} rows from line {above[-count][0]} on have another delimiter, decimal sign or "
            f"number of columns than the rows from line {where[1]} on",
            code="row-length",
            advice="Write all rows in the same form.",
        )


def _is_numbers(line: str) -> bool:
    """Return whether a delimiter splits a line into several numbers."""
    ways = (split_line(line, delimiter) for delimiter in (",", ";", "\t", "|", BLANKS))
    return any(len(cells) > 1 and all(is_number(cell, decimal_comma=True) for cell in cells) for cells in ways)


def _numeric_columns(rows: list[list[str]], decimal_comma: bool) -> list[bool]:
    """Return for each field whether it is a number in most rows. Only rows of the most common length are considered."""
    fields = Counter(map(len, rows[len(rows) // 2 :])).most_common(1)[0][0]
    body = [row for row in rows[len(rows) // 2 :] if len(row) == fields]
    return [2 * sum(is_number(row[c], decimal_comma) for row in body) > len(body) for c in range(fields)]


def _is_row(cells: list[str], numeric: list[bool], decimal_comma: bool) -> bool:
    """Return whether a line is a row of the recording: its numeric fields contain numbers or are empty."""
    if len(cells) != len(numeric):
        return False
    filled = [cell for cell, number in zip(cells, numeric, strict=True) if number and cell not in ("", *MISSING_WORDS)]
    return bool(filled) and all(is_number(cell, decimal_comma) for cell in filled)


def _trim(cells: list[str], columns: int) -> list[str]:
    """Return the cells without empty cells after the last column."""
    while len(cells) > columns and cells[-1] == "":
        cells = cells[:-1]
    return cells


def _split_stamp_header(
    header: list[tuple[int, list[str]]], body: list[tuple[int, str]], comments: list[str], row: list[str],
    delimiter: str, where: tuple[object, int],
) -> tuple[tuple[str, ...], tuple[str, ...]] | None:  # fmt: skip
    """Return names and units if the delimiter also splits each time stamp, so that a name is missing; else None."""
    at = parted_stamp(row)
    if at is None or any(len(cells) == len(row) for _, cells in header):
        return None
    try:
        names, units = _header(header, body, comments=comments, columns=len(row) - 1, delimiter=delimiter, where=where)
    except ReadError:
        return None
    if not names:
        return None
    if delimiter != BLANKS:
        raise ReadError(
            f"{where[0]}, line {where[1]}: the time stamps have a comma before the fraction of a second "
            f"({','.join(row[at : at + 2])!r}), and commas separate the columns too",
            code="decimal-comma",
            advice="Write a point there, or put the time stamps in quotes.",
        )
    return (*names[:at], "date", *names[at:]), (*units[:at], "", *units[at:]) if units else ()


def _header(
    header: list[tuple[int, list[str]]], body: list[tuple[int, str]], comments: list[str], columns: int, delimiter: str,
    where: tuple[object, int],
) -> tuple[tuple[str, ...], tuple[str, ...]]:  # fmt: skip
    """Return names and units of the columns from the lines above the numbers."""
    # A header may have another delimiter than the rows, for example commas above blanks.
    texts = dict(body)
    header = [(k, _named_cells(texts[k], columns, delimiter) or c) for k, c in header]
    units: tuple[str, ...] = ()
    names: tuple[str, ...] = ()
    for _, cells in reversed(header):
        if len(cells) == columns and not units and all(is_unit(cell) or not cell for cell in cells):
            units = tuple(cells)
        elif len(cells) == columns and not names:
            names = tuple(clean(cell) for cell in cells)
        elif len(cells) == columns and not _axes(names):
            if not units and _axes(cells) and any(map(is_unit, names)):  # not all units are known
                names, units = tuple(map(clean, cells)), names
            else:
                names = _below(cells, names)
    if not names and header and len(header[-1][1]) == columns - 1 and _axes(header[-1][1]):
        # `write.table` of R does not name the column of the row names.
        names = ("", *(clean(cell) for cell in header[-1][1]))
    for line in reversed(comments):
        if names and units:
            break
        # The cells of a comment that has one cell for each column; otherwise an empty list.
        text = line.strip()[len(comment_sign(line)) :].strip()
        text = re.sub(r"^(units?|columns?|fields?|header)\s*[:=]\s*", "", text, flags=re.IGNORECASE)
        cells = _cells(text, columns, delimiter)
        if cells and not units and all(is_unit(cell) for cell in cells):
            units = tuple(cells)
        elif cells and not names and any(recognise(cell).axis for cell in cells):
            names = tuple(cells)
    if not names and header and len(header[-1][1]) > 1:
        at, cells = header[-1]
        raise ReadError(
            f"{where[0]}: the header in line {at} names {len(cells)} columns, but line {where[1]} has {columns} values",
            code="header-mismatch",
            advice="Repair the header, or delete it and name the columns in their order with {--columns}.",
        )
    return names, units


def _axes(names: Sequence[str]) -> int:
    """Return the number of names that are known as an axis."""
    return sum(recognise(name).axis not in ("", "time", "temperature") for name in names)


def _below(groups: Sequence[str], names: tuple[str, ...]) -> tuple[str, ...]:
    """Combine two header lines, such as "Gyroscope" above "X (deg/s)". A merged cell names only its first column."""
    joined, group = [], ""
    for above, name in zip(groups, names, strict=True):
        group = clean(above) or group
        joined.append(f"{group} {name}".strip())
    return tuple(joined) if _axes(joined) else names


def _named_cells(line: str, columns: int, delimiter: str) -> list[str]:
    """Return the cells of a header, which can have its own delimiter; [] if no cell is a known name or a unit."""
    cells = _cells(line, columns, delimiter)
    return cells if any(recognise(cell).axis or is_unit(cell) for cell in cells) else []


def _cells(text: str, columns: int, delimiter: str) -> list[str]:
    """Split text into one cell for each column, by the delimiter of the rows, commas or blanks; [] if none fits."""
    ways = [split_line(text, delimiter), split_line(text, ",")]
    if not re.search(r"[,;\t|]", text):
        # A blank inside or before the brackets of "gyro_x [rad/s]" does not separate columns.
        ways.append(_NAME_IN_BLANKS.findall(text))
    fitting = [cells for way in ways if len(cells := _trim([clean(c) for c in way], columns)) == columns]
    return max(fitting, key=lambda cells: sum(bool(recognise(c).axis) for c in cells), default=[])


def _stated_units(comments: list[str]) -> dict[str, str]:
    """Return the units that comments state for a sensor, as "gyro in deg/s, accel in g" or "units: rad/s, m/s^2". A
    unit behind a number, as in "gyro range 250 dps", is not the unit of the columns."""
    units: dict[str, str] = {}
    for line in comments:
        text = _SIZE.sub(" ", _single_blanks(line).casefold())
        names_unit = "unit" in text
        for clause in re.split(r"[,;]|\band\b", text):
            about = "gyro" if re.search(r"gyr|angular|omega", clause) else ""
            about = about or ("accel" if re.search(r"acc|specific force", clause) else "")
            about = about or ("time" if re.search(r"\btime|stamp", clause) else "")
            words = re.findall(r"[\w°²/^.\-µμ]+", re.sub(r"(?<=\w) (?=[sh]\^?-)", "", clause))
            for quantity in (about,) if about else ("gyro", "accel") if names_unit else ():
                for word in words:
                    unit = unit_of(word.strip(".-"), quantity)
                    if unit and (about or word != "g") and not (quantity == "time" and not _is_clear(word, clause)):
                        units.setdefault(quantity, unit)
    return units


def _stated_rate(comments: list[str], preamble: list[str]) -> float | None:
    """Return the only rate (Hz) stated above the numbers, or None: in a comment, or alone as in "Fs,100"."""
    lines = [_single_blanks(line[:200]) for line in (*comments, *preamble)]
    # A comment without "Hz" may still state a rate; a title must have the unit.
    texts = [*lines[: len(comments)], *(line for line in lines[len(comments) :] if "hz" in line.casefold())]
    rates = {_as_rate(number, unit) for line in texts for number, unit in _RATE.findall(line)}
    for line in lines:
        if match := _RATE_LINE.fullmatch(line):
            rates.add(_as_rate(match[2], match[1] or match[3]))
        elif match := _INTERVAL_LINE.fullmatch(line):
            unit = find_time_unit(match[1] or match[3] or "s")
            rates.add(float(f"{TIME_UNITS[unit] / (float(match[2]) or math.inf):.12g}") if unit in TIME_UNITS else 0.0)
    return rates.pop() if len(rates) == 1 and min(rates) > 0 else None


def _as_rate(number: str, unit: str | None) -> float:
    return float(number) * (1e3 if (unit or "").lower().startswith("k") else 1)


def _single_blanks(line: str) -> str:
    """Replace each run of blanks by one blank. On long runs, the patterns would take very long."""
    return " ".join(line.split())


_RATE = re.compile(
    r"\b(?:(?:update|output|sampl(?:e|ing)|data)[ _]*(?:rate|frequency)|odr)\s*[:=,]?\s*(?:\(hz\)\s*[:=,]?)?\s*"
    r"(\d+(?:\.\d+)?)\s*(k)?(?:hz|sps|,|;|\s|$)",
    re.IGNORECASE,
)
_KEY = r"[#%/!\s\"']*"
_VALUE = r"[\"']?\s*[:=,;\s]\s*[\"']?(\d+(?:\.\d+)?(?:e[+-]?\d+)?)\s*"
_END = r"[\"',;\s]*"
_RATE_LINE = re.compile(
    rf"{_KEY}(?:(?:imu|update|output|sampl\w+|data|logging)?[ _-]*(?:rate|freq\w*)|fs|odr)[ _]*"
    rf"(?:[\[(]?(k?hz|sps)[\])]?)?{_VALUE}(k?hz|sps)?{_END}",
    re.IGNORECASE,
)
_INTERVAL_LINE = re.compile(
    rf"{_KEY}(?:dt|sampl\w+[ _-]*(?:interval|period|time))[ _]*(?:[\[(](\w+)[\])])?{_VALUE}([a-zµ]+)?{_END}",
    re.IGNORECASE,
)


def _is_clear(word: str, clause: str) -> bool:
    """Return whether a unit of time in a comment is that of the time stamps. Minutes and hours may be a duration."""
    stands_alone = re.search(rf"(\bin\s+|[\[(:=]\s*){re.escape(word)}\b", clause) is not None
    return word in _CLEAR or (word in _LONG and stands_alone)


_SIZE = re.compile(r"(?<![\w.^])(?<![a-z]-)[\d.]+ ?[a-z°µμ][\w°²/^.\-µμ]*")
_LONG = {"min", "minutes", "h", "hours", "days"}
_CLEAR = {"s", "ms", "us", "ns", "µs", "seconds", "milliseconds", "microseconds", "nanoseconds"}
