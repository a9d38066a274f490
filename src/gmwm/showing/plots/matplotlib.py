"""The renderer for Matplotlib, which draws the figures of `gmwm.showing.plots.figure` without pyplot's global state."""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axes._secondary_axes import SecondaryAxis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as MatplotlibFigure
from matplotlib.lines import Line2D
from matplotlib.markers import TICKDOWN, TICKLEFT, MarkerStyle
from matplotlib.patches import Patch
from matplotlib.scale import LinearScale, LogScale, ScaleBase, SymmetricalLogScale
from matplotlib.ticker import FixedFormatter, FixedLocator, NullLocator

from gmwm.base.atomic_files import write_bytes
from gmwm.base.errors import OptionError
from gmwm.showing.plots.figure import FOOT, Axis, Band, Figure, Foot, Mark, Panel, Stroke, Symbol, Tick
from gmwm.showing.plots.legend import EDGE, MILLIMETRE, fold, legend_below, legend_inside
from gmwm.showing.plots.style import GRID
from gmwm.showing.plots.trace import lone_values

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axis import Axis as MatplotlibAxis
    from matplotlib.figure import FigureBase
    from matplotlib.gridspec import SubplotSpec

FORMATS = (".png", ".pdf", ".svg")
"""Suffixes of the picture formats that can be written."""

PRINT_DPI = 300
"""Resolution of a .png file. Both pictures of a calibration take 0.65 s of processor time, and 0.75 s at 400 dpi."""
TEXT_SIZE = 8.0

_SYMBOLS: dict[Symbol, str] = {
    "circle": "o", "square": "s", "diamond": "D", "triangle": "^", "down": "v", "cross": "x", "plus": "+",
    "star": "*",
}  # fmt: skip

# Metadata without dates, so that two pictures of the same data have the same bytes.
_METADATA: dict[str, dict[str, None]] = {".png": {}, ".pdf": {"CreationDate": None}, ".svg": {"Date": None}}


class Picture(MatplotlibFigure):
    """A Matplotlib figure that notebooks display although it is not registered with pyplot."""

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png")
        return buffer.getvalue()


def draw(figure: Figure, *, ax: Axes | None = None, path: str | os.PathLike[str] | None = None) -> MatplotlibFigure:
    """Draw a figure with Matplotlib, and write the picture to a file if a path is given.

    If writing fails, an existing file is not changed.

    Parameters
    ----------
    figure : Figure
        Description of the plot.
    ax : matplotlib Axes, optional
        Axes on which a plot with one panel and its legend are drawn. Default: a new Matplotlib figure.
    path : path, optional
        File to write, ending in .png, .pdf or .svg.

    Returns
    -------
    matplotlib.figure.Figure
        The new figure, or the figure of `ax`.

    Raises
    ------
    OptionError
        If `ax` is not a Matplotlib Axes, if it is given for a plot of several panels, or if `path` has another suffix.
    """
    if path is not None and Path(path).suffix.lower() not in FORMATS:
        raise OptionError(argument="path", expected=f"a path that ends in {', '.join(FORMATS)}", got=str(path))
    picture = _new_picture(figure) if ax is None else _onto(figure, ax)
    if path is not None:
        save(picture, path)
    return picture


def save(picture: MatplotlibFigure, path: str | os.PathLike[str]) -> None:
    """Write a picture in the format that the suffix of `path` names. The same picture always gives the same bytes."""
    write_bytes(path, render(picture, Path(path).suffix.lower()))


def render(picture: MatplotlibFigure, suffix: str) -> bytes:
    """Return the content of a file with the suffix ".png", ".pdf" or ".svg"."""
    # Text in a PDF stays text (font type 42), as journals require. The salt makes the identifiers in an SVG
    # reproducible.
    settings: Any = {"svg.hashsalt": "gmwm", "pdf.fonttype": 42}
    buffer = io.BytesIO()
    with matplotlib.rc_context(settings):
        if suffix == ".png":
            # `savefig` draws twice if there is a layout engine.
            canvas, picture.dpi = picture.canvas, PRINT_DPI
            FigureCanvasAgg(picture).print_png(buffer)  # type: ignore[no-untyped-call]
            picture.set_canvas(canvas)
        else:
            picture.savefig(buffer, format=suffix[1:], dpi=PRINT_DPI, metadata=_METADATA[suffix])
    return buffer.getvalue()


def _new_picture(figure: Figure) -> MatplotlibFigure:
    # 200 dpi in a notebook; `savefig` below chooses its own resolution.
    picture = Picture(figsize=(figure.width * MILLIMETRE, figure.height * MILLIMETRE), dpi=200, layout="constrained")
    handles: dict[str, Artist] = {}
    for row, place in zip(_with_titles(figure), _places(picture, figure), strict=True):
        for panel, (part, at) in zip(row, place, strict=True):
            if panel is not None:
                for label, handle in draw_panel(panel, part.add_subplot(at)).items():
                    handles.setdefault(label, handle)
    picture.align_ylabels()
    if figure.title:
        title = fold(figure.title, (figure.width - 2 * EDGE) * MILLIMETRE * 72, TEXT_SIZE + 1)
        picture.suptitle(title, fontsize=TEXT_SIZE + 1)
    if handles:
        legend_below(picture, handles, figure.legend_columns)
    return picture


