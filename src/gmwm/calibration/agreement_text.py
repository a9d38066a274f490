"""Format an `Agreement` as text: the verdict, the numbers side by side, the remarks and the reference values."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Literal

from gmwm.base.remarks import Dialect, texts
from gmwm.base.text import TEXT_WIDTH, round_text, table_with_rule
from gmwm.calibration.tables import bullet, key, number, wrap_text
from gmwm.measuring.variance.allan_regression import LAWS

if TYPE_CHECKING:
    from gmwm.calibration.agreement_result import Agreement, SharedNumber

_NONE = "–"
_ABSENT, _FAILED = "not recorded", "not calibrated"
_SAME, _OTHER = "=", "≠"
_ANSWERS = {True: _SAME, False: _OTHER, None: ""}
_LOWEST: Literal["B"] = "B"


def summary(found: Agreement, dialect: Dialect = Dialect.PYTHON) -> str:
    """Return the verdict, a table for each axis, the remarks and the reference values as text of at most 80 columns."""
    heads, names = _heads(found)
    parts = [[*wrap_text(found.verdict.text(dialect)), *names]]
    parts += [[axis, *_fitting(heads, lambda *part, axis=axis: _rows(found, axis, *part))] for axis in found.models]
    parts.append(wrap_text(_legend(found)))
    if remarks := texts(found.remarks, dialect):
        parts.append(["What to know about the comparison:", *(line for text in remarks for line in bullet(text))])
    if referred := [row for row in found.rows if row.reference is not None]:
        table = _fitting(heads, lambda *part: _beside(found, referred, *part))
        parts.append(
            ["Ratio of the measured values to the reference values:", *table, *wrap_text(_about_reference(referred))]
        )
    return "\n\n".join("\n".join(lines) for lines in parts if lines)


def _heads(found: Agreement) -> tuple[list[str], list[str]]:
    """Return the column headings, and lines that explain them. If the names of the recordings are too long for a table,
    the headings are numbers, and the lines list the names."""
    if sum(len(label) + 2 for label in found.labels) <= TEXT_WIDTH - 24:
        return list(found.labels), []
    numbers = [f"({k})" for k in range(1, len(found.labels) + 1)]
    return numbers, [line for k, label in zip(numbers, found.labels, strict=True) for line in wrap_text(f"{k} {label}")]


def _fitting(heads: Sequence[str], rows: Callable[[Sequence[str], range], list[list[str]]]) -> list[str]:
    """Return a table with a column for each recording, split into several tables if too wide. `rows` returns the rows
    for the headings and the range of some recordings."""
    lines: list[str] = []
    for count in range(len(heads), 0, -1):
        lines = []
        for start in range(0, len(heads), count):
            part = range(start, min(start + count, len(heads)))
            lines += [*([""] if lines else []), *table_with_rule(rows([heads[k] for k in part], part))]
        if max(map(len, lines)) <= TEXT_WIDTH:
            break
    return lines


def _rows(found: Agreement, axis: str, heads: Sequence[str], part: range) -> list[list[str]]:
    models = found.models[axis]
    # The result of the test is in a column after the last recording.
    end = part.stop == len(found.labels)
    rows = [["", *heads, *([""] if end else [])]]
    shown = [_why_absent(found, axis, k) if (model := models[k]) is None else model.replace(" ", "") for k in part]
    rows.append(["model", *shown, *([""] if end else [])])
    for row in found.rows:
        if row.axis != axis or not _is_shown(found, row):
            continue
        cells = ["" if models[k] is None else _cell(found, row, k) for k in part]
        rows.append([f"{row.symbol} ({_unit(row)})", *cells, *([_ANSWERS[row.agrees]] if end else [])])
    return rows


def _is_shown(found: Agreement, row: SharedNumber) -> bool:
    """Return whether a number can be compared, or belongs to the only recording of its axis."""
    alone = sum(model is not None for model in found.models[row.axis]) == 1
    return row.reason != "models" and (row.reason != "one recording" or alone)


def _why_absent(found: Agreement, axis: str, k: int) -> str:
    """Return the reason why a recording has no model for an axis."""
    return _FAILED if found.labels[k] in found.failed.get(axis, ()) else _ABSENT


def _cell(found: Agreement, row: SharedNumber, k: int) -> str:
    """Format the number in recording `k`, or the reason why there is none."""
    entry = row.entries[k]
    if entry is not None:
        return number(entry)
    return _NONE if found.models[row.axis][k] is not None else _why_absent(found, row.axis, k)


def _unit(row: SharedNumber) -> str:
    return next(entry.in_units("datasheet")[3] for entry in row.entries if entry is not None)


def _legend(found: Agreement) -> str:
    shown = (entry for row in found.rows if _is_shown(found, row) for entry in row.entries)
    named = key(entry for entry in shown if entry is not None)
    return (
        f"{named}. N, K, Q and B are compared whatever the models are; numbers of a single recording are left out. "
        f"±: half the width of the confidence interval; ≤: upper limit; {_NONE}: not in the model. "
        f"{_SAME}: the recordings agree; {_OTHER}: they differ by more than chance. p: adjusted by Holm's method."
    )


def _beside(found: Agreement, rows: Sequence[SharedNumber], heads: Sequence[str], part: range) -> list[list[str]]:
    table = [["", "reference", *heads]]
    for row in rows:
        cells = []
        for k in part:
            entry, ratio = row.entries[k], row.ratios[k]
            limit = "≤ " if entry is not None and entry.upper_only else ""
            if entry is None:
                cells.append(_cell(found, row, k))
            else:
                cells.append(_NONE if ratio is None or not math.isfinite(ratio) else f"{limit}{round_text(ratio, 3)}")
        table.append([f"{row.axis} {row.symbol}", str(row.reference), *cells])
    return table


def _about_reference(rows: Sequence[SharedNumber]) -> str:
    entries = [entry for row in rows if row.symbol == _LOWEST for entry in row.entries]
    if all(entry is None or entry.term is not None for entry in entries):
        return ""
    factor = LAWS[_LOWEST].factor
    return (
        f"{_LOWEST} is the minimum of the Allan deviation divided by {factor:.3f}, as in the standard. Many datasheets "
        f"state the minimum itself: multiply the ratio by {factor:.3f} in this case."
    )
