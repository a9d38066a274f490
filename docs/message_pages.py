"""Write the pages of docs/messages, one for each group of messages: `python -m docs.message_pages`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from html import unescape
from pathlib import Path

from gmwm.base.remarks import Dialect, Message, messages
from gmwm.base.remarks.registry import SECTIONS
from gmwm.base.remarks.rendering import cases, sentence_and_advice, severities

FOLDER = Path(__file__).parent / "messages"
MARK = "<!-- Written by `python -m docs.message_pages` from src/gmwm/base/remarks/messages.toml. -->"

HEAD = f"""\
# Messages and what to do about them

{MARK}

A message says what you should know about a result. It has a severity, and a code that the terminal shows in brackets.
`gmwm explain CODE` prints all cases of a code. The terminal shows the five most severe messages; `report.html` and
`--all-remarks` show all. JSON files have `code`, and in `facts` the `case` if a code has several. In Python, messages
are in `remarks` of each result.

An error ends a command, and its text says what to do: see [the usual errors](../start.md#errors-on-reading).

| severity | meaning for the results | what to do | in the report |
|---|---|---|---|
| unusable | The values cannot be used. | Do what the message says, and calibrate again. | ✗ |
| wrong | The values may be wrong by a large factor. | Find the cause before you use them. | ✗ |
| biased | The true values may lie outside the confidence intervals. | Decide whether this matters for you. | ! |
| uncertain | The confidence intervals are right, but some are wide or missing. | Record longer if it matters. | ! |
| info | The values are not affected. | Nothing. | ✓ |

"""


def by_section() -> dict[str, list[Message]]:
    """The messages of each section, in the order of the pages."""
    groups: dict[str, list[Message]] = {section: [] for section in SECTIONS}
    for message in messages().values():
        groups[message.section].append(message)
    return {section: group for section, group in groups.items() if group}


def index() -> str:
    """The first page as Markdown: severities, and a link to each code."""
    lines = []
    for section, group in by_section().items():
        links = ", ".join(f"[{message.code}]({section}.md#{message.code})" for message in group)
        lines.append(f"- [{SECTIONS[section]}]({section}.md): {links}")
    toctree = "\n".join(["```{toctree}", ":hidden:", "", *by_section(), "```"])
    return HEAD + "\n".join(lines) + f"\n\n{toctree}\n"


def page(section: str) -> str:
    """The page of a section as Markdown."""
    parts = [f"# {SECTIONS[section]}: messages\n\n{MARK}\n"]
    parts += ["\n".join(_entry(message)) for message in by_section()[section]]
    return "\n".join(parts)


def _entry(message: Message) -> Iterator[str]:
    """A heading that is the code, severity and meaning, and an example of the most severe case with its advice."""
    yield f"## `{message.code}`\n"
    yield f"*{severities(message).capitalize()}.* {message.meaning}\n"
    remark = min(cases(message), key=lambda remark: remark.severity)
    sentence, advice = (_markdown(text) for text in sentence_and_advice(remark, Dialect.HTML))
    first = re.split(r"(?<=\.) (?=[A-Z])", sentence.removeprefix(f"{remark.subject}: "), maxsplit=1)[0]
    yield f"“{first}” {advice}".rstrip() + "\n"


def _markdown(text: str) -> str:
    """HTML with code as Markdown; other characters that Markdown interprets are escaped."""
    parts = re.split("</?code>", text)
    return "".join(f"`{unescape(part)}`" if k % 2 else _escaped(unescape(part)) for k, part in enumerate(parts))


def _escaped(text: str) -> str:
    return re.sub(r"([*\[\]<])", r"\\\1", text)


def contents() -> dict[Path, str]:
    """The content of each page."""
    return {FOLDER / "index.md": index()} | {FOLDER / f"{section}.md": page(section) for section in by_section()}


def write() -> list[Path]:
    """Write the pages and return their paths."""
    FOLDER.mkdir(exist_ok=True)
    for path, text in contents().items():
        path.write_text(text, encoding="utf-8")
    return list(contents())


if __name__ == "__main__":
    write()