def _wrap_titles(row: Sequence[Panel | None], width: float) -> list[Panel | None]:
    """Return a row of panels with their titles wrapped to the width of a panel, if the figure is `width` mm wide."""
    room = (width / len(row) - 18.0) * MILLIMETRE * 72  # 18 mm are for the labels on both sides of a panel
    return [panel and replace(panel, title=fold(panel.title, room, TEXT_SIZE)) for panel in row]


def _with_titles(figure: Figure) -> list[list[Panel | None]]:
    """Return the rows of panels with wrapped titles. Titles in a grid have the same number of lines, so that its rows
    have the same height."""
    rows = [_wrap_titles(row, figure.width) for row in figure.rows]
    if figure.heights or len({len(row) for row in rows}) > 1:
        return rows
    most = max(panel.title.count("\n") for panel in figure.panels)
    return [
        [panel and replace(panel, title="\n" * (most - panel.title.count("\n")) + panel.title) for panel in row]
        for row in rows
    ]


def _places(picture: MatplotlibFigure, figure: Figure) -> list[list[tuple[FigureBase, SubplotSpec]]]:
    """Return the parent figure and the grid cell of each panel. All panels are in one grid, or each row has its own
    grid if the rows differ in length."""
    heights = figure.heights or None
    lengths = [len(row) for row in figure.rows]
    if len(set(lengths)) == 1:
        grid = picture.add_gridspec(len(lengths), lengths[0], height_ratios=heights)
        return [[(picture, grid[i, k]) for k in range(length)] for i, length in enumerate(lengths)]
    parts = picture.subfigures(len(lengths), 1, height_ratios=heights, squeeze=False)[:, 0]
    grids = [part.add_gridspec(1, length) for part, length in zip(parts, lengths, strict=True)]
    return [[(p, g[0, k]) for k in range(n)] for p, g, n in zip(parts, grids, lengths, strict=True)]


def _onto(figure: Figure, ax: Axes) -> MatplotlibFigure:
    if not isinstance(ax, Axes):
        raise OptionError(
            argument="ax", expected="Matplotlib axes", got=ax, advice="Pass the result of `figure.add_subplot()`."
        )
    if len(figure.panels) != 1:
        raise OptionError(
            f"the plot has {len(figure.panels)} panels, but Matplotlib axes have room for one", argument="ax", got=ax,
            advice="Call it without {--ax}.",
        )  # fmt: skip
    artists, labels = ax.get_legend_handles_labels()
    earlier: dict[str, Artist] = {}
    for label, artist in zip(labels, artists, strict=True):
        earlier.setdefault(label, artist)
    # Remove the ticks on the opposite side, because they are drawn again with the new limits.
    for child in [child for child in ax.child_axes if isinstance(child, SecondaryAxis)]:
        child.remove()
    handles = {**earlier, **draw_panel(figure.panels[0], ax)}
    if handles:
        legend_inside(ax, handles)
    owner: Any = ax.figure
    while not isinstance(owner, MatplotlibFigure):
        owner = owner.figure
    return owner


def draw_panel(panel: Panel, ax: Axes) -> dict[str, Artist]:
    """Draw one panel on Matplotlib axes, and return the artist for each legend entry."""
    ax.set_xscale(_scale(panel.x))
    ax.set_yscale(_scale(panel.y))
    handles: dict[str, Artist] = {}
    for mark in panel.marks:
        artist = _draw_mark(mark, ax, _far(panel.y))
        if mark.label:
            handles.setdefault(mark.label, artist)
    for text in panel.texts:
        place: dict[str, Any] = {"transform": ax.transAxes, "ha": "center", "va": "center"}
        ax.text(text.x, text.y, text.text, fontsize=TEXT_SIZE, **place)
    ax.vlines(panel.x.grid, 0, 1, transform=ax.get_xaxis_transform(), colors=GRID, linewidths=0.5, zorder=0.5)
    ax.hlines(panel.y.grid, 0, 1, transform=ax.get_yaxis_transform(), colors=GRID, linewidths=0.5, zorder=0.5)
    _dress(ax.xaxis, panel.x)
    _dress(ax.yaxis, panel.y)
    ax.set_xlim(panel.x.limits)
    ax.set_ylim(panel.y.limits)
    for spine in ax.spines.values():
        spine.set_linewidth(0.7)
    if panel.x.opposite:
        _opposite(ax.secondary_xaxis("top").xaxis, panel.x.opposite)
    if panel.y.opposite:
        _opposite(ax.secondary_yaxis("right").yaxis, panel.y.opposite)
    if panel.title:
        ax.set_title(panel.title, fontsize=TEXT_SIZE)
    return handles


