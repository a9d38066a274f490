"""Convert remarks to text. Only this module creates their sentences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from gmwm.base.remarks.registry import Severity
from gmwm.base.remarks.remark import Remark, sorted_remarks
from gmwm.base.template import Dialect, join_names, render
from gmwm.base.text import printable, shorten

MOST_REMARKS = 5
"""Largest number of remarks that a terminal shows, because users do not read more (CONTRIBUTING.md, "Few words")."""


def one_text(remark: Remark, dialect: Dialect = Dialect.PYTHON) -> str:
    """Return one remark as text."""
    return _group_text([remark], dialect)


def merged(remarks: Iterable[Remark]) -> list[list[Remark]]:
    """Group remarks with the same code about several subjects. The most severe group comes first.

    Remarks with the same code are in different groups if they differ in a fact that the sentence states once for all
    subjects.
    """
    groups: dict[tuple[object, ...], list[Remark]] = {}
    for remark in sorted_remarks(remarks):
        shared = remark.message.constant_facts(remark.facts)
        key = (remark.code, remark.severity, remark.advice, *(repr(remark.facts.get(name)) for name in sorted(shared)))
        groups.setdefault(key, []).append(remark)
    return list(groups.values())


def texts(remarks: Iterable[Remark], dialect: Dialect = Dialect.PYTHON, *, codes: bool = False) -> list[str]:
    """Return all remarks as text, the most severe first. Remarks with the same code about several subjects are merged.

    Parameters
    ----------
    remarks : iterable of Remark
        The remarks.
    dialect : Dialect
        Form of the commands and names in the text: Python, shell or HTML.
    codes : bool
        Whether to append the code to each text, so that users can search for it in the documentation.
    """
    return [text for _, text in with_groups(remarks, dialect, codes=codes)]


def with_groups(
    remarks: Iterable[Remark], dialect: Dialect = Dialect.PYTHON, *, codes: bool = False
) -> list[tuple[list[Remark], str]]:
    """Return the texts of `texts`, each with the group of remarks that it describes."""
    return [
        (group, _group_text(group, dialect) + (_code(group[0].code, dialect) if codes else ""))
        for group in merged(remarks)
    ]


def brief(
    remarks: Iterable[Remark], dialect: Dialect = Dialect.SHELL, *, rest: str = "", codes: bool = True,
    most: int = MOST_REMARKS,
) -> list[str]:  # fmt: skip
    """Return the most severe remarks as text, and a line with the number of other remarks.

    Parameters
    ----------
    remarks : iterable of Remark
        The remarks.
    dialect : Dialect
        As for `texts`.
    rest : str
        Place where the user finds the other remarks, such as a file name.
    codes : bool
        As for `texts`.
    most : int
        Largest number of texts.
    """
    every = texts(remarks, dialect, codes=codes)
    if len(every) <= most:
        return every
    return [*every[:most], f"and {len(every) - most} more{f' in {rest}' if rest else ''}"]


def gravest(remarks: Iterable[Remark]) -> Severity | None:
    """Return the highest severity among the remarks, or None if there are no remarks."""
    return min((remark.severity for remark in remarks), default=None)


def _code(code: str, dialect: Dialect) -> str:
    if dialect is Dialect.HTML:
        return f' <span class="code">[{escape(code)}]</span>'
    return f" [{code}]"


def _group_text(group: Sequence[Remark], dialect: Dialect) -> str:
    """Return one text for a group of remarks with the same code."""
    first, message = group[0], group[0].message
    facts = dict(first.facts)
    detail = message.detail_for(facts)
    rendered = [(remark.subject, render(detail, remark.facts)) for remark in group]
    details = [f"{subject} ({text})" if subject and text else subject or text for subject, text in rendered]
    subjects = join_names(list(filter(None, dict.fromkeys(details))), most=8)
    sentence = message.sentence_for(facts)
    text = render(sentence, {**facts, "subjects": subjects}, dialect)
    if "{subjects}" not in sentence and subjects:
        head = escape(subjects, quote=False) if dialect is Dialect.HTML else subjects
        text = f"{head}: {text}"
    advice = render(first.advice, {**facts, "subjects": subjects}, dialect)
    return printable(shorten(f"{text} {advice}".rstrip(), 4000))  # names from a file can be very long
