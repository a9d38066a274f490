"""Layout of legends and titles: number of columns of a legend, and line breaks in long entries."""

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
"""Margin at the left and right border (mm) that stays empty, because the width of a text depends on the file format."""
LEGEND_SIZE = 6.6
_HANDLE, _PAD, _BETWEEN, _BORDER, _AROUND = 3.0, 0.6, 1.2, 0.4, 0.5
_LOOK: dict[str, Any] = {
    "fontsize": LEGEND_SIZE, "frameon": False, "handlelength": _HANDLE, "handletextpad": _PAD, "borderpad": _BORDER,
    "columnspacing": _BETWEEN, "labelspacing": 0.3, "borderaxespad": _AROUND,
}  # fmt: skip
# Spaces at which a line may be wrapped. Spaces next to "=" and between a number and its unit are excluded.
_BREAKS = re.compile(r"(?<![=\d⁰¹²³⁴-⁹]) (?!=)")


def legend_below(picture: MatplotlibFigure, handles: dict[str, Artist], columns: int) -> None:
    """Draw one legend below all panels, in as many columns as fit the width, at most `columns`. If it needs more height
    than that, the figure gets higher, so that the panels keep their size."""
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
    """Yield layouts to try for a legend of at most `room` points width, from the best to one that always fits. Each
    layout consists of the entries, possibly with line breaks, and the number of columns."""
    for ncols in range(columns, 1, -1):
        yield list(names), ncols
    halves = [fold(name, _text_room(room, 2), LEGEND_SIZE) for name in names]
    broken = sum("\n" in half for half in halves)
    # If most entries would be wrapped in two columns, one column is easier to read.
    if columns > 1 and 2 * broken <= len(names) and all(half.count("\n") < 2 for half in halves):
        yield halves, 2
    yield list(names), 1
    yield [fold(name, _text_room(room, 1), LEGEND_SIZE) for name in names], 1


def _text_room(room: float, columns: int) -> float:
    """Return the largest width (points) of the text of an entry in a legend of `room` points and `columns` columns."""
    besides = 2 * _BORDER + (columns - 1) * _BETWEEN + columns * (_HANDLE + _PAD)
    # 3 % are left, because texts are measured without hinting, which changes their width slightly.
    return 0.97 * (room - besides * LEGEND_SIZE) / columns


def legend_inside(ax: Axes, handles: dict[str, Artist]) -> None:
    """Draw a legend inside the axes, and wrap its entries if the axes are narrow."""
    room = 72 * ax.bbox.width / ax.figure.dpi - 2 * _AROUND * LEGEND_SIZE
    names = [fold(name, _text_room(room, 1), LEGEND_SIZE) for name in handles]
    ax.legend([*handles.values()], names, **_LOOK)


def fold(text: str, room: float, size: float) -> str:
    """Wrap a text to a width of `room` points at the font size `size` (points).

    >>> fold("GM[1]: T = 17 ms, σ = 3.6×10⁻⁴ rad/s (like WN)", 140.0, 6.6).split("\\n")
    ['GM[1]: T = 17 ms, σ = 3.6×10⁻⁴ rad/s', '(like WN)']
    """
    # Even in a very narrow figure, a line can have a few letters.
    room = max(room, 6 * size)
    lines = [line for paragraph in text.split("\n") for line in _lines(paragraph, room, size)]
    return "\n".join(lines)


def _lines(text: str, room: float, size: float) -> Iterator[str]:
    """Yield the lines of a text, wrapped at spaces. A word that is longer than a line is broken."""
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
    """Return the width of a text (points) at the font size `size` (points)."""
    return float(text_to_path.get_text_width_height_descent(text, FontProperties(size=size), False)[0])
