"""Colours, dashes and symbols for colour-blind readers (Okabe and Ito, 2008) and greyscale; no colour differs alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from zlib import crc32

from gmwm.showing.plots.figure import Stroke, Symbol
from gmwm.theory.processes import FN, SIN, WN, registry
from gmwm.theory.processes.base import Process

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

OBSERVED = Stroke(BLUE, 0.9, SOLID, "circle")  # stroke of a classical estimate from the data
ROBUST = Stroke(BLUE, 0.9, SOLID, "diamond")  # stroke of a robust estimate from the data
IMPLIED = Stroke(ORANGE, 2.6, SOLID)  # stroke of the curve of a fitted model
OSCILLATING = Stroke(OLIVE, 1.0, (8.0, 1.6, 2.5, 1.6, 2.5, 1.6))
"""Stroke of the sum of the oscillations of an axis, whose dash no single term has."""

# Terms have twelve colours and nine dashes. A colour repeats after twelve terms, a dash (which is all that remains in
# greyscale) after nine, and a pair of both after 108. `_FURTHER` uses the last three colours first.
_MORE_COLOURS = (WINE, INDIGO, OLIVE)
_TERM_COLOURS = (GREEN, VERMILLION, PURPLE, SKY, BLACK, GREY, BROWN, MAGENTA, FOREST, *_MORE_COLOURS)
_TERM_DASHES = (DASHED, DOTTED, DASH_DOT, LONG, DASH_DOT_DOT, SHORT, LONG_DOT, SPARSE, LONG_SHORT)

_ALONE = 4  # number of processes for inertial sensors of which a model can contain only one each
_NEXT = {FN.name: 7, SIN.name: 8}
"""Stroke numbers of flicker noise and of the first sinusoid. They follow the strokes of three Gauss-Markov terms."""
_OUTPUT = ("AR", "MA", "ARMA")
"""Processes that describe white noise after the filter of the sensor. In a model without WN, they have its stroke."""
# Strokes of further processes in order: three colours (P. Tol's muted scheme) and the dashes that few terms have,
# neighbours differ in both; other pairs are at the end.
_FURTHER = tuple(
    Stroke(_MORE_COLOURS[k % 3], 1.0, dashes[(k + k // len(dashes)) % len(dashes)])
    for dashes in (_TERM_DASHES[6:], _TERM_DASHES[:6])
    for k in range(3 * len(dashes))
) + tuple(Stroke(colour, 1.0, dash) for colour in _TERM_COLOURS[8::-1] for dash in _TERM_DASHES[::-1])

# Conventional red, green and blue as vermillion, bluish green and blue, with own symbols and dashes.
_LETTERS: dict[str, tuple[str, tuple[float, ...], Symbol]] = {
    "x": (VERMILLION, SOLID, "circle"), "y": (GREEN, DASHED, "square"), "z": (BLUE, DASH_DOT, "triangle"),
}  # fmt: skip
_CURVES: tuple[tuple[str, tuple[float, ...], Symbol], ...] = (
    (BLUE, SOLID, "circle"), (VERMILLION, DASHED, "square"), (GREEN, DASH_DOT, "triangle"), (PURPLE, LONG, "diamond"),
    (BLACK, DOTTED, "cross"), (SKY, DASH_DOT_DOT, "star"), (ORANGE, SOLID, "plus"),
)  # fmt: skip


def term_stroke(index: int) -> Stroke:
    """Return the stroke number `index` for terms of a model."""
    colour = _TERM_COLOURS[index % len(_TERM_COLOURS)]
    # Both numbers are divisible by three, so without a shift pairs would repeat after 36 terms.
    dash = _TERM_DASHES[(index + index // 36) % len(_TERM_DASHES)]
    return Stroke(colour, 1.0, dash)


def term_strokes(terms: Sequence[str], processes: Sequence[Process]) -> dict[str, Stroke]:
    """Return the stroke of each term, the same in all models and plots if possible.

    Inertial processes come first, by place in the registry and number of the term; others by name. Without WN, an AR,
    MA or ARMA process has its stroke. If a stroke or dash is taken, the next free one is used. Up to nine terms differ
    in both colour and dash; parametrisations of a process share a stroke."""
    kinds = {term: _kind(process) for term, process in zip(terms, processes, strict=True)}
    numbers = _stroke_numbers()
    if WN.name not in kinds.values():
        numbers |= dict.fromkeys(_OUTPUT, numbers[WN.name])
    strokes, seen = dict[str, Stroke](), Counter[str]()
    # Processes for inertial sensors come first. The others are sorted, so that the order of the terms has no effect.
    for term in sorted(kinds, key=lambda term: numbers.get(kinds[term], 0) > _ALONE):
        kind = kinds[term]
        if kind in numbers:
            stroke = term_stroke(numbers[kind] + seen[kind])
            seen[kind] += 1
            # A second sinusoid gets a free stroke, because the next stroke number is not reserved for sinusoids.
            if stroke not in strokes.values() and not (kind in _NEXT and seen[kind] > 1):
                strokes[term] = stroke
    for term in sorted(kinds.keys() - strokes.keys()):
        strokes[term] = _free(crc32(kinds[term].encode()), list(strokes.values()))
    return {term: strokes[term] for term in terms}


def _kind(process: type[Process] | Process) -> str:
    """Return the common name of all parametrisations of a process, and of all orders of an ordered process."""
    return process.parametrises or process.name.partition("(")[0]


def _stroke_numbers() -> dict[str, int]:
    """Return stroke numbers of inertial processes: four single ones, the first that may repeat, then `_NEXT`."""
    alone = dict.fromkeys(_kind(process) for process in registry.values() if not process.repeatable)
    repeated = dict.fromkeys(_kind(process) for process in registry.values() if process.repeatable)
    first = list(alone)[:_ALONE]
    return {kind: place for place, kind in enumerate([*first, *list(repeated)[:1]])} | _NEXT


def _free(start: int, taken: Sequence[Stroke]) -> Stroke:
    """Return an unused stroke of `_FURTHER` from `start` on, preferably with an unused dash, then colour."""
    preferred = 3 * len(_TERM_DASHES[6:])
    turned = [_FURTHER[(start + k) % preferred] for k in range(preferred)]
    dashes, colours = {stroke.dash for stroke in taken}, {stroke.colour for stroke in taken}
    return min(
        [*turned, *_FURTHER[preferred:]],
        key=lambda stroke: (stroke in taken, stroke.dash in dashes, stroke.colour in colours),
    )


def letter_stroke(letter: str) -> Stroke | None:
    """Return the stroke of the axis x, y or z of a sensor; None for any other letter."""
    if letter not in _LETTERS:
        return None
    colour, dash, symbol = _LETTERS[letter]
    return Stroke(colour, 1.1, dash, symbol)


def curve_stroke(index: int) -> Stroke:
    """Return the stroke of curve number `index` in a plot that compares curves."""
    colour, dash, symbol = _CURVES[index % len(_CURVES)]
    return Stroke(colour, 1.1, dash, symbol)
