"""Figures of a report for Plotly, in every available view and unit; `safe` escapes strings, which Plotly interprets."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from html import escape
from typing import Any

import numpy as np

from gmwm.base.arrays import Vector, runs_of
from gmwm.base.errors import OptionError
from gmwm.base.units import by_sensor
from gmwm.calibration.result import AxisCalibration, Calibration
from gmwm.choosing.replicates import Replicates
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.regression import Regression
from gmwm.measuring.spectrum import PowerSpectrum
from gmwm.showing.plots.curves import Item, overlay_panel, plot_recordings
from gmwm.showing.plots.figure import FOOT, Axis, Band, Foot, Mark, Panel, Polyline, Stroke, Symbol, Tick, description
from gmwm.showing.plots.fit import fit_panel
from gmwm.showing.plots.labels import UnitSystem, ViewName, sensor_and_letter, sensor_title
from gmwm.showing.plots.ranking import plot_ranking
from gmwm.showing.plots.results import regression_panel
from gmwm.showing.plots.spectrum import spectrum_panel
from gmwm.showing.plots.style import GRID, curve_stroke, letter_stroke
from gmwm.theory.processes.model import Model

POSITION_DIGITS = 6  # number of significant digits of a position, which is more than a screen can show

_SYMBOLS: dict[Symbol, str] = {
    "circle": "circle", "square": "square", "diamond": "diamond", "triangle": "triangle-up", "down": "triangle-down",
    "cross": "x-thin", "plus": "cross-thin", "star": "star",
}  # fmt: skip
_THIN = ("x-thin", "cross-thin")


def safe(text: str) -> str:
    """Escape HTML and the placeholders of Plotly's templates in a text.

    >>> safe("<b>%{x}</b> & more")
    '&lt;b&gt;%&#123;x}&lt;/b&gt; &amp; more'
    """
    return escape(text).replace("%{", "%&#123;")


def plotly_panel(panel: Panel) -> dict[str, Any]:
    """Convert a panel to "data" (traces), "layout" and "entries" (of the legend). A click on an entry hides marks of
    this name, and unnamed ones of its colour."""
    across, up = Scale(panel.x), Scale(panel.y)
    seen: set[str] = set()
    drawn: list[tuple[int, dict[str, Any]]] = []
    for place, (mark, group) in enumerate(_with_entries(panel.marks)):
        trace = _trace(mark, panel, across, up)
        first = bool(mark.label) and mark.label not in seen
        seen.add(mark.label)
        trace |= {"name": safe(mark.label), "legendgroup": safe(group), "showlegend": first, "legendrank": place}
        if first and isinstance(mark, Band) and mark.swatch:
            drawn.append(
                (mark.layer, trace | {"x": [None], "y": [None], "fillcolor": _shade(mark.swatch, mark.opacity)})
            )
            trace["showlegend"] = False
        drawn.append((0 if isinstance(mark, Foot) else mark.layer, trace))
    # Plotly draws later traces in front of earlier traces. The sort is stable.
    return {
        "data": [trace for _, trace in sorted(drawn, key=lambda item: item[0])],
        "layout": _layout(panel, across, up),
        "entries": len(panel.labels),
    }


class Scale:
    """Conversion of values to positions on a Plotly axis. As Plotly has none that is linear about zero and logarithmic
    beyond, values are converted: the linear part and each decade have the length 1."""

    def __init__(self, axis: Axis) -> None:
        self.axis = axis
        self.type = "log" if axis.linear == 0 else "linear"
        self.mixed = axis.linear > 0 and math.isfinite(axis.linear)
        low, high = axis.limits
        # A band with an infinite edge is cut off here.
        self.far = (low / 100.0, high * 100.0) if self.type == "log" else (2 * low - high, 2 * high - low)

    def place(self, values: Vector) -> Vector:
        """Return the positions of values on the axis."""
        if not self.mixed:
            return values
        size = np.abs(values) / self.axis.linear
        beyond = 1 + np.log10(np.maximum(size, 1.0))
        return np.asarray(np.sign(values) * np.where(size <= 1, size, beyond))

    def range(self) -> list[float]:
        """Return the limits of the axis for Plotly, which are exponents on a logarithmic axis."""
        ends = self.place(np.array(self.axis.limits))
        return [_short(end) for end in (np.log10(ends) if self.type == "log" else ends)]

    def at(self, value: float) -> float:
        """Return the position of an annotation, which is an exponent on a logarithmic axis."""
        return self.of(np.array([math.log10(value) if self.type == "log" else value]))[0] or 0.0

    def of(self, values: Vector) -> list[float | None]:
        """Return the positions of values for JSON; None for values that are not finite."""
        return _json(self.place(values))


def _json(values: Vector) -> list[float | None]:
    """Return values with `POSITION_DIGITS` significant digits; None for values that are not finite."""
    # One format for all values takes half of the time of a format for each.
    texts = (f"%.{POSITION_DIGITS - 1}e " * values.size % tuple(values.tolist())).split()
    return [value if math.isfinite(value) else None for value in map(float, texts)]


def _short(value: float) -> float:
    return float(f"{value:.{POSITION_DIGITS - 1}e}")


def _with_entries(marks: tuple[Mark, ...]) -> Iterator[tuple[Mark, str]]:
    """Yield each mark with its legend entry. A mark without a name gets the entry of a line with its colour."""
    by_colour: dict[str, str] = {}
    for mark in marks:
        if isinstance(mark, Polyline) and mark.label:
            by_colour[mark.stroke.colour] = mark.label
        colour = mark.colour if isinstance(mark, Band) else mark.stroke.colour
        yield mark, mark.label or by_colour.get(colour, "")


def _trace(mark: Mark, panel: Panel, across: Scale, up: Scale) -> dict[str, Any]:
    if isinstance(mark, Band):
        return _band(mark, across, up)
    if isinstance(mark, Foot):
        low, high = panel.y.limits
        height = low * (high / low) ** FOOT if up.type == "log" else low + FOOT * (high - low)
        y = np.full(mark.x.shape, height)
        return {"x": across.of(mark.x), "y": up.of(y), "hoverinfo": "skip", **_look(mark.stroke)}
    trace = {"x": across.of(mark.x), "y": up.of(mark.y), **_look(mark.stroke)}
    if not mark.label:
        return trace | {"hoverinfo": "skip"}
    return trace | _hover(mark, panel, up)


def _look(stroke: Stroke) -> dict[str, Any]:
    """Return a stroke as properties of a Plotly trace."""
    modes = [*(["lines"] if stroke.width else []), *(["markers"] if stroke.symbol else [])]
    look: dict[str, Any] = {"type": "scatter", "mode": "+".join(modes) or "none", "connectgaps": False}
    if stroke.width:
        width = stroke.width * (4 / 3)  # CSS pixels
        dash = ",".join(f"{width * part:.3g}px" for part in stroke.dash) or "solid"
        look["line"] = {"color": stroke.colour, "width": _short(width), "dash": dash}
    if stroke.symbol:
        name = _SYMBOLS[stroke.symbol]
        line = {"color": stroke.colour, "width": 1.2}
        fill = stroke.colour if stroke.filled else "#ffffff"
        look["marker"] = {"symbol": name, "size": 6.0 + (name in _THIN), "color": fill, "line": line}
    return look


def _hover(line: Polyline, panel: Panel, up: Scale) -> dict[str, Any]:
    """Return the template of the text at the pointer: name, position, and limits of the band of the line."""
    (_, time), (_, unit) = _quantity(panel.x.label), _quantity(panel.y.label)
    # On an axis that is partly linear and partly logarithmic, the position is not the value.
    value = "%{customdata[0]:+.3~g}" if up.mixed else "%{y:.4~g}"
    rows = [f"<b>{safe(line.label)}</b>", f"τ = %{{x:.4~g}} {safe(time)}", f"{value} {safe(unit)}".rstrip()]
    more = [line.y] if up.mixed else []
    band = next((b for b in panel.bands if b.colour == line.stroke.colour and np.array_equal(b.x, line.x)), None)
    if band is not None and not up.mixed:
        more = [band.lower, band.upper]
        rows.append(f"{safe(band.label)}: %{{customdata[0]:.4~g}} … %{{customdata[1]:.4~g}}")
    hover: dict[str, Any] = {"hovertemplate": "<br>".join(rows) + "<extra></extra>"}
    if more:
        hover["customdata"] = [list(row) for row in zip(*map(_json, more), strict=True)]
    return hover


def _quantity(label: str) -> tuple[str, str]:
    """Split the label of an axis, such as "Allan deviation (deg/h)", into name and unit.

    >>> _quantity("Allan deviation (deg/h)"), _quantity("Distance")
    (('Allan deviation', 'deg/h'), ('Distance', ''))
    """
    name, mark, unit = label.rpartition(" (")
    if not mark:
        return label, ""
    # "(confidence limit = 1)" is not a unit.
    return name, "" if "=" in unit else unit.removesuffix(")")


def _band(band: Band, across: Scale, up: Scale) -> dict[str, Any]:
    """Return a band as a trace with a filled closed line around each run of finite limits."""
    lower, upper = (np.clip(edge, *up.far) for edge in (band.lower, band.upper))
    finite = np.isfinite(lower) & np.isfinite(upper)
    xs: list[float | None] = []
    ys: list[float | None] = []
    for first, last in runs_of(finite).tolist():
        x, low, high = band.x[first:last], lower[first:last], upper[first:last]
        if x.size == 1 and across.type == "log":
            x, low, high = np.array([x[0] / 1.04, x[0] * 1.04]), np.repeat(low, 2), np.repeat(high, 2)  # a bar
        xs += [*across.of(np.concatenate([x, x[::-1], x[:1]])), None]
        ys += [*up.of(np.concatenate([low, high[::-1], low[:1]])), None]
    return {
        "type": "scatter", "x": xs[:-1], "y": ys[:-1], "mode": "lines", "fill": "toself", "hoverinfo": "skip",
        "fillcolor": _shade(band.colour, band.opacity), "line": {"width": 0, "color": band.colour},
    }  # fmt: skip


def _shade(colour: str, opacity: float) -> str:
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},{opacity:g})"


def _layout(panel: Panel, across: Scale, up: Scale) -> dict[str, Any]:
    texts: list[dict[str, Any]] = [
        _text(text.text, "x domain", x=text.x, yref="y domain", y=text.y) for text in panel.texts
    ]
    texts += [_opposite(tick, across) for tick in panel.x.opposite]
    title = {"title": {"text": safe(panel.title)}} if panel.title else {}
    return title | {
        "xaxis": _axis(panel.x, across, minor_grid=True),
        "yaxis": _axis(panel.y, up, minor_grid=False),
        "annotations": texts,
    }


def _axis(axis: Axis, scale: Scale, *, minor_grid: bool) -> dict[str, Any]:
    """Return an axis for Plotly with the ticks and grid lines of the given axis."""
    ticks = np.array([tick.value for tick in axis.ticks])
    minor = np.array(axis.grid if minor_grid else axis.minor, dtype=np.float64)
    return {
        "type": scale.type, "range": scale.range(), "autorange": False, "fixedrange": True, "zeroline": False,
        "title": {"text": safe(axis.label), "standoff": 6}, "tickmode": "array", "ticks": "outside", "ticklen": 5,
        "tickvals": scale.of(ticks), "ticktext": [safe(tick.label) for tick in axis.ticks],
        "showgrid": not minor_grid, "gridcolor": GRID, "linecolor": "#444444", "mirror": True, "showline": True,
        "minor": {"tickmode": "array", "tickvals": scale.of(minor), "ticks": "outside", "ticklen": 3,
                  "showgrid": minor_grid, "gridcolor": GRID},
    }  # fmt: skip


def _text(text: str, xref: str, x: float, yref: str, y: float) -> dict[str, Any]:
    return {"text": safe(text), "xref": xref, "x": x, "yref": yref, "y": y, "showarrow": False, "font": {"size": 12}}


def _opposite(tick: Tick, across: Scale) -> dict[str, Any]:
    """Return the label of a tick on the opposite side of the horizontal axis, above the panel."""
    return _text(tick.label, "x", x=across.at(tick.value), yref="y domain", y=1.0) | {
        "yanchor": "bottom", "font": {"size": 11, "color": "#555555"},
    }  # fmt: skip


VIEWS: tuple[ViewName, ...] = ("allan", "wavelet")
"""Views of a curve. The page starts with the first, which users of inertial sensors know best."""
SYSTEMS: tuple[UnitSystem, ...] = ("datasheet", "si")

Variants = dict[str, dict[str, Any]]  # a figure in several views and units, with keys such as "allan-si"


def sensor_pictures(calibration: Calibration) -> dict[str, list[Variants]]:
    """Return a figure of each sensor with the data and models of its axes, one for each unit if the units differ."""
    pictures: dict[str, list[Variants]] = {}
    for sensor, axes in by_sensor(calibration).items():
        for unit in dict.fromkeys(fit.wavelet_variance.unit for fit in axes.values()):
            fits = {axis: fit for axis, fit in axes.items() if fit.wavelet_variance.unit == unit}
            pictures.setdefault(sensor, []).append(_variants(sensor_panel(sensor, fits)))
    return pictures


def sensor_panel(sensor: str, fits: Mapping[str, Fit]) -> Callable[[ViewName, UnitSystem], Panel]:
    """Return a function that draws the data and the models of the axes of a sensor in a view and unit system."""
    letters = {axis: sensor_and_letter(axis)[1] for axis in fits}
    items: dict[str, Item] = {letters[axis].upper() or axis: fit for axis, fit in fits.items()}
    strokes = [letter_stroke(letter) or curve_stroke(k) for k, letter in enumerate(letters.values())]
    title = sensor_title(sensor) if sensor else ""
    return lambda view, units: overlay_panel(items, view=view, units=units, strokes=strokes, title=title)


def axis_pictures(axis: AxisCalibration) -> tuple[Variants, Variants]:
    """Return two figures of one axis: data, model and terms; and the distances of the best models from the data."""

    def distances(view: ViewName, units: UnitSystem) -> Panel:
        panel = description(plot_ranking)(axis.ranking, view=view, units=units).rows[0][1]
        assert panel is not None
        return panel

    return (
        _variants(lambda view, units: fit_panel(axis.fit, view=view, units=units)),
        _variants(distances, systems=("si",)),  # distances have no unit
    )


def spectrum_pictures(spectrum: PowerSpectrum, model: Model) -> Variants:
    """Return a spectrum's figure with the model by unit system, for pages of any view."""
    return _variants(lambda view, units: spectrum_panel(spectrum, model=model, units=units), views=("wavelet",))


