"""Plain description of a plot: a Figure has rows of Panels, and a Panel two Axes and several Marks.

The renderers for Matplotlib and Plotly make no further decisions. Positions are in the units of axis labels."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import TYPE_CHECKING, Any, Literal, ParamSpec, TypeAlias

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.extras import library

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure


Symbol = Literal["circle", "square", "diamond", "triangle", "down", "cross", "plus", "star"]
"""The symbols that each renderer must support."""


PAGE = 174.0  # width of a plot (mm) that fills two columns of a printed page


@dataclass(frozen=True)
class Stroke:
    """Style of a line: colour, width, dashes and symbols."""

    colour: str  # "#rrggbb"
    width: float = 1.0  # width in points
    # alternating lengths of dashes and gaps, in units of the width; empty for a solid line
    dash: tuple[float, ...] = ()
    symbol: Symbol | None = None  # symbol at each point; None for no symbol
    # Whether the symbols are filled. Unfilled symbols mark, for example, levels that a fit left out.
    filled: bool = True


@dataclass(frozen=True, eq=False)
class Polyline:
    """A curve y(x), interrupted where y is NaN. If the width of its stroke is 0, only the symbols are drawn."""

    # (n,) positions in the units of the axes
    x: Vector
    y: Vector
    stroke: Stroke
    label: str = ""  # legend entry; "" for none
    layer: int = 0  # marks with a higher layer are drawn in front of others
    swatch: str = ""  # colour in the legend of Matplotlib, if the entry stands for curves of several colours


@dataclass(frozen=True, eq=False)
class Band:
    """A shaded region between `lower` and `upper` over x, for example between confidence limits."""

    # (n,) positions; NaN interrupts the band, and an edge at infinity, or 0 on a logarithmic axis, is at the border.
    x: Vector
    lower: Vector
    upper: Vector
    colour: str  # "#rrggbb"
    opacity: float = 0.25  # from 0 to 1
    label: str = ""  # legend entry; "" for none
    layer: int = 0  # marks with a higher layer are drawn in front of others
    # colour of the legend entry, if one entry stands for bands of several colours; "" for the colour of the band
    swatch: str = ""


@dataclass(frozen=True, eq=False)
class Foot:
    """Symbols along the lower border of the panel, for values that its vertical axis cannot show, such as zero."""

    x: Vector  # (n,) positions in the unit of the horizontal axis
    stroke: Stroke  # style of the symbols
    label: str = ""  # legend entry; "" for none


FOOT = 0.03  # height of the symbols of a `Foot`, as a fraction of the panel


@dataclass(frozen=True)
class Text:
    """A text in a panel. Its position is given as fractions of the width and height of the panel."""

    text: str
    x: float = 0.5
    y: float = 0.5


Mark: TypeAlias = Polyline | Band | Foot  # an element of a panel that shows data


@dataclass(frozen=True)
class Tick:
    """A position on an axis and its label."""

    value: float
    label: str


@dataclass(frozen=True)
class Axis:
    """One axis with its limits and all of its ticks. A renderer adds no ticks of its own."""

    label: str  # the quantity and its unit
    limits: tuple[float, float]  # lower and upper end; both are positive on a logarithmic axis
    ticks: tuple[Tick, ...]  # the labelled positions
    minor: tuple[float, ...] = ()  # positions with a small tick and no label
    grid: tuple[float, ...] = ()  # positions of grid lines
    # ticks on the opposite side of the panel, for example minutes and hours if the axis is in seconds
    opposite: tuple[Tick, ...] = ()
    # Linear between ± `linear`, logarithmic outside: 0 for a logarithmic axis, infinity for a linear one.
    linear: float = 0.0


@dataclass(frozen=True, eq=False)
class Panel:
    """Two axes with their marks. The order of the marks is the order of the legend."""

    x: Axis
    y: Axis
    marks: tuple[Mark, ...]
    title: str = ""
    texts: tuple[Text, ...] = ()

    @property
    def lines(self) -> tuple[Polyline, ...]:
        """The curves."""
        return tuple(mark for mark in self.marks if isinstance(mark, Polyline))

    @property
    def bands(self) -> tuple[Band, ...]:
        """The shaded regions."""
        return tuple(mark for mark in self.marks if isinstance(mark, Band))

    @property
    def feet(self) -> tuple[Foot, ...]:
        """The symbols along the lower border."""
        return tuple(mark for mark in self.marks if isinstance(mark, Foot))

    @property
    def labels(self) -> tuple[str, ...]:
        """The legend entries in order, without duplicates."""
        return tuple(dict.fromkeys(mark.label for mark in self.marks if mark.label))

    def __getitem__(self, label: str) -> Mark:
        """Return the first mark with this legend entry."""
        for mark in self.marks:
            if mark.label == label:
                return mark
        raise KeyError(label)


@dataclass(frozen=True, eq=False)
class Figure:
    """Panels in rows, with one legend for all of them."""

    # Panels of a row have one width, None is empty; rows of one length are aligned in columns.
    rows: tuple[tuple[Panel | None, ...], ...]
    # size in millimetres
    width: float = 120.0
    height: float = 90.0
    title: str = ""  # title above all panels; "" for none
    legend_columns: int = 2  # number of columns of the legend, which is below the panels
    heights: tuple[float, ...] = ()  # relative heights of the rows; empty if all rows have the same height

    @property
    def panels(self) -> tuple[Panel, ...]:
        """All panels, row by row, without the empty positions."""
        return tuple(panel for row in self.rows for panel in row if panel is not None)

    @property
    def labels(self) -> tuple[str, ...]:
        """The legend entries of all panels in order, without duplicates."""
        return tuple(dict.fromkeys(label for panel in self.panels for label in panel.labels))


def single_panel(panel: Panel, height: float = 80.0, legend_rows: int = 0) -> Figure:
    """Return a figure with one panel of `height` mm, and space below it for a legend of at least `legend_rows` rows."""
    rows = max((len(panel.labels) + 1) // 2, legend_rows)
    return Figure(((panel,),), height=height + 4.0 * rows)


def drawable(values: Vector) -> Vector:
    """Return `values` with NaN for each value that a logarithmic axis cannot show (zero, negative or not finite)."""
    return np.where(np.isfinite(values) & (values > 0), values, np.nan)


P = ParamSpec("P")

_OPTIONS = {
    "view": """view : "auto", "allan" or "wavelet"
    Quantity to draw: the Allan deviation √(2ν²) against the averaging time τ/2 (s), or the wavelet variance ν² against
    the scale τ (s). By default the Allan deviation, if the filter is Haar's.""",
    "units": """units : "auto", "datasheet" or "si"
    Units of the plot: deg/h and mg, or rad/s and m/s². By default, Allan deviations are in datasheet units, and
    everything else is in SI units. Data in other units are not converted.""",
    "ax": """ax : matplotlib Axes, optional
    Axes to draw on; by default the axes of a new figure.""",
    "path": """path : path, optional
    File to write the picture to, ending in .png, .pdf or .svg.""",
}
"""Documentation of the options that plots share."""
_SECTIONS = {
    "Parameters": "Parameters\n----------",
    "Returns": """Returns
-------
matplotlib.figure.Figure
    A figure that is not registered with pyplot, so it need not be closed. Notebooks display it.""",
    "Raises": """Raises
------
OptionError
    If an option is unknown, or the data do not support it.""",
}
"""Sections that the documentation of each plot has, and their content if the function does not document them."""


