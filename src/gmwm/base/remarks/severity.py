"""Severity levels of remarks."""

from __future__ import annotations

from enum import IntEnum


class Severity(IntEnum):
    """Consequence of a remark for the values that it concerns. The most severe level comes first."""

    UNUSABLE = 0
    """The values cannot be used."""
    WRONG = 1
    """The values may be wrong by a large factor."""
    BIASED = 2
    """The confidence intervals may contain the true values less often than stated."""
    UNCERTAIN = 3
    """The confidence intervals are right, but they are wide, or some values are missing."""
    INFO = 4
    """The values are not affected. The remark states how they were obtained."""

    @property
    def label(self) -> str:
        """Name of the severity in lower case, as in JSON documents."""
        return self.name.lower()
