"""The page of a study: its question, three sentences, a picture and a table; an appendix has the rest."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

SENTENCES = 3
"""Largest number of sentences on a page."""
ROWS = 2
"""Largest number of rows of the table on a page."""
GOLDEN = (5**0.5 - 1) / 2


def page(study: ModuleType, result: Mapping[str, Any]) -> str:
    """The page of a study as Markdown. All that is on it comes from the result, and from `further()` of the study."""
    blocks = [block for block in study.table(dict(result)).strip().split("\n\n") if not block.startswith("#")]
    parts = [f"# {question(study)}", *_sentences(blocks)]
    parts += [block for block in blocks if block.startswith("![")][:1]
    table = next((block.splitlines() for block in blocks if block.startswith("|")), [])
    rows = table[2:]
    if rows:
        parts.append("\n".join([*table[:2], *_spread(rows)]))
    if further := getattr(study, "further", None):
        parts.append(further())
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


def draw_coverage(bars: Sequence[tuple[str, float, int]], path: Path) -> None:
    """Draw the share of intervals that contain the true value, with twice its standard error, beside 95 %. `bars` are
    texts, shares and numbers of runs."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.5, 0.6 + 0.2 * len(bars)), layout="constrained")
    axes = figure.subplots()
    for place, (_, share, runs) in enumerate(bars):
        # At a share of 0 or 1 the error of one run more or less remains.
        error = 2 * (max(share * (1 - share), 1 / runs) / runs) ** 0.5
        axes.errorbar(100 * share, place, xerr=100 * error, fmt="o", color="C0", markersize=4)
    axes.axvline(95, color="black", linewidth=0.8)
    axes.set_yticks(range(len(bars)), [text for text, _, _ in bars], fontsize=8)
    axes.invert_yaxis()
    axes.set_xlim(right=101)
    axes.set_xlabel("intervals with the true value (%)")
    with mpl.rc_context({"svg.hashsalt": path.stem, "svg.fonttype": "none"}):
        figure.savefig(path, metadata={"Date": None})
