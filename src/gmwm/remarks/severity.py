"""How grave a remark is."""

from __future__ import annotations

from enum import IntEnum


class Severity(IntEnum):
    """What a remark means for the numbers that it is about, from the gravest on."""

    UNUSABLE = 0
    """The numbers cannot be used."""
    WRONG = 1
    """The numbers may be wrong by a factor."""
    BIASED = 2
    """The numbers may lie outside their confidence intervals."""
    UNCERTAIN = 3
    """The numbers lie within their intervals as often as stated, but the intervals are wide or some are missing."""
    INFO = 4
    """The numbers are not affected. The remark says how they were found."""

    @property
    def label(self) -> str:
        """The name in lower case, as JSON documents have it."""
        return self.name.lower()
