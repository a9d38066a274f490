"""The renderer for Matplotlib, which draws the figures of `gmwm.showing.plots.figure` without pyplot's global state."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axes._secondary_axes import SecondaryAxis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as MatplotlibFigure
from matplotlib.figure import FigureBase
from matplotlib.font_manager import FontProperties
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.markers import TICKDOWN, TICKLEFT, MarkerStyle
from matplotlib.patches import Patch
from matplotlib.scale import LinearScale, LogScale, ScaleBase, SymmetricalLogScale
from matplotlib.textpath import text_to_path
from matplotlib.ticker import FixedFormatter, FixedLocator, NullLocator
from matplotlib.transforms import Bbox, ScaledTranslation

from gmwm.base.arrays import Vector
from gmwm.base.atomic_files import write_bytes
from gmwm.base.errors import OptionError
from gmwm.showing.plots.figure import FOOT, Axis, Band, Figure, Foot, Mark, Panel, Stroke, Symbol, Tick
from gmwm.showing.plots.style import GRID
from gmwm.showing.plots.trace import lone_values

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axis import Axis as MatplotlibAxis
    from matplotlib.gridspec import SubplotSpec

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
    """Draw one legend below all panels, in at most `columns`; the figure grows, so that panels keep their size."""
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
    """Yield entries (with line breaks) and columns of legends within `room` points, from best to always fitting."""
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


FORMATS = (".png", ".pdf", ".svg")  # suffixes of the picture formats that can be written

PRINT_DPI = 300
"""Resolution of a .png file. Both pictures of a calibration take 0.65 s of processor time, and 0.75 s at 400 dpi."""
TEXT_SIZE, TICK_SIZE, TICK_LENGTH = 8.0, 7.0, 3.5

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


class _MeasuredAxes(Axes):
    """Axes whose labels are measured once for each layout: they hardly change when the panel gets its size."""

    beyond: Vector | None = None  # (4,) distances (pixels) of the outer box from the panel, while a layout is computed

    def get_tightbbox(self, *arguments: Any, for_layout_only: bool = False, **options: Any) -> Any:
        """Return the box around the panel with its labels."""
        if for_layout_only and self.beyond is not None:
            return Bbox.from_extents(*np.add(self.bbox.extents, self.beyond))
        box = super().get_tightbbox(*arguments, for_layout_only=for_layout_only, **options)
        if for_layout_only and box is not None:
            self.beyond = np.subtract(box.extents, self.bbox.extents)
        return box


class _MeasuredLayout(ConstrainedLayoutEngine):
    """The constrained layout, which places the panels twice, and measures their labels, most of its work, once."""

    def execute(self, fig: MatplotlibFigure) -> None:
        """Place the panels."""
        super().execute(fig)
        for ax in fig.axes:
            if isinstance(ax, _MeasuredAxes):
                ax.beyond = None


def draw(figure: Figure, *, ax: Axes | None = None, path: str | os.PathLike[str] | None = None) -> MatplotlibFigure:
    """Draw on new Matplotlib axes or on `ax`, and write to `path` (.png, .pdf, .svg; kept if writing fails)."""
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
    # PDFs keep text (font type 42), as journals require; the salt makes identifiers in an SVG reproducible.
    settings: Any = {"svg.hashsalt": "gmwm", "pdf.fonttype": 42}
    buffer = io.BytesIO()
    with matplotlib.rc_context(settings):
        if suffix == ".png":
            # `savefig` draws twice if there is a layout engine.
            canvas, picture.dpi = picture.canvas, PRINT_DPI
            # Level 1 takes 0.7 of the time of Pillow's level 6; the files are 15 % larger.
            FigureCanvasAgg(picture).print_png(buffer, pil_kwargs={"compress_level": 1})  # type: ignore[no-untyped-call]
            picture.set_canvas(canvas)
        else:
            picture.savefig(buffer, format=suffix[1:], dpi=PRINT_DPI, metadata=_METADATA[suffix])
    return buffer.getvalue()


def _new_picture(figure: Figure) -> MatplotlibFigure:
    # 200 dpi in a notebook; `savefig` below chooses its own resolution.
    picture = Picture(
        figsize=(figure.width * MILLIMETRE, figure.height * MILLIMETRE), dpi=200, layout=_MeasuredLayout()
    )
    handles: dict[str, Artist] = {}
    for row, place in zip(_with_titles(figure), _places(picture, figure), strict=True):
        for panel, (part, at) in zip(row, place, strict=True):
            if panel is not None:
                for label, handle in draw_panel(panel, part.add_subplot(at, axes_class=_MeasuredAxes)).items():
                    handles.setdefault(label, handle)
    _align_labels(figure, picture.axes)
    if figure.title:
        title = fold(figure.title, (figure.width - 2 * EDGE) * MILLIMETRE * 72, TEXT_SIZE + 1)
        picture.suptitle(title, fontsize=TEXT_SIZE + 1)
    if handles:
        legend_below(picture, handles, figure.legend_columns)
    return picture


def _align_labels(figure: Figure, axes: Sequence[Axes]) -> None:
    """Place the vertical labels of each column of panels beside its widest tick label. `Figure.align_ylabels` measures
    the labels of the column again for each panel, which takes a third of the time of a picture."""
    columns: dict[int, list[tuple[Panel, Axes]]] = {}
    drawn = iter(axes)
    for row in figure.rows:
        for column, panel in enumerate(row):
            if panel is not None:
                columns.setdefault(column, []).append((panel, next(drawn)))
    for of_column in columns.values():
        ticks = [(tick, *panel.y.limits) for panel, _ in of_column for tick in panel.y.ticks]
        shown = [tick.label for tick, low, high in ticks if low <= tick.value <= high]
        widest = max((width_of(label, TICK_SIZE) for label in shown), default=0.0)
        for _, ax in of_column:
            shift = ScaledTranslation(-(widest + TICK_LENGTH + 7.5) / 72, 0, ax.figure.dpi_scale_trans)
            ax.yaxis.set_label_coords(0, 0.5, ax.transAxes + shift)


def _wrap_titles(row: Sequence[Panel | None], width: float) -> list[Panel | None]:
    """Return a row of panels with their titles wrapped to the width of a panel, if the figure is `width` mm wide."""
    room = (width / len(row) - 18.0) * MILLIMETRE * 72  # 18 mm are for the labels on both sides of a panel
    return [panel and replace(panel, title=fold(panel.title, room, TEXT_SIZE)) for panel in row]


def _with_titles(figure: Figure) -> list[list[Panel | None]]:
    """Return rows with wrapped titles, of equal numbers of lines in a grid, so that rows have the same height."""
    rows = [_wrap_titles(row, figure.width) for row in figure.rows]
    if figure.heights or len({len(row) for row in rows}) > 1:
        return rows
    most = max(panel.title.count("\n") for panel in figure.panels)
    return [
        [panel and replace(panel, title="\n" * (most - panel.title.count("\n")) + panel.title) for panel in row]
        for row in rows
    ]


def _places(picture: MatplotlibFigure, figure: Figure) -> list[list[tuple[FigureBase, SubplotSpec]]]:
    """Return the parent figure and grid cell of each panel: one grid, or one by row if lengths differ."""
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
        room = 72 * ax.bbox.width / ax.figure.dpi - 2 * _AROUND * LEGEND_SIZE
        names = [fold(name, _text_room(room, 1), LEGEND_SIZE) for name in handles]
        ax.legend([*handles.values()], names, **_LOOK)
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
        # Without `y`, Matplotlib measures all tick labels to place the title above those at the top.
        ax.set_title(panel.title, fontsize=TEXT_SIZE, y=None if panel.x.opposite else 1.0)
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
    """Draw a band, and return a legend artist: before Matplotlib 3.11, a common legend cannot show the band."""
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
    axis.set_tick_params(labelsize=TICK_SIZE, length=TICK_LENGTH, width=0.7)
    if data.minor:
        axis.axes.add_artist(_minor_ticks(axis, data.minor))
    axis.set_label_text(data.label, fontsize=TEXT_SIZE)


def _minor_ticks(axis: MatplotlibAxis, places: tuple[float, ...]) -> Line2D:
    """Return minor ticks as one artist; Matplotlib's have labels, whose layout takes half the time of a picture."""
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
