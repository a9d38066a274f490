"""Recognise forms of lines in text: names before numbers, decimal commas, and seconds apart from their fraction."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.base.errors import ReadError
from gmwm.base.units import AXES, TIME_UNITS
from gmwm.files.clock.missing_values import MISSING, is_missing
from gmwm.files.clock.text_stamps import is_stamp, is_time_of_day
from gmwm.files.columns.column_names import clean, is_unit, recognise, unit_of
from gmwm.files.contract import Rows

Replacement = tuple[bytes, bytes]  # pattern and text that replaces it

_SAMPLE, _WIDTH = 50, 1000  # number of lines that show the forms, and of their first characters
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])"
_WORD = r"[A-Za-z_][\w.]*"
_FIRST = rf"(?<![\w./°])(?<!\d )(?<!\d  ){_WORD}[ \t]+"  # the first of two words, which is not a unit behind a number
_BRACKET = r" ?[\[(][^\])\d][^\])]*[\])]"  # a unit
_LABEL = rf"(?:{_FIRST})?{_WORD}(?: [XYZxyz])?(?:(?:{_BRACKET})?\s*[:=]\s*|{_BRACKET}\s*(?=\[))"
_UNIT = r"[A-Za-zµ°][\w/^²°µ-]*"
_VALUE = rf"({_NUMBER}|[-+]?\d+\.?\d*(?= {{0,2}}{_UNIT}))(?: {{0,2}}({_UNIT})(?=[\s,;|]|$))?"
_ARROW = re.compile(r"\s*\d\d:\d\d:\d\d[.,]\d+ -> ")
_WEEK_SECONDS = r"(?<![\d:.])\d{3,4}:(?=\d{1,6}(?:\.\d*)?(?![\d:]))"
WEEK = (_WEEK_SECONDS.encode(), b"")  # replacement that removes the week from time stamps such as 2190:345600.005
COLOURS = (rb"\x1b\[[\d;]*m", b"")  # replacement that removes the colours that loggers write for terminals
MINUS = ("−(?=[\\d.])".encode(), b"-")  # replacement of the sign of typeset numbers

_TAG = re.compile(r"[$#]?[A-Za-z]\w*[,;\t ]")
_DIGITS = re.compile(r"^([01]\d|2[0-3])([0-5]\d)([0-5]\d)(\.\d{2,})(?=[,;\t])")  # hhmmss.ss, as in NMEA sentences
_MONTH = r"(?:Jan|Feb|Mar|Apr|May|Jun|Jul|Aug|Sep|Oct|Nov|Dec)[a-z]*"
_DATES = (
    rf"(?<![\d./-])\d\d?([-/. ])(?:\d\d?|{_MONTH})\1\d{{2,4}}[ T_-]+(?=\d\d?:\d\d)",
    rf"(?:(?:Mon|Tue|Wed|Thu|Fri|Sat|Sun)[a-z]*,? )?{_MONTH} +\d\d?(?:,? \d{{4}})?,? +(?=\d\d?:\d\d)",
    r"(?<=\d) \d{4}(?=[\"',;\t|]|$)",
)
_HALF = r"[ ]?[AaPp]\.?[Mm]\b\.?"
_TIMES: tuple[tuple[str, tuple[tuple[str, str], ...]], ...] = (
    *((date, ((date, ""),)) for date in _DATES[:1]),
    (_DATES[1], ((_DATES[1], ""), (_DATES[2], ""))),
    (
        rf"\d:\d\d(?:[.,]\d+)?{_HALF}",
        (
            *((rf"\b0?{h}(:\d\d:\d\d(?:[.,]\d+)?)[ ]?[Pp]\.?[Mm]\b\.?", rf"{h + 12}\1") for h in range(1, 12)),
            (r"\b12(:\d\d:\d\d(?:[.,]\d+)?)[ ]?[Aa]\.?[Mm]\b\.?", r"00\1"),
            (rf"(?<=\d){_HALF}", ""),
        ),
    ),
    *(
        (pattern, ((pattern, text),))
        for pattern, text in (
            (r"(\d\d:\d\d:\d\d):(\d{3}|\d{6})(?![\d:])", r"\1.\2"),
            (r"(\d{4}-\d\d-\d\d)[_ T](\d\d)[-.](\d\d)[-.](\d\d)[-._](\d{3,9})(?!\d)", r"\1T\2:\3:\4.\5"),
        )
    ),
)
"""Patterns of time stamps that other modules do not read, and replacements for them."""


@dataclass(frozen=True)
class LineForms:
    """Replacements in each line, and the names and units of the columns if each number has a label or a unit."""

    replacements: tuple[Replacement, ...] = ()
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    others: tuple[str, ...] = ()  # first words of lines that are left out

    def rewritten(self, line: str) -> str:
        """Return a line with all replacements."""
        for pattern, text in self.replacements:
            line = re.sub(pattern.decode(), text.decode(), line)
        return line


def plain_header(lines: Sequence[str]) -> list[str]:
    """Return the lines with the header of a LabVIEW measurement file as an interval, a row of units and one of names.
    Other lines stay. Source: National Instruments, "Specification for the LabVIEW Measurement File (.lvm)".

    >>> plain_header(["LabVIEW Measurement", "Delta_X\\t0,01\\t0,01", "X_Value\\tgx\\tComment", "0\\t0,5"])
    ['', 'dt,0.01', 'time\\tgx', '0\\t0,5']
    """
    if not lines[0].startswith("LabVIEW Measurement"):
        return list(lines)
    end = next((k for k, line in enumerate(lines) if line.startswith("X_Value")), 0)
    timed = "time" if re.search(r"(?m)^X_Columns\tNo\b", "\n".join(lines[:end])) is None else "X_Value"
    header = []
    for key, *cells in (line.split("\t") for line in lines[: end + 1]):
        names = [timed, *(cell for cell in cells if cell != "Comment")]
        interval = "".join(cells[:1]).replace(",", ".")
        rows = {"Y_Unit_Label": ["s", *cells], "Delta_X": [f"dt,{interval}"], "X_Value": names}
        header.append("\t".join(rows.get(key, [])))
    return [*header, *lines[end + 1 :]]


def line_forms(lines: Sequence[str]) -> LineForms:
    """Recognise the forms of the lines of a file.

    >>> line_forms(["ax: 0.1 g, gx: 2 dps"] * 4).names
    ('ax [g]', 'gx [dps]')
    >>> line_forms(["Scaled. Acc (mg) [ 1.0, 2.0, 3.0 ], Tmp (C) [ 5.0 ]"] * 4).names[2:]
    ('Scaled. Acc_z [mg]', 'Tmp [C]')
    >>> line_forms(["Gyr: 1 2 3 Acc: 4 5 6"] * 4).names[:4]
    ('Gyr_x', 'Gyr_y', 'Gyr_z', 'Acc_x')
    """
    sample = [line[:_WIDTH] for line in lines[len(lines) // 2 :][:_SAMPLE]]
    others = _other_lines(lines)
    replacements = [*_times(sample), *((rf"(?m)^{re.escape(word)}.*$".encode(), b"") for word in others)]
    if re.search(r"(?i)utc|hhmmss", "".join(lines[: len(lines) // 2][:20])) and all(map(_DIGITS.match, sample)):
        replacements.append((f"(?m){_DIGITS.pattern}".encode(), rb"\1:\2:\3\4"))
    half = len(sample) / 2
    if sum("," in line and line.rstrip().endswith(";") for line in sample) > half:
        replacements.append((rb"(?m);\s*$", b""))  # as in C
    arrows = sum(_ARROW.match(line) is not None for line in sample) > half
    if arrows:
        text = sample[-1].partition(" -> ")[2]
        sign = next((mark for mark in ",;\t" if mark in text), " ")
        replacements.append((rb" -> ", sign.encode()))
    weeks = [re.search(rf"{_WEEK_SECONDS}(\d+)", line) for line in sample]
    if sample and all(weeks) and any(int(match[1]) >= 60 for match in weeks if match):  # minutes have 60 seconds
        replacements.append(WEEK)
    readings = Counter(_labelled(line.partition(" -> ")[2] if arrows else line) for line in sample)
    names, units = max(readings, key=lambda reading: readings[reading], default=((), ()))
    if len(names) + len(units) < 2 or readings[names, units] <= half:
        return LineForms(tuple(replacements), others=others)
    spelt = "|".join(re.escape(unit) for unit in sorted({*units, *re.findall(r"\[(.*?)\]", " ".join(names))} - {""}))
    if spelt:
        replacements.append((rf"(?<=[\d.]) {{0,2}}(?:{spelt})(?=[\s,;|]|$)".encode(), b""))
    if names:
        replacements = [(old, b" " if old == b" -> " else new) for old, new in replacements]
        replacements += [(_LABEL.encode(), b""), (rb"(?m)^\s*[A-Z]?\s*[\[(](?=\d)|[\[\](){}]", b" ")]
        names = (*["time"] * arrows, *names)
        replacements.append((rb"(?<!:\d\d)[,;|]", b" "))  # but not a comma before a fraction of a second
    return LineForms(tuple(replacements), names, units, others)


def _other_lines(lines: Sequence[str]) -> tuple[str, ...]:
    """Return the first words of lines with another length than the lines that begin with the main word, the majority.

    >>> _other_lines(["$IMU,0.1,0.2"] * 9 + ["$GPS,47.0"] * 2)
    ('$GPS,',)
    """
    words = [match[0] if (match := _TAG.match(line)) else "" for line in lines]
    lengths = {word: {line.count(word[-1]) for line, w in zip(lines, words, strict=True) if w == word}
               for word, count in Counter(words).items() if word and count > 1}  # fmt: skip
    main = max(lengths, key=lambda word: words.count(word) * max(lengths[word]), default="")
    if not main or len(lengths[main]) > 1 or 2 * words.count(main) < len(lines):
        return ()
    return tuple(word for word, others in lengths.items() if others.isdisjoint(lengths[main]))


def _times(sample: Sequence[str]) -> Iterator[Replacement]:
    """Yield the replacements for time stamps in a form that most lines have. Blanks must not separate the columns."""
    for pattern, replacements in _TIMES:
        if 2 * sum(
            re.search(pattern, line) is not None and re.search(r"[,;\t|]|->", line) is not None for line in sample
        ) > len(sample):
            yield from ((f"(?m){old}".encode(), new.encode()) for old, new in replacements)


def _labelled(line: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return names of numbers from their labels, or from units behind them; both are empty for other lines."""
    head, *pieces = re.split(f"({_LABEL})", line.strip())
    head = re.sub(r"^[A-Z]?\s*[\[(]?(\d+(?:\.\d+)?)[\])]?", r"\1", head.strip())
    names: list[tuple[str, str, str]] = []  # name, unit, and the words before the axis
    if pieces and head and not re.fullmatch(_NUMBER, head):
        names = [("time" if is_time_of_day(word) else "(text)", "", "") for word in head.split()]
        if "time" not in [name for name, _, _ in names]:
            return (), ()
        head = ""
    sensor = ""
    for label, body in zip(["time", *pieces[::2]], [head, *pieces[1::2]], strict=True):
        values = re.findall(_VALUE, body)
        if re.sub(r"[\s,;|()\[\]{}%]", "", re.sub(_VALUE, "", body)) or not all(
            is_unit(unit) for _, unit in values if unit
        ):
            return (), ()
        units = [unit for _, unit in values]
        if not pieces:
            return (), (tuple(units) if any(units) else ())
        if label == "time" and not body.strip():
            continue
        words, _, unit = label.rstrip(" \t:=)]").partition("(" if "(" in label else "[")
        stem, units = words.strip(), [value or unit for value in units]
        if sensor and stem in ("X", "Y", "Z", "x", "y", "z"):  # Acceleration X: 0.1, Y: 0.2, Z: 9.8
            stem = f"{sensor}_{stem}"
        else:
            sensor = stem if len(values) != 1 else re.sub("[ _]?[XYZxyz]$", "", stem)
        triple = [f"{stem}_{letter}" for letter in "xyz"] if len(values) == 3 else [stem]
        if len(values) not in (0, 1, 3):
            return (), ()
        names += [(name, unit, sensor) for name, unit in zip(triple, units, strict=False)]
    shared = {sensor: unit for _, unit, sensor in names if unit and sensor}  # the unit behind the last axis
    stated = [(name, unit or shared.get(sensor, "")) for name, unit, sensor in names]
    return tuple(f"{name} [{unit}]" if unit else name for name, unit in stated), ()


