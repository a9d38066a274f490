"""Write every message as each renderer shows it: `python -m tests.remarks.snapshot` from the project's root."""

from __future__ import annotations

from pathlib import Path

from gmwm.remarks import Dialect, Fact, Message, Remark, messages
from gmwm.remarks.registry import Choice

FOLDER = Path(__file__).parent


def examples(message: Message) -> list[Remark]:
    """The example of a message, once for each of its templates."""
    facts = dict(message.example)
    subject = str(facts.pop("subject", ""))
    found: list[dict[str, Fact]] = [facts]
    for text in (message.sentence, message.advice):
        if isinstance(text, Choice):
            found = [{**given, text.by: value} for given in found for value in text.templates]
    return list(dict.fromkeys(Remark.of(message.code, subject, **given) for given in found))


def rendered(dialect: Dialect) -> str:
    """All messages for one kind of reader."""
    lines = [
        f"{remark.code} ({remark.severity.label}): {remark.text(dialect)}"
        for message in messages().values()
        for remark in examples(message)
    ]
    return "\n".join(lines) + "\n"


def file_of(dialect: Dialect) -> Path:
    """Where the snapshot of a renderer lies."""
    return FOLDER / f"{dialect.value}.txt"


if __name__ == "__main__":
    for dialect in Dialect:
        file_of(dialect).write_text(rendered(dialect), encoding="utf-8")