def _scale(axis: Axis) -> ScaleBase:
    if axis.linear == 0:
        return LogScale(None)
    return SymmetricalLogScale(None, linthresh=axis.linear) if np.isfinite(axis.linear) else LinearScale(None)


def _far(axis: Axis) -> tuple[float, float]:
    """Return a position far below and a position far above the limits of an axis."""
    low, high = axis.limits
    return (low / 100, high * 100) if axis.linear == 0 else (2 * low - high, 2 * high - low)


def _draw_mark(mark: Mark, ax: Axes, far: tuple[float, float]) -> Artist:
    if isinstance(mark, Foot):
        place, style = np.full(mark.x.shape, FOOT), _line_style(mark.stroke)
        return ax.plot(mark.x, place, label=mark.label, transform=ax.get_xaxis_transform(), **style)[0]
    if isinstance(mark, Band):
        return _draw_band(mark, ax, far)
    line = ax.plot(mark.x, mark.y, label=mark.label, zorder=2 + mark.layer / 10, **_line_style(mark.stroke))[0]
    return Line2D([], [], **_line_style(replace(mark.stroke, colour=mark.swatch))) if mark.swatch else line


def _draw_band(band: Band, ax: Axes, far: tuple[float, float]) -> Artist:
    """Draw a band, and return a separate artist for the legend. Before Matplotlib 3.11, a legend below several panels
    cannot show the band itself."""
    # Edges at zero or infinity cannot be drawn, so they are moved far outside the panel.
    lower, upper = (np.clip(edge, *far) for edge in (band.lower, band.upper))
    style: dict[str, Any] = {"color": band.colour, "alpha": band.opacity, "zorder": 2 + band.layer / 10}
    # A single point between missing values has no area, so a bar is drawn instead.
    alone = lone_values(np.where(np.isfinite(upper), lower, np.nan))
    if np.any(alone):
        ax.vlines(band.x[alone], lower[alone], upper[alone], linewidth=4.0, **style)
    ax.fill_between(band.x, lower, upper, linewidth=0, label=band.label, **style)
    return Patch(color=band.swatch or band.colour, alpha=0.25 if band.swatch else band.opacity, linewidth=0)


def _line_style(stroke: Stroke) -> dict[str, Any]:
    drawn: Any = "none" if stroke.width == 0 else (0, stroke.dash) if stroke.dash else "solid"
    return {
        "color": stroke.colour, "linewidth": stroke.width, "linestyle": drawn,
        "marker": _SYMBOLS[stroke.symbol] if stroke.symbol else "none", "markersize": 3.2,
        "markerfacecolor": stroke.colour if stroke.filled else "white", "markeredgewidth": 0.8,
    }  # fmt: skip


def _dress(axis: MatplotlibAxis, data: Axis) -> None:
    """Set the label of a Matplotlib axis, and exactly the ticks of `data`."""
    axis.set_major_locator(FixedLocator([tick.value for tick in data.ticks]))
    axis.set_major_formatter(FixedFormatter([tick.label for tick in data.ticks]))
    axis.set_minor_locator(NullLocator())
    axis.set_tick_params(labelsize=7.0, length=3.5, width=0.7)
    if data.minor:
        axis.axes.add_artist(_minor_ticks(axis, data.minor))
    axis.set_label_text(data.label, fontsize=TEXT_SIZE)


def _minor_ticks(axis: MatplotlibAxis, places: tuple[float, ...]) -> Line2D:
    """Return the minor ticks of an axis as one artist. Minor ticks of Matplotlib always have labels, even if empty.
    Their layout would take half of the time of a picture."""
    ax, edge = axis.axes, [0.0] * len(places)
    along = axis is ax.xaxis
    ticks = Line2D(
        places if along else edge, edge if along else places, linestyle="none",
        marker=MarkerStyle(TICKDOWN if along else TICKLEFT), markersize=1.8, markeredgewidth=0.5, color="black",
        clip_on=False, zorder=axis.zorder, transform=ax.get_xaxis_transform() if along else ax.get_yaxis_transform(),
    )  # fmt: skip
    ticks.set_in_layout(False)
    return ticks


def _opposite(axis: MatplotlibAxis, ticks: tuple[Tick, ...]) -> None:
    """Set the ticks of the secondary axis on the opposite side of a panel."""
    for spine in axis.axes.spines.values():
        spine.set_visible(False)
    axis.set_major_locator(FixedLocator([tick.value for tick in ticks]))
    axis.set_major_formatter(FixedFormatter([tick.label for tick in ticks]))
    axis.set_minor_locator(NullLocator())
    axis.set_tick_params(labelsize=7.0, length=2.5, width=0.7, pad=1.5)
