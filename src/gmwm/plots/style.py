"""Colours, dashes and symbols: safe for colour-blind readers (Okabe and Ito, 2008) and told apart in grey.

No two curves of one panel differ by colour alone; dash or symbol differ as well.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING
from zlib import crc32

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
WINE = "#882255"
INDIGO = "#332288"
OLIVE = "#999933"
BROWN = "#7A4A12"
MAGENTA = "#B0179A"
FOREST = "#0B5D2A"
GREY = "#6E6E6E"
PALE = "#A9A9A9"
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
ROBUST = Stroke(BLUE, 0.9, SOLID, "diamond")
"""The robust one."""
IMPLIED = Stroke(ORANGE, 2.6, SOLID)
"""What the fitted model says."""

# Twelve colours and nine dashes: a pair first repeats after 108 terms, a colour after twelve, a dash alone (as in
# grey) after nine. The last three colours are those that other processes take first.
_MORE_COLOURS = (WINE, INDIGO, OLIVE)
_TERM_COLOURS = (GREEN, VERMILLION, PURPLE, SKY, BLACK, GREY, BROWN, MAGENTA, FOREST, *_MORE_COLOURS)
_TERM_DASHES = (DASHED, DOTTED, DASH_DOT, LONG, DASH_DOT_DOT, SHORT, LONG_DOT, SPARSE, LONG_SHORT)

_ALONE = 4
"""How many processes of inertial sensors cannot be repeated."""
# Every other process: in colours of its own (P. Tol's muted scheme), first with the three dashes that the terms of few
# models have; neighbours in the list differ in colour and dash. Last what no other term of the model has taken.
_FURTHER = tuple(
    Stroke(_MORE_COLOURS[k % 3], 1.0, dashes[(k + k // len(dashes)) % len(dashes)])
    for dashes in (_TERM_DASHES[6:], _TERM_DASHES[:6])
    for k in range(3 * len(dashes))
) + tuple(Stroke(colour, 1.0, dash) for colour in _TERM_COLOURS[8::-1] for dash in _TERM_DASHES[::-1])

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
    # Both counts are divisible by three: without the shift a pair would repeat after 36.
    dash = _TERM_DASHES[(index + index // 36) % len(_TERM_DASHES)]
    return Stroke(colour, 1.0, dash)


def term_strokes(terms: Sequence[str], processes: Sequence[Process]) -> dict[str, Stroke]:
    """The stroke of each term of a model, which it has in every model and in every picture.

    The processes of inertial sensors, first in the registry, have strokes that go by their place there, and by the
    number of the term where one can be repeated. Any other process has one of further strokes, by its name: what else
    is in the registry does not change it. Only where another term of the model has its stroke or its dash, it takes
    the next that is free: up to nine terms differ in colour and in dash. Two parametrisations of one process look
    alike.

    >>> from gmwm.processes import GM, RW, WN
    >>> one, other = (term_strokes(m.terms, m.processes) for m in (WN() + RW() + GM(), 2 * GM() + RW()))
    >>> one["RW"] == other["RW"], one["GM"] == other["GM[1]"], other["GM[1]"] == other["GM[2]"]
    (True, True, False)
    """
    kinds = {term: _kind(process) for term, process in zip(terms, processes, strict=True)}
    settled = _settled()
    strokes, seen = {}, Counter[str]()
    for term, kind in kinds.items():
        if kind in settled:
            strokes[term] = term_stroke(settled[kind] + seen[kind])
            seen[kind] += 1
    # In an order that does not hang on that of the terms.
    for term in sorted(kinds.keys() - strokes.keys()):
        strokes[term] = _free(crc32(kinds[term].encode()), list(strokes.values()))
    return {term: strokes[term] for term in terms}


def _kind(process: type[Process] | Process) -> str:
    """The name that the parametrisations of one process share, and the orders of one ordered process."""
    return process.parametrises or process.name.partition("(")[0]


def _settled() -> dict[str, int]:
    """Places of the first strokes: of the four processes that stand alone, then of the first that is repeated."""
    alone = dict.fromkeys(_kind(process) for process in registry.values() if not process.repeatable)
    repeated = dict.fromkeys(_kind(process) for process in registry.values() if process.repeatable)
    first = list(alone)[:_ALONE]
    return {kind: place for place, kind in enumerate([*first, *list(repeated)[:1]])}


def _free(start: int, taken: Sequence[Stroke]) -> Stroke:
    """The first of the further strokes, from `start` on, whose dash, and then whose colour, none of those taken has."""
    preferred = 3 * len(_TERM_DASHES[6:])
    turned = [_FURTHER[(start + k) % preferred] for k in range(preferred)]
    dashes, colours = {stroke.dash for stroke in taken}, {stroke.colour for stroke in taken}
    return min(
        [*turned, *_FURTHER[preferred:]],
        key=lambda stroke: (stroke in taken, stroke.dash in dashes, stroke.colour in colours),
    )


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
