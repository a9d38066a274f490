"""Tables of the pages: their lines, and what each of their columns means."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any


def legend(columns: Mapping[str, str], title: str = "The columns:") -> list[str]:
    """Return Markdown lines with a blank line above: a list of the columns with the meaning of each."""
    return ["", title, "", *(f"- **{name}**: {meaning}." for name, meaning in columns.items())]


def table_lines(head: str, row: str, rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the lines of a Markdown table: its head, and a line for each row by the template `row`, which names keys,
    as `{0[GM.beta]}` if a key has a dot.

    >>> table_lines("| n | share |", "| {n} | {share:.0%} |", [{"n": 3, "share": 0.5}])
    ['| n | share |', '|---|---|', '| 3 | 50% |']
    """
    return [head, re.sub(r"[^|]+", "---", head), *(row.format(values, **values) for values in rows)]
