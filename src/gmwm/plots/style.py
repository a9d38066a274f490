"""Colours, dashes and symbols: safe for colour-blind readers (Okabe and Ito, 2008) and told apart in grey.

No two curves of one panel differ by colour alone; dash or symbol differ as well.
"""

from __future__ import annotations

from gmwm.plots.figure import Stroke, Symbol

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

OBSERVED = Stroke(BLUE, 0.9, SOLID, "circle")
"""The estimate from the data."""
IMPLIED = Stroke(ORANGE, 2.6, SOLID)
"""What the fitted model says."""

# Six colours and seven dashes: a pair first repeats after 42 terms, a dash alone (as in grey) after seven.
_TERM_COLOURS = (GREEN, VERMILLION, PURPLE, SKY, BLACK, GREY)
_TERM_DASHES = (DASHED, DOTTED, DASH_DOT, LONG, DASH_DOT_DOT, SHORT, LONG_DOT)

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
    """The stroke of the index-th term of a model: thin, behind the data."""
    colour = _TERM_COLOURS[index % len(_TERM_COLOURS)]
    return Stroke(colour, 1.0, _TERM_DASHES[index % len(_TERM_DASHES)])


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
