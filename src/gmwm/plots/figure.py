"""What is drawn, as plain data: a Figure is rows of Panels, a Panel is two Axes and its Marks.

Nothing here knows a drawing library; a renderer turns a Figure into a picture and decides nothing but how
its library spells a line. All positions are in the units that the axis labels name.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from gmwm._arrays import Vector

Symbol = Literal["circle", "square", "diamond", "triangle", "down", "cross", "plus", "star"]
"""The marks a renderer must know how to draw."""


@dataclass(frozen=True)
class Stroke:
    """How a line looks.

    Parameters
    ----------
    colour : str
        "#rrggbb".
    width : float
        In points.
    dash : tuple of float
        Lengths on, off, on, off … in units of the width; empty is a solid line.
    symbol : Symbol or None
        What stands at each point.
    filled : bool
        Whether the symbol is filled; an open one stands for a point that was left out.
    """

    colour: str
    width: float = 1.0
    dash: tuple[float, ...] = ()
    symbol: Symbol | None = None
    filled: bool = True


@dataclass(frozen=True, eq=False)
class Line:
    """A curve y(x), broken where y is NaN; `width` 0 in its stroke leaves the symbols alone.

    Parameters
    ----------
    x, y : (n,) arrays
        In the units of the axes.
    stroke : Stroke
        How it looks.
    label : str
        Its entry in the legend; "" for none.
    layer : int
        Larger is nearer to the eye.
    """

    x: Vector
    y: Vector
    stroke: Stroke
    label: str = ""
    layer: int = 0


@dataclass(frozen=True, eq=False)
class Band:
    """A shaded region between `lower` and `upper` over x, for limits of confidence.

    Parameters
    ----------
    x, lower, upper : (n,) arrays
        In the units of the axes; NaN leaves a hole, 0 and infinity reach the border of the panel.
    colour : str
        "#rrggbb".
    opacity : float
        From 0 to 1.
    label : str
        Its entry in the legend; "" for none.
    layer : int
        Larger is nearer to the eye.
    swatch : str
        Colour of its entry in the legend, where that stands for bands of several colours; "" for its own.
    """

    x: Vector
    lower: Vector
    upper: Vector
    colour: str
    opacity: float = 0.25
    label: str = ""
    layer: int = 0
    swatch: str = ""


@dataclass(frozen=True, eq=False)
class Foot:
    """Symbols along the foot of the panel, for values that have no place on its vertical axis.

    Parameters
    ----------
    x : (n,) array
        In the units of the horizontal axis.
    stroke : Stroke
        How the symbols look.
    label : str
        Its entry in the legend; "" for none.
    """

    x: Vector
    stroke: Stroke
    label: str = ""


@dataclass(frozen=True)
class Text:
    """A remark in the panel, at a position in fractions of its width and height."""

    text: str
    x: float = 0.5
    y: float = 0.5


Mark: TypeAlias = Line | Band | Foot
"""What carries data."""


@dataclass(frozen=True)
class Tick:
    """A position on an axis and what is written there."""

    value: float
    label: str


@dataclass(frozen=True)
class Axis:
    """One axis, complete: nothing is left to a library's automatic choice.

    Parameters
    ----------
    label : str
        The quantity and its unit.
    limits : tuple of two floats
        Both positive on a logarithmic axis.
    ticks : tuple of Tick
        The labelled positions.
    minor : tuple of float
        Positions with a small tick and no label.
    grid : tuple of float
        Where grid lines run.
    opposite : tuple of Tick
        A second reading of the same scale on the opposite side (minutes and hours over seconds).
    linear : float
        Positions up to so far from zero are evenly spaced, those beyond logarithmically: 0 is a logarithmic axis,
        infinity a linear one.
    """

    label: str
    limits: tuple[float, float]
    ticks: tuple[Tick, ...]
    minor: tuple[float, ...] = ()
    grid: tuple[float, ...] = ()
    opposite: tuple[Tick, ...] = ()
    linear: float = 0.0


@dataclass(frozen=True, eq=False)
class Panel:
    """One pair of axes and what is on it; the order of the marks is the order of the legend."""

    x: Axis
    y: Axis
    marks: tuple[Mark, ...]
    title: str = ""
    texts: tuple[Text, ...] = ()

    @property
    def lines(self) -> tuple[Line, ...]:
        """The curves."""
        return tuple(mark for mark in self.marks if isinstance(mark, Line))

    @property
    def bands(self) -> tuple[Band, ...]:
        """The shaded regions."""
        return tuple(mark for mark in self.marks if isinstance(mark, Band))

    @property
    def feet(self) -> tuple[Foot, ...]:
        """The symbols along the foot."""
        return tuple(mark for mark in self.marks if isinstance(mark, Foot))

    @property
    def labels(self) -> tuple[str, ...]:
        """The entries of the legend, in order, each once."""
        return tuple(dict.fromkeys(mark.label for mark in self.marks if mark.label))

    def __getitem__(self, label: str) -> Mark:
        """The first mark with this entry in the legend."""
        for mark in self.marks:
            if mark.label == label:
                return mark
        raise KeyError(label)


@dataclass(frozen=True, eq=False)
class Figure:
    """Panels in rows, with one legend for all of them.

    Parameters
    ----------
    rows : tuple of tuple of Panel
        The panels of a row share its width; None leaves a place empty. Panels stand in columns where all rows are of
        one length.
    width, height : float
        Size in millimetres.
    title : str
        Over all panels; "" for none.
    legend_columns : int
        How many entries stand side by side under the panels.
    heights : tuple of float
        Of the rows, as shares; empty where they are all of one height.
    """

    rows: tuple[tuple[Panel | None, ...], ...]
    width: float = 120.0
    height: float = 90.0
    title: str = ""
    legend_columns: int = 2
    heights: tuple[float, ...] = ()

    @property
    def panels(self) -> tuple[Panel, ...]:
        """All panels, row by row, without the empty places."""
        return tuple(panel for row in self.rows for panel in row if panel is not None)

    @property
    def labels(self) -> tuple[str, ...]:
        """The entries of the legend, in order, each once."""
        return tuple(dict.fromkeys(label for panel in self.panels for label in panel.labels))


def single_panel(panel: Panel, height: float = 80.0, legend_rows: int = 0) -> Figure:
    """A figure of one panel `height` mm high, with room below for its legend, of at least so many rows."""
    rows = max((len(panel.labels) + 1) // 2, legend_rows)
    return Figure(((panel,),), height=height + 4.0 * rows)


def drawable(values: Vector) -> Vector:
    """`values` with NaN where a logarithmic axis has no place for them: zero, negative, not finite."""
    kept = np.isfinite(values) & (values > 0)
    return np.where(kept, values, np.nan)
