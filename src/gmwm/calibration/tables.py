"""Tables and texts of at most 80 columns for the summaries of calibrations."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from gmwm.base.text import TEXT_WIDTH, round_text, table_with_rule, with_minus, wrap_text
from gmwm.calibration.number_verdicts import NumberVerdict
from gmwm.fitting.inference.planning import CERTAIN_ERROR
from gmwm.measuring.variance.allan_regression import LAWS

if TYPE_CHECKING:
    from gmwm.choosing.datasheets import Entry

SENSORS = {"gyro": "Gyroscopes", "accel": "Accelerometers"}  # headings of the tables, by sensor


def merge_names(lists: Sequence[Sequence[str]]) -> list[str]:
    """Merge lists of names without duplicates, in the order of each list where possible; the longer list decides."""
    order: list[str] = []
    for names in sorted(lists, key=len, reverse=True):
        at = 0
        for name in names:
            if name not in order:
                order.insert(at, name)
            at = order.index(name) + 1
    return order


def in_order(lists: Sequence[Sequence[str]]) -> list[str]:
    """Merge the symbols of several datasheets: first N and K of a filter and B, then the rest of IEEE Std 952."""
    order = list(dict.fromkeys(("N", "K", "B", *map(str, LAWS))))
    return sorted(merge_names(lists), key=lambda symbol: order.index(symbol) if symbol in order else len(order))


def key(entries: Iterable[Entry]) -> str:
    """Return a legend of the symbols of some entries. A symbol with two meanings has both titles."""
    titles: dict[str, dict[str, None]] = {}
    for entry in entries:
        if " of " not in entry.symbol or entry.title.endswith("which N contains"):
            titles.setdefault(entry.symbol.partition("[")[0], {})[entry.title] = None
    return "; ".join(f"{symbol} {' or '.join(named)}" for symbol, named in titles.items())


def number(entry: Entry) -> str:
    """Format a number with half its interval in %, with both parts or ends if uneven or wide, or as a limit."""
    value, low, high, _ = entry.in_units("datasheet")
    if entry.held:
        return f"{round_text(value, 3)} fixed"
    if low is None or high is None:
        return round_text(value, 3)
    if not math.isfinite(high):
        return "not determined"
    if entry.upper_only:
        return f"{'≤ ' if low >= 0 else '≤ ±'}{round_text(high, 3)}"
    half = (high - low) / 2
    if half > CERTAIN_ERROR * abs(value):
        return f"{round_text(low)} … {round_text(high)}"
    if not value:
        return round_text(value, 3)
    below, above, half = (100 * part / abs(value) for part in (value - low, high - value, half))
    if max(below, above) > 2 * min(below, above):
        # Both parts have the decimals of the larger one.
        decimals = max(0, 1 - math.floor(math.log10(max(below, above))))
        upper, lower = (
            round_text(part, 1) if 1e-6 < part < 0.5 * 10**-decimals else f"{part:.{decimals}f}"
            for part in (above, below)
        )
        return f"{round_text(value, 3)} +{upper}/−{lower} %"
    return f"{round_text(value, 3)} ± {round_text(half)} %"


def marked(entry: Entry, verdict: NumberVerdict | None) -> str:
    """Format a number like `number`, with ✗ if a remark refuses it."""
    return f"{number(entry)} {verdict.usability.mark}" if verdict and verdict.refused else number(entry)


def with_error(entry: Entry) -> str:
    """Format a signed number with half the width of its confidence interval."""
    value, low, high, _ = entry.in_units("datasheet")
    if low is None or high is None or not math.isfinite(high - low):
        return "not determined"
    half = (high - low) / 2
    digits = max(0, 1 - math.floor(math.log10(half))) if half > 0 else 3
    shown = round(value, digits) + 0.0  # no minus sign before zero
    return with_minus(f"{shown:.{digits}f} ± {half:.{digits}f}")


def fitting_tables(
    heads: Sequence[str], rows: Callable[[Sequence[str], range], list[list[str]]], most: int | None = None
) -> list[str]:
    """Return a table with a column for each head, or several with up to `most` if it is wider than 80 columns; `rows`
    makes the rows of some of the columns."""
    lines: list[str] = []
    for count in range(most or len(heads), 0, -1):
        lines = []
        for start in range(0, len(heads), count):
            part = range(start, min(start + count, len(heads)))
            lines += [*([""] if lines else []), *table_with_rule(rows([heads[k] for k in part], part))]
        if max(map(len, lines)) <= TEXT_WIDTH:
            break
    return lines


def short_heads(labels: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return column headings and their explanation; labels that are too long for a table become numbers."""
    if sum(len(label) + 2 for label in labels) <= TEXT_WIDTH - 24:
        return list(labels), []
    numbers = [f"({k})" for k in range(1, len(labels) + 1)]
    return numbers, [line for k, label in zip(numbers, labels, strict=True) for line in wrap_text(f"{k} {label}")]
