"""Words that always fit: a legend in as many columns as the picture holds, and long lines on several."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as MatplotlibFigure

MILLIMETRE = 1 / 25.4
EDGE = 2.0
"""What stays free at the left and the right border (mm): a text is not equally wide in every format."""
LEGEND_SIZE = 6.6
_HANDLE, _PAD, _BETWEEN, _BORDER, _AROUND = 3.0, 0.6, 1.2, 0.4, 0.5
_LOOK: dict[str, Any] = {
    "fontsize": LEGEND_SIZE, "frameon": False, "handlelength": _HANDLE, "handletextpad": _PAD, "borderpad": _BORDER,
    "columnspacing": _BETWEEN, "labelspacing": 0.3, "borderaxespad": _AROUND,
}  # fmt: skip
_SAFE = 0.97
"""Texts are measured without hinting, which changes their width a little."""
# Spaces at which a line may break: not beside "=", and not between a number and its unit.
_BREAKS = re.compile(r"(?<![=\d⁰¹²³⁴-⁹]) (?!=)")


def legend_below(picture: MatplotlibFigure, handles: dict[str, Artist], columns: int) -> None:
    """One legend under all panels, in as many columns up to `columns` as the width holds.

    The height of the picture was chosen for a legend in all its columns: it grows by what the legend takes more, so
    that the panels keep theirs.
    """
    room = picture.bbox.width - 2 * EDGE * MILLIMETRE * picture.dpi
    layouts = list(_layouts([*handles], columns, 72 * room / picture.dpi))
    heights = []
    for names, ncols in layouts:
        legend = picture.legend([*handles.values()], names, loc="outside lower center", ncols=ncols, **_LOOK)
        box = legend.get_window_extent()
        heights.append(box.height)
        if box.width <= room or len(heights) == len(layouts):
            break
        legend.remove()
    picture.set_figheight(picture.get_figheight() + max(heights[-1] - heights[0], 0.0) / picture.dpi)


def _layouts(names: Sequence[str], columns: int, room: float) -> Iterator[tuple[list[str], int]]:
    """Entries and numbers of columns to be tried in a width of so many points, the best first, one that fits last."""
    for ncols in range(columns, 1, -1):
        yield list(names), ncols
    halves = [folded(name, _text_room(room, 2), LEGEND_SIZE) for name in names]
    broken = sum("\n" in half for half in halves)
    # Where most entries are long, a column of long lines reads better.
    if columns > 1 and 2 * broken <= len(names) and all(half.count("\n") < 2 for half in halves):
        yield halves, 2
    yield list(names), 1
    yield [folded(name, _text_room(room, 1), LEGEND_SIZE) for name in names], 1


def _text_room(room: float, columns: int) -> float:
    """The width (points) that the text of an entry has, of that of the whole legend."""
    besides = 2 * _BORDER + (columns - 1) * _BETWEEN + columns * (_HANDLE + _PAD)
    return _SAFE * (room - besides * LEGEND_SIZE) / columns


def legend_inside(ax: Axes, handles: dict[str, Artist]) -> None:
    """A legend in the axes, its entries on several lines where they are narrow."""
    room = 72 * ax.bbox.width / ax.figure.dpi - 2 * _AROUND * LEGEND_SIZE
    names = [folded(name, _text_room(room, 1), LEGEND_SIZE) for name in handles]
    ax.legend([*handles.values()], names, **_LOOK)


def folded(text: str, room: float, size: float) -> str:
    """A text on as many lines as a width of so many points asks for.

    >>> folded("GM[1]: T = 17 ms, σ = 3.6×10⁻⁴ rad/s (acts as WN)", 140.0, 6.6).split("\\n")
    ['GM[1]: T = 17 ms, σ = 3.6×10⁻⁴ rad/s', '(acts as WN)']
    """
    # However narrow, a line holds a few letters.
    room = max(room, 6 * size)
    lines = [line for given in text.split("\n") for line in _lines(given, room, size)]
    return "\n".join(lines)


def _lines(text: str, room: float, size: float) -> Iterator[str]:
    """The lines of a text, broken at spaces, or anywhere in a word that is longer than a line."""
    line = ""
    for word in _BREAKS.split(text):
        longer = f"{line} {word}" if line else word
        if width_of(longer, size) <= room:
            line = longer
            continue
        if line:
            yield line
        line = word
        while width_of(line, size) > room:
            count = next(k for k in range(len(line) - 1, 0, -1) if k == 1 or width_of(line[:k], size) <= room)
            yield line[:count]
            line = line[count:]
    yield line


def width_of(text: str, size: float) -> float:
    """The width of a text (points) in letters of so many points."""
    return float(text_to_path.get_text_width_height_descent(text, FontProperties(size=size), False)[0])