def regression_pictures(regression: Regression) -> Variants:
    """Return the figure of an axis against a covariate, before and after the removal of its effect, by unit system."""
    return _variants(lambda view, units: regression_panel(regression, units=units), views=("wavelet",))


def recordings_pictures(replicates: Replicates) -> Variants:
    """Return the figure that shows each recording relative to the mean. It does not depend on view or units."""
    (panel,) = description(plot_recordings)(replicates).panels
    return {"wavelet-si": plotly_panel(replace(panel, title=""))}


def _variants(
    panel: Callable[[ViewName, UnitSystem], Panel],
    *,
    views: Sequence[ViewName] = VIEWS,
    systems: Sequence[UnitSystem] = SYSTEMS,
) -> Variants:
    """Return a figure in every view and unit system for which `panel` raises no error."""
    variants: Variants = {}
    for view in views:
        for units in systems:
            try:
                drawn = panel(view, units)
            except OptionError:  # This filter has no Allan deviation, or this signal has no datasheet unit.
                continue
            # The page has headings for the title of the figure and for the structure of the model.
            marks = tuple(map(_without_structure, drawn.marks))
            variants[f"{view}-{units}"] = plotly_panel(replace(drawn, title="", marks=marks))
    return variants


def _without_structure(mark: Mark) -> Mark:
    return replace(mark, label="Model") if isinstance(mark, Polyline) and mark.label.startswith("Model: ") else mark
