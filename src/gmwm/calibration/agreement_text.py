"""The agreement of recordings in words: their numbers side by side, those that differ, and the maker's beside them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Literal

from gmwm._tables import headed
from gmwm._text import counted
from gmwm.calibration.tables import WIDTH, bulleted, key, number, wrapped
from gmwm.variance.slope_line import LAWS

if TYPE_CHECKING:
    from gmwm.calibration.agreement_result import Agreement, SharedNumber

_NONE = "–"
_ABSENT, _FAILED = "not recorded", "not calibrated"
_SAME, _OTHER = "=", "≠"
_ANSWERS = {True: _SAME, False: _OTHER, None: ""}
_LOWEST: Literal["B"] = "B"
_RAMP = "R"


def summary(found: Agreement) -> str:
    """The whole text, at most 80 columns wide."""
    heads, named = _heads(found)
    parts = [[*wrapped(_head(found)), *named]]
    parts += [[axis, *_fitting(heads, lambda *part, axis=axis: _rows(found, axis, *part))] for axis in found.models]
    parts.append(wrapped(_legend(found)))
    if found.disagreeing:
        said = [line for row in found.disagreeing for line in bulleted(_difference(found, row))]
        parts.append(["These differ by more than their intervals allow:", *said])
    if advice := _advice(found):
        parts.append(["What to know of it:", *(line for text in advice for line in bulleted(text))])
    if referred := [row for row in found.rows if row.reference is not None]:
        table = _fitting(heads, lambda *part: _beside(found, referred, *part))
        parts.append(["Beside the reference values: ours / theirs", *table, *wrapped(_about_reference(referred))])
    return "\n\n".join("\n".join(lines) for lines in parts if lines)


def _head(found: Agreement) -> str:
    compared, differ = len(found.compared), len(found.disagreeing)
    verdict = "all agree" if not differ else f"{differ} {'does' if differ == 1 else 'do'} not agree"
    if not compared:
        verdict = "no verdict"
    return (
        f"Agreement of {len(found.labels)} recordings: {counted(compared, 'number')} compared, {verdict} "
        f"(test of all together at {100 * found.size:g} %)"
    )


def _heads(found: Agreement) -> tuple[list[str], list[str]]:
    """What stands above the columns, and what that means: long names get numbers."""
    if sum(len(label) + 2 for label in found.labels) <= WIDTH - 24:
        return list(found.labels), []
    numbers = [f"({k})" for k in range(1, len(found.labels) + 1)]
    return numbers, [line for k, label in zip(numbers, found.labels, strict=True) for line in wrapped(f"{k} {label}")]


def _fitting(heads: Sequence[str], rows: Callable[[Sequence[str], range], list[list[str]]]) -> list[str]:
    """A table with a column for each recording; as many side by side as there is room for."""
    lines: list[str] = []
    for count in range(len(heads), 0, -1):
        lines = []
        for start in range(0, len(heads), count):
            part = range(start, min(start + count, len(heads)))
            lines += [*([""] if lines else []), *headed(rows([heads[k] for k in part], part))]
        if max(map(len, lines)) <= WIDTH:
            break
    return lines


def _rows(found: Agreement, axis: str, heads: Sequence[str], part: range) -> list[list[str]]:
    models = found.models[axis]
    # The verdict stands beside the last recording.
    end = part.stop == len(found.labels)
    rows = [["", *heads, *([""] if end else [])]]
    there = [_why_absent(found, axis, k) if (model := models[k]) is None else model.replace(" ", "") for k in part]
    rows.append(["model", *there, *([""] if end else [])])
    for row in found.rows:
        if row.axis != axis or row.reason == "models":
            continue
        shown = ["" if models[k] is None else _cell(found, row, k) for k in part]
        rows.append([f"{row.symbol} ({_unit(row)})", *shown, *([_ANSWERS[row.agrees]] if end else [])])
    return rows


def _why_absent(found: Agreement, axis: str, k: int) -> str:
    """Of an axis that a recording gives no model for."""
    return _FAILED if found.labels[k] in found.failed.get(axis, ()) else _ABSENT


def _cell(found: Agreement, row: SharedNumber, k: int) -> str:
    """A number of one recording, or why there is none."""
    entry = row.entries[k]
    if entry is not None:
        return number(entry)
    return _NONE if found.models[row.axis][k] is not None else _why_absent(found, row.axis, k)


def _unit(row: SharedNumber) -> str:
    return next(entry.in_units("datasheet")[3] for entry in row.entries if entry is not None)


def _difference(found: Agreement, row: SharedNumber) -> str:
    values = ", ".join(_cell(found, row, k) for k in range(len(row.entries)))
    apart = "" if row.apart is None else f", {_percent(row.apart)} apart"
    sign = "< 0.001" if row.adjusted is None or row.adjusted < 0.001 else f"= {row.adjusted:.3f}"
    return f"{row.axis} {row.symbol}: {values} {_unit(row)}{apart}; p {sign}"


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if share < 1 else f"{1 + share:.2g} times"


def _legend(found: Agreement) -> str:
    shown = (entry for row in found.rows if row.reason != "models" for entry in row.entries)
    named = key(entry for entry in shown if entry is not None)
    return (
        f"{named}. ±: half its interval; ≤: upper limit; {_NONE}: its model has none. {_SAME}, {_OTHER}: one value "
        "explains them all, or does not; p: of such a difference by chance, with all numbers in mind."
    )


def _advice(found: Agreement) -> list[str]:
    said = []
    if differ := [axis for axis, models in found.models.items() if len({m for m in models if m is not None}) > 1]:
        said.append(
            f"{', '.join(differ)}: the recommended models differ, so that only {', '.join(LAWS)} are compared there. "
            "The intervals are of each model as it is, and do not know of another one"
        )
    if kinds := [f"{row.axis} {row.symbol}" for row in found.rows if row.reason == "kinds"]:
        said.append(
            f"{', '.join(kinds)}: in some recordings the coefficient of flicker noise, in others the lowest point of "
            "the curve, and so not compared"
        )
    if found.rejected:
        axes = ", ".join(_of_which(found, axis, labels) for axis, labels in found.rejected.items())
        said.append(
            f"a test of the fit rejects the model of {axes}: intervals are too narrow there, and numbers may differ by "
            "more than they allow with nothing changed but the disturbance"
        )
    if any(row.symbol == _RAMP for row in found.disagreeing):
        said.append("a ramp is that of its recording: of how the sensor warmed up, and not of the sensor")
    lone = {row.axis: "" for row in found.rows if row.reason == "one recording"}
    if single := [f"{row.axis} {row.symbol}" for row in found.rows if row.reason == "one recording"]:
        shown = ", ".join(single) if len(single) <= 6 else f"{len(single)} numbers of {', '.join(lone)}"
        said.append(f"in one recording only: {shown}")
    if found.unmatched:
        said.append(f"no recording gives a number for the reference of {', '.join(found.unmatched)}")
    return said


def _of_which(found: Agreement, axis: str, labels: Sequence[str]) -> str:
    """An axis, and the recordings if it is not all that have it."""
    whole = sum(model is not None for model in found.models[axis])
    return axis if len(labels) == whole else f"{axis} ({', '.join(labels)})"


def _beside(found: Agreement, rows: Sequence[SharedNumber], heads: Sequence[str], part: range) -> list[list[str]]:
    table = [["", "theirs", *heads]]
    for row in rows:
        cells = []
        for k in part:
            entry, ratio = row.entries[k], row.ratios[k]
            limit = "≤ " if entry is not None and entry.upper_only else ""
            if entry is None:
                cells.append(_cell(found, row, k))
            else:
                cells.append(_NONE if ratio is None or not math.isfinite(ratio) else f"{limit}{ratio:.3g}")
        table.append([f"{row.axis} {row.symbol}", str(row.reference), *cells])
    return table


def _about_reference(rows: Sequence[SharedNumber]) -> str:
    entries = [entry for row in rows if row.symbol == _LOWEST for entry in row.entries]
    if all(entry is None or entry.term is not None for entry in entries):
        return ""
    factor = LAWS[_LOWEST].factor
    return (
        f"{_LOWEST} is the lowest Allan deviation over {factor:.3f}, as the standard has it. Many makers state the "
        f"lowest Allan deviation itself: if this one does, {factor:.3f} times the ratio is the one to look at."
    )