def drawing(describe: Callable[P, Figure]) -> Callable[P, MatplotlibFigure]:
    """Draw the figure that a function describes, with its options `ax` and `path`, and complete its docstring."""

    @wraps(describe)
    def plot(*arguments: P.args, **options: P.kwargs) -> MatplotlibFigure:
        library("matplotlib")
        from gmwm.showing.plots.axes import one_tick_form
        from gmwm.showing.plots.matplotlib import draw

        places: dict[str, Any] = {name: options.get(name) for name in ("ax", "path")}
        return draw(one_tick_form(describe(*arguments, **options)), **places)

    text = inspect.getdoc(describe) or ""
    names = [*inspect.signature(describe).parameters]
    head, *written = re.split(r"\n\n(?=\w+\n---)", text)
    sections = _SECTIONS | {section.partition("\n")[0]: section for section in written}
    specific = sections["Parameters"]
    common = [words for name, words in _OPTIONS.items() if name in names and f"\n{name} : " not in specific]
    sections["Parameters"] = "\n".join([specific, *common])
    plot.__doc__ = "\n\n".join([head, *sections.values()]) + "\n"
    return plot


def description(plot: Callable[P, MatplotlibFigure]) -> Callable[P, Figure]:
    """Return the function that describes the figure of a plot without Matplotlib, for another renderer or a test."""
    describe: Callable[P, Figure] = vars(plot)["__wrapped__"]
    return describe
