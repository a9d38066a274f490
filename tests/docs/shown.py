"""Whether what a page shows is what was printed: the same words, nearly the same numbers, `…` where it is cut."""

from __future__ import annotations

import difflib
import math
import re
from functools import cache
from itertools import zip_longest

NUMBER = re.compile(r"(?<![\w.])([-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?)(?!\w)")
APART = 0.03
"""Share by which a number may differ: another NumPy or BLAS rounds otherwise. Of small counts this leaves nothing."""
CUT = "…"
LONG = 100
"""Characters of a line, above which a page may break it."""


def missing(shown: str, printed: str, apart: float = APART) -> str:
    """The first line of what is shown that was not printed in its place, and the nearest that was; "" if all were.

    A line that is `…` alone stands for any number of lines, `…` at the end of a line for the rest of it; more may have
    been printed before the first line and after the last. White space is as printed, unless a number in what is shown
    has another length, as columns may have moved then. A long line may be broken at a space, as a terminal would.
    """
    have = [line.rstrip() for line in printed.splitlines()]
    shown = unbroken(shown, [line for line in have if len(line) > LONG])
    failed = ""
    for spaces in (True, False):
        pairs, failed = beside(shown, have, spaces=spaces, apart=apart)
        if not failed and (spaces or any(lengths(line) != lengths(other) for line, other in pairs)):
            return ""
        failed = failed or next(line for line, other in pairs if not alike(line, other, spaces=True, apart=apart))
    near = difflib.get_close_matches(failed, have, n=1, cutoff=0.3)
    return f"shown   |{failed}\nprinted |{near[0] if near else ''}"


def beside(shown: str, have: list[str], *, spaces: bool, apart: float) -> tuple[list[tuple[str, str]], str]:
    """Each line that is shown with the one that was printed, and the first that was not."""
    pairs: list[tuple[str, str]] = []
    place = 0
    for piece in pieces(shown):
        most = 0
        for start in range(place, len(have)):
            there = zip_longest(piece, have[start : start + len(piece)], fillvalue="\0")
            same = next((k for k, two in enumerate(there) if not alike(*two, spaces=spaces, apart=apart)), len(piece))
            most = max(most, same)
            if same == len(piece):
                pairs += zip(piece, have[start : start + same], strict=True)
                place = start + same
                break
        else:
            return pairs, piece[most]
    return pairs, ""


def unbroken(shown: str, long: list[str]) -> str:
    """What is shown, with the long lines in one piece of which it shows the parts."""
    lines = shown.splitlines()
    for line in long:
        for first, begin in enumerate(lines):
            if not begin or not line.startswith(begin[:8]):
                continue
            for last in range(first + 2, len(lines) + 1):
                whole = " ".join(map(str.strip, lines[first:last]))
                if alike(whole, line, spaces=True, apart=APART):
                    lines[first:last] = [whole]
                    break
    return "\n".join(lines)


def pieces(shown: str) -> list[list[str]]:
    """What is shown between cuts, without the empty lines at its ends."""
    found: list[list[str]] = [[]]
    for line in map(str.rstrip, shown.splitlines()):
        if line.strip() == CUT:
            found.append([])
        elif line or found[-1]:
            found[-1].append(line)
    for piece in found:
        while piece and not piece[-1]:
            piece.pop()
    return [piece for piece in found if piece]


def alike(shown: str, printed: str, *, spaces: bool, apart: float) -> bool:
    """Whether a line is the one printed, or its beginning where it is cut."""
    ours, theirs = (parts(line, spaces) for line in (shown.removesuffix(CUT), printed))
    if shown.endswith(CUT) and not printed.endswith(CUT):
        last = len(ours) - 1
        theirs = [*theirs[:last], *(text[: len(ours[last])] for text in theirs[last : last + 1])]
    return len(ours) == len(theirs) and all(
        near(one, other, apart) if index % 2 else one == other
        for index, (one, other) in enumerate(zip(ours, theirs, strict=True))
    )


@cache
def parts(line: str, spaces: bool) -> list[str]:
    """The texts of a line and the numbers between them."""
    return NUMBER.split(line if spaces else plain(line))


def near(shown: str, printed: str, apart: float) -> bool:
    """Whether two numbers are as near as those of two machines."""
    one, other = (float(text.replace("−", "-")) for text in (shown, printed))
    return one == other or abs(one - other) <= apart * abs(other)


def renewed(shown: str, printed: str) -> str:
    """What is shown, with each line as it was printed, whatever its numbers; the cuts stay."""
    have = [line.rstrip() for line in printed.splitlines()]
    pairs, failed = beside(shown, have, spaces=False, apart=math.inf)
    if failed:
        raise LookupError(f"no line like {failed!r} was printed")
    lines = iter(other for line, other in pairs if line)
    rows = []
    for line in map(str.rstrip, shown.splitlines()):
        other = next(lines) if line and line.strip() != CUT else line
        rows.append(line if line.endswith(CUT) else other)
    return "".join(f"{row}\n" for row in rows)


def plain(line: str) -> str:
    """A line whose columns have no width."""
    return re.sub(r"\s+", " ", re.sub("[─-]{2,}", "──", line)).strip()


def lengths(line: str) -> list[int]:
    """The length of each number in a line."""
    return [len(number) for number in NUMBER.findall(line)]
