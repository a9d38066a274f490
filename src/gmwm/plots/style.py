"""Colours, dashes and symbols: safe for colour-blind readers (Okabe and Ito, 2008) and told apart in grey.

No two curves of one panel differ by colour alone; dash or symbol differ as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from gmwm.plots.figure import Stroke, Symbol
from gmwm.processes import registry

if TYPE_CHECKING:
    from gmwm.processes.base import Process

BLACK = "#000000"
ORANGE = "#E69F00"
SKY = "#56B4E9"
GREEN = "#009E73"
BLUE = "#0072B2"
VERMILLION = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#6E6E6E"
GRID = "#DADADA"

SOLID: tuple[float, ...] = ()
DASHED = (4.0, 1.6)
DOTTED = (1.0, 1.4)
DASH_DOT = (5.0, 1.4, 1.0, 1.4)
LONG = (8.0, 2.0)
DASH_DOT_DOT = (5.0, 1.4, 1.0, 1.4, 1.0, 1.4)
SHORT = (2.0, 1.2)
LONG_DOT = (9.0, 1.6, 1.0, 1.6)
SPARSE = (1.0, 3.2)
LONG_SHORT = (8.0, 1.6, 2.5, 1.6)

OBSERVED = Stroke(BLUE, 0.9, SOLID, "circle")
"""The estimate from the data."""
IMPLIED = Stroke(ORANGE, 2.6, SOLID)
"""What the fitted model says."""

# Six colours and nine dashes: a pair first repeats after 54 terms, a dash alone (as in grey) after nine.
_TERM_COLOURS = (GREEN, VERMILLION, PURPLE, SKY, BLACK, GREY)
_TERM_DASHES = (DASHED, DOTTED, DASH_DOT, LONG, DASH_DOT_DOT, SHORT, LONG_DOT, SPARSE, LONG_SHORT)

# x, y, z are red, green, blue by the field's habit; here vermillion, bluish green and blue, with their own
# symbols and dashes, so that the habit survives colour blindness and a photocopier.
_LETTERS: dict[str, tuple[str, tuple[float, ...], Symbol]] = {
    "x": (VERMILLION, SOLID, "circle"),
    "y": (GREEN, DASHED, "square"),
    "z": (BLUE, DASH_DOT, "triangle"),
}
_CURVES: tuple[tuple[str, tuple[float, ...], Symbol], ...] = (
    (BLUE, SOLID, "circle"),
    (VERMILLION, DASHED, "square"),
    (GREEN, DASH_DOT, "triangle"),
    (PURPLE, LONG, "diamond"),
    (BLACK, DOTTED, "cross"),
    (SKY, DASH_DOT_DOT, "star"),
    (ORANGE, SOLID, "plus"),
)


def term_stroke(index: int) -> Stroke:
    """The index-th of the strokes for terms of a model: thin, behind the data."""
    colour = _TERM_COLOURS[index % len(_TERM_COLOURS)]
    # Both counts are divisible by three: without the shift a pair would repeat after 18.
    dash = _TERM_DASHES[(index + index // 18) % len(_TERM_DASHES)]
    return Stroke(colour, 1.0, dash)


def term_strokes(terms: Sequence[str], processes: Sequence[Process]) -> dict[str, Stroke]:
    """The stroke of each term of a model, which it has in every model and in every picture.

    It goes by the place of the process in the registry; of a process that can be repeated, by the number of the
    term as well. Two parametrisations of one process look alike.

    >>> from gmwm.processes import GM, RW, WN
    >>> one, other = (term_strokes(m.terms, m.processes) for m in (WN() + RW() + GM(), 2 * GM() + RW()))
    >>> one["RW"] == other["RW"], one["GM"] == other["GM[1]"], other["GM[1]"] == other["GM[2]"]
    (True, True, False)
    """
    single = [name for name, process in registry.items() if not process.repeatable]
    families = list(dict.fromkeys(p.family or name for name, p in registry.items() if p.repeatable))
    seen: dict[str, int] = {}
    strokes = {}
    for term, process in zip(terms, processes, strict=True):
        kind = process.family or process.name
        if kind in families:
            place = len(single) + families.index(kind) + len(families) * seen.get(kind, 0)
        else:
            place = single.index(kind) if kind in single else -1 - seen.get("", 0)
        seen[kind if place >= 0 else ""] = seen.get(kind if place >= 0 else "", 0) + 1
        strokes[term] = term_stroke(place)
    return strokes


def letter_stroke(letter: str) -> Stroke | None:
    """The stroke of axis x, y or z of a triad; None for another letter."""
    if letter not in _LETTERS:
        return None
    colour, dash, symbol = _LETTERS[letter]
    return Stroke(colour, 1.1, dash, symbol)


def curve_stroke(index: int) -> Stroke:
    """The stroke of the index-th of several curves that are compared."""
    colour, dash, symbol = _CURVES[index % len(_CURVES)]
    return Stroke(colour, 1.1, dash, symbol)
