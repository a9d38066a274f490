"""Write docs/howto/warnings.md, the page on messages, from the registry: `python -m docs.messages`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from html import unescape
from pathlib import Path

from gmwm.base.remarks import Dialect, Fact, Message, Remark, messages
from gmwm.base.remarks.registry import CASE, OTHERWISE, SECTIONS, Choice, Text
from gmwm.base.template import render

PAGE = Path(__file__).parent / "howto" / "warnings.md"

HEAD = """\
# Messages and what to do about them

<!-- Written by `python -m docs.messages` from src/gmwm/base/remarks/messages.toml. -->

gmwm reports everything that you should know about a result as a message with a code and a severity. The terminal shows
the code in brackets after the message, and JSON files have it as `code`. In Python, the messages are in `remarks` of
each result, for example `calibration.remarks`. Search this page for the code.

The terminal shows the five most severe messages. `report.html` and `--all-remarks` show all of them.

An error ends a command. Its text says what to do. [Start here](../start.md#errors-on-reading) explains the usual
errors.

## Severity

| severity | meaning for the results | what to do | in the report |
|---|---|---|---|
| unusable | The values cannot be used. | Do what the message says, and calibrate again. | ✗ |
| wrong | The values may be wrong by a large factor. | Find the cause before you use them. | ✗ |
| biased | The true values may lie outside the confidence intervals. | Decide whether this matters for you. | ! |
| uncertain | The confidence intervals are right, but some are wide or missing. | Record longer if it matters. | ! |
| info | The values are not affected. | Nothing. | ✓ |
"""


def examples(message: Message) -> list[Remark]:
    """The example of a message, once for each of its templates."""
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
    """The facts, once for each template that a text chooses by a fact other than the case."""
    if not isinstance(text, Choice):
        yield facts
    elif text.by == CASE:
        yield from _variants(text.templates.get(str(facts[CASE]), text.templates.get(OTHERWISE, "")), facts)
    else:
        yield from ({**facts, text.by: value} for value in text.templates)


def page() -> str:
    """The page as Markdown."""
    parts = [HEAD]
    for section, title in SECTIONS.items():
        own = [message for message in messages().values() if message.section == section]
        if own:
            parts.append(f"## {title}\n")
            parts += ["\n".join(_entry(message)) for message in own]
    return "\n".join(parts)


def _entry(message: Message) -> Iterator[str]:
    """A heading that is the code, the sentences, the meaning and the advice."""
    remarks = examples(message)
    yield f"### `{message.code}`\n"
    sentences = dict.fromkeys(_markdown(replace(remark, advice="").text(Dialect.HTML)) for remark in remarks)
    yield "\n>\n".join(f"> {sentence}" for sentence in sentences) + "\n"
    severities = ", ".join(dict.fromkeys(remark.severity.label for remark in remarks))
    yield f"**Severity:** {severities}. {message.meaning}\n"
    advice = list(dict.fromkeys(filter(None, map(_advice, remarks))))
    if len(advice) == 1:
        yield f"**What to do.** {advice[0]}\n"
    elif advice:
        yield "**What to do.** gmwm gives the advice that applies:\n"
        yield "\n".join(f"- {text}" for text in advice) + "\n"


def _advice(remark: Remark) -> str:
    return _markdown(render(remark.advice, {**remark.facts, "subjects": remark.subject}, Dialect.HTML))


def _markdown(text: str) -> str:
    """HTML with code as Markdown; other characters that Markdown interprets are escaped."""
    parts = re.split("</?code>", text)
    return "".join(f"`{unescape(part)}`" if k % 2 else _escaped(unescape(part)) for k, part in enumerate(parts))


def _escaped(text: str) -> str:
    return re.sub(r"([*\[\]<])", r"\\\1", text)


def write() -> list[Path]:
    """Write the page and return its path."""
    PAGE.write_text(page(), encoding="utf-8")
    return [PAGE]


if __name__ == "__main__":
    write()