def first_of_sample(lines: Sequence[str]) -> str:
    """Return the shape of a sample's first line if several lines have it (examples of libraries); otherwise "".

    >>> first_of_sample(["Gyro x: 1 y: 2", "Acc x: 3 y: 4"] * 9)
    'Gyro x: # y: #'
    """
    lines = [line[:_WIDTH].strip() for line in lines if line.strip()]
    shapes = list(map(shape_of, lines))
    counts = Counter(shapes)
    often = max(counts.values(), default=0) / 6  # a shape may occur several times in a sample
    for first in dict.fromkeys(shape for shape in shapes if counts[shape] > max(often, 8)):
        places = [k for k, shape in enumerate(shapes) if shape == first]
        period, count = Counter(after - before for before, after in pairwise(places)).most_common(1)[0]
        names, _ = _labelled(as_one_line(lines[places[-2] : places[-1]] if period > 1 else []))
        axes = [recognise(name).axis for name in names if recognise(name).axis in AXES]
        if axes and len(set(axes)) == len(axes) and count > 0.8 * (len(places) - 1):
            return first
    return ""


def as_one_line(lines: Iterable[str]) -> str:
    """Return the lines of a sample as one line with one time, without those that have neither a number nor a label."""
    first, *others = [line.strip() for line in lines if re.search(r"\d|[:=]\s*$", line)] or [""]
    return "; ".join([first, *(re.sub(r"^[A-Z]? ?[\[(]\d+(?:\.\d+)?[\])]", "", line) for line in others)])


