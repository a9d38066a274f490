"""The legend of a table: what each of its columns means."""

from __future__ import annotations

from collections.abc import Mapping


def legend(columns: Mapping[str, str], title: str = "The columns:") -> list[str]:
    """Return Markdown lines with a blank line above: a list of the columns with the meaning of each."""
    return ["", title, "", *(f"- **{name}**: {meaning}." for name, meaning in columns.items())]
