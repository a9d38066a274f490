"""The page of a study: its question, three sentences, a picture and a table; an appendix has the rest."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

SENTENCES = 3
"""Largest number of sentences on a page."""
ROWS = 2
"""Largest number of rows of the table on a page."""
GOLDEN = (5**0.5 - 1) / 2


def page(study: ModuleType, result: Mapping[str, Any]) -> str:
    """The page of a study as Markdown. All that is on it comes from the result."""
    blocks = [block for block in study.table(dict(result)).strip().split("\n\n") if not block.startswith("#")]
    parts = [f"# {question(study)}", *_sentences(blocks)]
    parts += [block for block in blocks if block.startswith("![")][:1]
    table = next((block.splitlines() for block in blocks if block.startswith("|")), [])
    rows = table[2:]
    if rows:
        parts.append("\n".join([*table[:2], *_spread(rows)]))
    return "\n\n".join([*parts, _foot(study, result, len(rows))]) + "\n"


def appendix(study: ModuleType, result: Mapping[str, Any]) -> str:
    """All that a study found, as Markdown without a title."""
    return re.sub(r"\A# .*\n+", "", study.table(dict(result)).strip()) + "\n"


def question(study: ModuleType) -> str:
    """The first line of the docstring of a study."""
    return (inspect.getdoc(study) or study.NAME).splitlines()[0].removesuffix(".")


def write(study: ModuleType, result: Mapping[str, Any], directory: Path) -> None:
    """Write the page of a study again."""
    (directory / f"{study.NAME}.md").write_text(page(study, result), encoding="utf-8")


def _sentences(blocks: list[str]) -> list[str]:
    paragraph = next((block for block in blocks if re.match(r"[A-Z0-9`]", block)), "")
    found = re.split(r"(?<=[.?]) (?=[A-Z`])", " ".join(paragraph.split()))
    return [" ".join(found[:SENTENCES])] if paragraph else []


def _spread(rows: list[str]) -> list[str]:
    """Some rows, in their order. Multiples of the golden ratio meet no period of the table."""
    if len(rows) <= ROWS:
        return rows
    places = sorted(int(len(rows) * (k * GOLDEN % 1)) for k in range(ROWS))
    return [rows[place] for place in places]


def _foot(study: ModuleType, result: Mapping[str, Any], rows: int) -> str:
    reduced = "--reduced " if result["reduced"] else ""
    every = f"all {rows} rows" if rows > ROWS else "all tables"
    return f"Seed {study.SEED}; `python -m validation {reduced}{study.NAME}`, `--tables` for {every}."