def shape_of(line: str) -> str:
    """Return a line with # in place of each number."""
    return re.sub(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?", "#", line[:_WIDTH]).strip()


_PLAIN_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_MOST_ROWS = 4096  # number of rows in which seconds and fractions are compared


@dataclass(frozen=True)
class StampParts:
    """Columns of seconds and of fractions, and fractions per second (1 for decimals)."""

    seconds: int
    fraction: int
    per_second: int

    def join(self, rows: Rows, path: object) -> NDArray[np.int64]:
        """Return the time stamps (ns)."""
        parts = [np.asarray(rows[k]) for k in (self.seconds, self.fraction)]
        masks = [is_missing(part) for part in parts]
        away = np.any([np.zeros(parts[0].size, dtype=bool) if mask is None else mask for mask in masks], axis=0)
        parts = [np.where(away, 0, part) for part in parts]
        per_second = self.per_second if self.per_second > 1 else 10**9
        if self.per_second == 1:
            parts[1] = np.rint(parts[1] * 1e9)
        seconds, fraction = (part.astype(np.int64) for part in parts)
        if np.any((fraction < 0) | (fraction >= per_second)):
            raise ReadError(
                f"{path}: the fractions of a second in column number {self.fraction} reach {fraction.max()}, and "
                f"{per_second} are a second",
                code="time-implausible",
                advice="Name the time column with {--columns}, or leave it out with {--columns=time:none} and pass "
                "{--rate}.",
            )
        return np.where(away, MISSING, seconds * 10**9 + fraction * (10**9 // per_second))


def find_parts(names: Sequence[str], rows: Sequence[Sequence[str]]) -> StampParts | None:
    """Find columns of two-part stamps by names or units; the fraction begins again in each second."""
    columns = [k for k, name in enumerate(names) if not recognise(name).axis.startswith(("gyro", "accel"))]
    seconds = {k for k in columns if _may_be_seconds(names[k])}
    fractions = [k for k in columns if _units(names[k]) > 1]
    for k in sorted(columns, key=lambda k: k not in seconds):
        for other in columns if k in seconds else fractions:
            if other != k and (parts := _fitting(k, other, names[other], rows[:_MOST_ROWS])) is not None:
                return parts
    return None


def _may_be_seconds(name: str) -> bool:
    """Return whether a name can be that of whole seconds: a time without a unit or in seconds."""
    words = re.split(r"[^a-z]+", clean(name).casefold())
    column = recognise(name)
    return (column.axis == "time" and column.unit in ("", "s")) or words[-1] in ("sec", "secs", "seconds", "s")


def _fitting(k: int, other: int, name: str, rows: Sequence[Sequence[str]]) -> StampParts | None:
    """Return the parts if the numbers of column `other` are fractions of the seconds in column `k`."""
    cells = [(row[k], row[other]) for row in rows if row[k] and row[other]]
    if len(cells) < 2 or any(len(cell) > 24 or not _PLAIN_NUMBER.fullmatch(cell) for pair in cells for cell in pair):
        return None
    seconds, fraction = np.array(cells, dtype=np.float64).T
    steps = np.diff(seconds)
    if fraction.min() < 0 or np.any(steps < 0) or np.any(seconds % 1) or abs(seconds[-1]) > 1e11:
        return None
    stated = _units(name)
    if fraction.max() < 1 and np.any(fraction > 0):
        parts = _fitting_units(seconds, fraction, 1)
        return StampParts(k, other, 1) if parts else None
    if np.any(fraction % 1):
        return None
    if not np.any(steps):  # all rows are of one second: the name of the fraction decides
        fits = stated > 1 and fraction.max() < stated and np.median(np.diff(fraction)) > 0
        return StampParts(k, other, stated) if fits else None
    units = (stated,) if stated > 1 else (10**3, 10**6, 10**9)
    return next((StampParts(k, other, unit) for unit in units if _fitting_units(seconds, fraction, unit)), None)


def _fitting_units(seconds: Vector, fraction: Vector, per_second: int) -> bool:
    """Return whether a fraction in these units continues from one second to the next."""
    steps = np.diff(seconds)
    within = np.diff(fraction)[steps == 0]
    if not within.size or np.median(within) <= 0 or np.any(np.diff(fraction)[steps == 1] >= 0):
        return False
    joined = steps * per_second + np.diff(fraction)
    # Between two seconds, the interval is that within a second, but for lost samples.
    between = np.median(joined[steps == 1]) if np.any(steps == 1) else 0
    return bool(fraction.max() < per_second and 0.5 * np.median(within) <= between <= 2 * np.median(within))


def _units(name: str) -> int:
    """Return the number of units in a second that the last word of a name states; 0 if it states none."""
    return TIME_UNITS.get(unit_of(_last_word(name), "time"), 0)


def _last_word(name: str) -> str:
    """Return the last word of a name, which may be a unit of time; the whole bracket if the name has one.

    >>> _last_word("time_nsec"), _last_word("usec"), _last_word("stamp [ns]")
    ('nsec', 'usec', 'ns')
    """
    words = re.split(r"[^a-zµ]+", clean(name).casefold())
    return next((word for word in reversed(words) if word), "")


_CELL = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE)
_POINT_GROUPS = re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+(,\d*)?")
_COMMA_GROUPS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?")
WITHOUT_GROUPS = (rb"(?<=\d),(?=\d{3}(?!\d))", b"")  # replacement that removes the commas between thousands

# Points between thousands before a decimal comma, as in 1.234.567,8; a number cannot have both signs otherwise.
WITHOUT_POINTS = (rb"(?<=\d)(?<!\d{4})\.(?=\d{3}(?:\.\d{3})*,\d)", b"")


def is_number(cell: str, decimal_comma: bool = False) -> bool:
    """Return whether a cell is a number, NaN or infinity."""
    return _CELL.fullmatch(cell.replace(",", ".", 1) if decimal_comma else cell) is not None


def is_grouped(cell: str) -> bool:
    """Return whether a cell may be a number whose points separate thousands, as programs with a decimal comma write it.

    >>> [cell for cell in ("5.000", "1.234.567,8", "0.500", "9.81", "5,000") if is_grouped(cell)]
    ['5.000', '1.234.567,8']
    """
    return _POINT_GROUPS.fullmatch(cell) is not None


def require_clear_commas(rows: Sequence[Sequence[str]], names: Sequence[str], where: str) -> None:
    """Raise an error if the commas of a column may separate thousands: exactly three digits follow each of them, and
    the file has decimal points too, or no comma that must be a decimal sign."""
    columns = list(zip(*rows, strict=True))
    commas = [[cell for cell in column if "," in cell and not is_stamp(cell)] for column in columns]
    grouped = [bool(cells) and all(map(_COMMA_GROUPS.fullmatch, cells)) for cells in commas]
    points = any("." in cell and is_number(cell) for column in columns for cell in column)
    proven = any(cells and not group for cells, group in zip(commas, grouped, strict=True))
    if not any(grouped) or (proven and not points):
        return
    k = grouped.index(True)
    cell, reason = commas[k][0], "decimal points" if points else "no other decimal sign"
    raise ReadError(
        f"{where}: {cell!r} in column {names[k] if names else k!r} may be {cell.replace(',', '')} or "
        f"{cell.replace(',', '.', 1)}, because three digits follow each comma, and the file has {reason}",
        code="decimal-comma",
        advice="State what the comma is: {--format=text:thousands} or {--format=text:decimal-comma}.",
    )
