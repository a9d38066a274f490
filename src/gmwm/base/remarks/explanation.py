"""What a message means and what to do, for `gmwm explain` and the pages of the documentation."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from dataclasses import replace

from gmwm.base.errors import OptionError
from gmwm.base.remarks.registry import CASE, OTHERWISE, SECTIONS, Choice, Message, Text, messages
from gmwm.base.remarks.remark import Remark
from gmwm.base.template import Dialect, Fact, render
from gmwm.base.text import TEXT_WIDTH


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
    found = sorted({remark.severity for remark in cases(message)})
    return " or ".join(severity.label for severity in found)


def sentence_and_advice(remark: Remark, dialect: Dialect) -> tuple[str, str]:
    """Return the two parts of the text of a remark."""
    advice = render(remark.advice, {**remark.facts, "subjects": remark.subject}, dialect)
    return replace(remark, advice="").text(dialect), advice


def explanation(code: str, dialect: Dialect = Dialect.PYTHON) -> str:
    """Return what a message means and what to do, as text of at most 80 columns.

    Parameters
    ----------
    code : str
        Code of the message, as the terminal shows it in brackets.
    dialect : Dialect
        Form of the commands and names in the text: Python or shell.

    Raises
    ------
    gmwm.errors.OptionError
        If no message has this code.

    Examples
    --------
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

    names = difflib.get_close_matches(code, messages(), n=3, cutoff=0.5)
    return f"Similar codes: {', '.join(names)}." if names else "`gmwm explain` without a code lists all codes."


def _plain(markdown: str) -> str:
    """Return Markdown without its links and line breaks."""
    return " ".join(re.sub(r"\[([^\]]+)\]\([^)]+\)", r"\1", markdown).split())


def _indented(text: str) -> list[str]:
    return textwrap.wrap(text, TEXT_WIDTH, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False)
