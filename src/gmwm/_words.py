"""Words in messages: numbers with their nouns."""

from __future__ import annotations

OVERRULED = "the file says"
"""Stands in the note on a unit that was declared where the file itself names another one."""


def counted(number: int, noun: str) -> str:
    """A number with its noun, in the plural where it is not one.

    >>> counted(1, "knock"), counted(3, "sample")
    ('1 knock', '3 samples')
    """
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
