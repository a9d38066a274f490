"""Convert remarks to text. Only this module creates their sentences."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from html import escape

from gmwm.base.errors import OptionError
from gmwm.base.remarks.registry import CASE, OTHERWISE, SECTIONS, Choice, Message, Severity, Text, messages
from gmwm.base.remarks.remark import Remark, sorted_remarks
from gmwm.base.template import Dialect, Fact, join_names, render
from gmwm.base.text import TEXT_WIDTH, printable, shorten

MOST_REMARKS = 5
"""Largest number of remarks that a terminal shows, because users do not read more (CONTRIBUTING.md, "Few words")."""


def one_text(remark: Remark, dialect: Dialect = Dialect.PYTHON) -> str:
    """Return one remark as text."""
    return _group_text([remark], dialect)


def merged(remarks: Iterable[Remark]) -> list[list[Remark]]:
    """Group remarks of one code, and of the same facts that a sentence states once, most severe first."""
    groups: dict[tuple[object, ...], list[Remark]] = {}
    for remark in sorted_remarks(remarks):
        shared = remark.message.constant_facts(remark.facts)
        key = (remark.code, remark.severity, remark.advice, *(repr(remark.facts.get(name)) for name in sorted(shared)))
        groups.setdefault(key, []).append(remark)
    return list(groups.values())


def texts(remarks: Iterable[Remark], dialect: Dialect = Dialect.PYTHON, *, codes: bool = False) -> list[str]:
    """Return all remarks as text, the most severe first, those of one code merged, and with `codes` their codes."""
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
    """Return the `most` severe remarks as text, and a line with the number of others and their place (`rest`)."""
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
    names, contents = [subject for subject, _ in rendered], {text for _, text in rendered}
    if len(set(names)) > 1 and all(names) and len(contents) == 1 and contents != {""}:
        subjects = f"{join_names(list(dict.fromkeys(names)), most=8)} (each {contents.pop()})"
    else:
        details = [f"{subject} ({text})" if subject and text else subject or text for subject, text in rendered]
        subjects = join_names(list(filter(None, dict.fromkeys(details))), most=8)
    sentence = message.sentence_for(facts)
    text = render(sentence, {**facts, "subjects": subjects}, dialect)
    if "{subjects}" not in sentence and subjects:
        head = escape(subjects, quote=False) if dialect is Dialect.HTML else subjects
        text = f"{head}: {text}"
    advice = render(first.advice, {**facts, "subjects": subjects}, dialect)
    return printable(shorten(f"{text} {advice}".rstrip(), 4000))  # names from a file can be very long


def examples(message: Message) -> list[Remark]:
    """Return an example of each case of a message, once for each of its templates."""
    remarks: list[Remark] = []
    for example in message.examples:
        facts = dict(example)
        subject = str(facts.pop("subject", ""))
        variants: list[dict[str, Fact]] = [facts]
        for text in (message.sentence, message.advice):
            variants = [values for variant in variants for values in _variants(text, variant)]
        remarks += [Remark.of(message.code, subject, **facts) for facts in variants]
    return list(dict.fromkeys(remarks))


def _variants(text: Text, facts: dict[str, Fact]) -> Iterator[dict[str, Fact]]:
    """Yield the facts, once for each template that a text chooses by a fact other than the case."""
    if not isinstance(text, Choice):
        yield facts
    elif text.by == CASE:
        yield from _variants(text.templates.get(str(facts[CASE]), text.templates.get(OTHERWISE, "")), facts)
    else:
        yield from ({**facts, text.by: value} for value in text.templates)


def cases(message: Message) -> list[Remark]:
    """Return one example of each case of a message."""
    return list({str(remark.facts.get(CASE)): remark for remark in reversed(examples(message))}.values())[::-1]


def severities(message: Message) -> str:
    """Return the severities that a message can have, the highest first: "biased or info"."""
    levels = sorted({remark.severity for remark in cases(message)})
    return " or ".join(severity.label for severity in levels)


def sentence_and_advice(remark: Remark, dialect: Dialect) -> tuple[str, str]:
    """Return the two parts of the text of a remark."""
    advice = render(remark.advice, {**remark.facts, "subjects": remark.subject}, dialect)
    return replace(remark, advice="").text(dialect), advice


def explanation(code: str, dialect: Dialect = Dialect.PYTHON) -> str:
    """Return what a message means and what to do, in 80 columns; OptionError for unknown codes.

    >>> import gmwm
    >>> print(gmwm.remarks.explanation("last-line").splitlines()[0])
    last-line (info)
    """
    message = messages().get(code.strip("[]"))
    if message is None:
        raise OptionError(f"no message has the code {code}", advice=_similar(code))
    lines = [f"{message.code} ({severities(message)})", *textwrap.wrap(_plain(message.meaning), TEXT_WIDTH)]
    for remark in cases(message):
        sentence, advice = sentence_and_advice(remark, dialect)
        lines += ["", *textwrap.wrap(f"“{sentence}”", TEXT_WIDTH), *_indented(advice)]
    return "\n".join(lines)


def codes_text() -> str:
    """Return the codes of all messages by section, as text of at most 80 columns."""
    sections: dict[str, list[str]] = {}
    for message in messages().values():
        sections.setdefault(message.section, []).append(message.code)
    blocks = [
        "\n".join([f"{title}:", *_indented(", ".join(sorted(sections[section])))])
        for section, title in SECTIONS.items()
        if section in sections
    ]
    return "\n\n".join(blocks)


def _similar(code: str) -> str:
    import difflib

    names = difflib.get_close_matches(code, messages(), n=3)
    return f"Similar codes: {', '.join(names)}." if names else "`gmwm explain` without a code lists all codes."


def _plain(markdown: str) -> str:
    """Return Markdown without its links and line breaks."""
    return " ".join(re.sub(r"\[([^\]]+)\]\([^)]+\)", r"\1", markdown).split())


def _indented(text: str) -> list[str]:
    return textwrap.wrap(text, TEXT_WIDTH, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False)
