"""Write every message as each renderer shows it: `python -m tests.remarks.snapshot` from the project's root."""

from __future__ import annotations

from pathlib import Path

from gmwm.base.remarks import Dialect, messages
from gmwm.base.remarks.rendering import examples

FOLDER = Path(__file__).parent


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
