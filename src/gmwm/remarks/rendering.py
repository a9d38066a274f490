"""Convert remarks to text. No other module makes their sentences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from gmwm._template import Dialect, joined, render
from gmwm._text import printable, shortened
from gmwm.remarks.remark import Remark, sorted_remarks
from gmwm.remarks.severity import Severity

LONGEST_TEXT = 4000
"""Largest number of characters of a remark: names in a file can be longer."""
MOST = 5
"""Number of remarks that a terminal shows; users do not read more (CONTRIBUTING.md, "Few words")."""


def one_text(remark: Remark, dialect: Dialect = Dialect.PYTHON) -> str:
    """Return one remark as text: what happened, where, what it means, and what to do."""
    return _group_text([remark], dialect)


def merged(remarks: Iterable[Remark]) -> list[list[Remark]]:
    """Group remarks with the same code about several subjects; the most severe group comes first.

    Remarks with the same code are in different groups if they differ in a fact that the sentence states for all
    subjects.
    """
    groups: dict[tuple[object, ...], list[Remark]] = {}
    for remark in sorted_remarks(remarks):
        shared = remark.message.shared(remark.facts)
        key = (remark.code, remark.severity, remark.advice, *(repr(remark.facts.get(name)) for name in sorted(shared)))
        groups.setdefault(key, []).append(remark)
    return list(groups.values())


def texts(remarks: Iterable[Remark], dialect: Dialect = Dialect.PYTHON, *, codes: bool = False) -> list[str]:
    """Return all remarks as text, the most severe first. Remarks with the same code about several subjects are merged.

    Parameters
    ----------
    remarks : iterable of Remark
    dialect : Dialect
    codes : bool
        Append the code to each text, so that users can search for it in the documentation.
    """
    return [text for _, text in with_groups(remarks, dialect, codes=codes)]


def with_groups(
    remarks: Iterable[Remark], dialect: Dialect = Dialect.PYTHON, *, codes: bool = False
) -> list[tuple[list[Remark], str]]:
    """Return the same texts, each with the remarks that it contains."""
    return [
        (group, _group_text(group, dialect) + (_code(group[0].code, dialect) if codes else ""))
        for group in merged(remarks)
    ]


def brief(
    remarks: Iterable[Remark], dialect: Dialect = Dialect.SHELL, *, rest: str = "", codes: bool = True, most: int = MOST
) -> list[str]:
    """Return the most severe remarks as text, and a line with the number of the others.

    Parameters
    ----------
    remarks : iterable of Remark
    dialect : Dialect
    rest : str
        Where to find the other remarks.
    codes : bool
        As for `texts`.
    most : int
        Largest number of texts.
    """
    every = texts(remarks, dialect, codes=codes)
    if len(every) <= most + 1:
        return every
    return [*every[:most], f"and {len(every) - most} more{f' in {rest}' if rest else ''}"]


def gravest(remarks: Iterable[Remark]) -> Severity | None:
    """Return the highest severity among the remarks; None if there are none."""
    return min((remark.severity for remark in remarks), default=None)


def _code(code: str, dialect: Dialect) -> str:
    if dialect is Dialect.HTML:
        return f' <span class="code">[{escape(code)}]</span>'
    return f" [{code}]"


def _group_text(group: Sequence[Remark], dialect: Dialect) -> str:
    """Render remarks with the same code as one text."""
    first, message = group[0], group[0].message
    facts = dict(first.facts)
    details = [
        f"{remark.subject} ({render(message.detail, remark.facts)})" if message.detail else remark.subject
        for remark in group
    ]
    subjects = joined(list(filter(None, dict.fromkeys(details))), most=8)
    sentence = message.sentence_for(facts)
    text = render(sentence, {**facts, "subjects": subjects}, dialect)
    if "{subjects}" not in sentence and subjects:
        head = escape(subjects, quote=False) if dialect is Dialect.HTML else subjects
        text = f"{head}: {text}"
    advice = render(first.advice, {**facts, "subjects": subjects}, dialect)
    return printable(shortened(f"{text} {advice}".rstrip(), LONGEST_TEXT))
