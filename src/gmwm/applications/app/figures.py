"""Figures of the page: panels of `gmwm.plots` as Plotly figures with a size and a legend."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gmwm.applications.app.session import Session
from gmwm.base.time_base import begins_of
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.spectrum import PowerSpectrum
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.signals import Imu
from gmwm.showing.plots.axes import time_unit, value_axis
from gmwm.showing.plots.curves import overlay_panel, view_for
from gmwm.showing.plots.figure import Mark, Panel, Stroke, description
from gmwm.showing.plots.fit import fit_panel
from gmwm.showing.plots.labels import UnitSystem, View, ViewName, sensor_and_letter
from gmwm.showing.plots.ranking import FIRST, distance_panel
from gmwm.showing.plots.series import plot_recording
from gmwm.showing.plots.spectrum import spectrum_panel
from gmwm.showing.plots.style import curve_stroke, letter_stroke, term_strokes
from gmwm.showing.reports.figures import plotly_panel
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.parameter import Fixed

FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Liberation Sans", sans-serif'
SIDE_MARGINS_PX = 90  # total width (CSS pixels) of the left and right margins of a figure
NARROW, WIDEST = 760, 1360
"""Page width (CSS pixels) below which figures are in one column, and largest width of the page, as in app.css."""
LEFT_OUT = "#d55e00"
"""Colour of time ranges that are left out."""
HANDLE_PX = 8  # half of the width (CSS pixels) of a handle, with which users drag the curve of a term
RATE = "beta"  # name of the parameter that is the inverse correlation time of a process
Drawn = dict[str, Any]  # a Plotly figure as a dictionary, which `dcc.Graph` can draw


def half_of(width: float) -> float:
    """Return the width (CSS pixels) of a figure in a grid, which has two columns, or one on a narrow page."""
    return width - 40 if width < NARROW else min(width, WIDEST) / 2 - 30


def plotly_figure(panel: Panel, width: float, height: float = 330, *, title: bool = False) -> Drawn:
    """Return a panel as a Plotly figure."""
    figure = plotly_panel(panel if title else replace(panel, title=""))
    names = [trace["name"] for trace in figure["data"] if trace["showlegend"]]
    longest = max(map(len, names), default=0)
    entry = min(width - 10, 44 + 6.4 * longest)  # the legend is as wide as the figure
    rows = math.ceil(len(names) / max(1, (width - SIDE_MARGINS_PX + 10) // entry)) if names else 0
    foot = 50 + 20 * rows
    layout = figure["layout"]
    if title and "title" in layout:
        layout["title"] |= {"x": 0.01, "xanchor": "left", "font": {"size": 13}, "y": 0.98, "yanchor": "top"}
    layout |= {
        "height": height + (foot if names else 20), "autosize": True,
        "margin": {"l": 72, "r": 14, "t": 26, "b": foot if names else 44, "pad": 0},
        "font": {"family": FONT, "size": 12, "color": "#1b1f24"},
        "paper_bgcolor": "rgba(0,0,0,0)", "plot_bgcolor": "rgba(0,0,0,0)",  # that of the page
        "hovermode": "closest", "dragmode": False,
        "hoverlabel": {"align": "left", "bgcolor": "#ffffff", "font": {"size": 13}},
        "legend": {
            "orientation": "h", "x": 0, "xref": "container", "y": 0, "yref": "container", "yanchor": "bottom",
            "entrywidth": entry - 44, "traceorder": "normal", "font": {"size": 11.5},
        },
    }  # fmt: skip
    return {"data": figure["data"], "layout": layout}


def traces(imu: Imu, width: float, units: UnitSystem) -> tuple[dict[str, Drawn], float]:
    """Return a figure of each axis over time, in which users can mark a time range, and the unit of time (s)."""
    figure = description(plot_recording)(imu, units=units)
    places = {sensor_and_letter(axis): axis for axis in imu}
    if all(sensor for sensor, _ in places):
        sensors = list(dict.fromkeys(sensor for sensor, _ in places))
        letters = sorted({letter for _, letter in places})
        panels = {
            places[sensor, letter]: panel
            for letter, row in zip(letters, figure.rows, strict=True)
            for sensor, panel in zip(sensors, row, strict=True)
            if panel is not None
        }
    else:
        panels = dict(zip(imu, figure.panels, strict=True))
    below = next(panel.x for panel in reversed(figure.panels) if panel.x.label)
    figures = {axis: _trace(replace(panels[axis], x=below), width) for axis in imu}
    return figures, time_unit(_duration(imu))[1]


def _trace(panel: Panel, width: float) -> Drawn:
    figure = plotly_figure(panel, width, 190, title=True)
    figure["layout"] |= {
        "dragmode": "select", "selectdirection": "h",
        "newselection": {"line": {"color": "#0072b2", "width": 2, "dash": "solid"}},
    }  # fmt: skip
    return figure


def _duration(imu: Imu) -> float:
    """Return the time (s) from the first to the last sample of a recording, including gaps."""
    signal = imu[imu.axes[0]]
    begins = begins_of(signal.rate, signal.segments, signal.starts)
    return max(begin + (b - a - 1) / signal.rate for begin, (a, b) in zip(begins, signal.segments, strict=True))


def with_spans(found: Drawn, spans: Sequence[tuple[float, float]], unit: float) -> Drawn:
    """Return the figure with the time ranges (s) shaded that are left out. `unit` is the unit of its time axis (s)."""
    found["layout"]["shapes"] = [
        {"type": "rect", "xref": "x", "yref": "y domain", "x0": begin / unit, "x1": end / unit, "y0": 0, "y1": 1,
         "fillcolor": LEFT_OUT, "opacity": 0.3, "line": {"width": 0}, "layer": "above"}
        for begin, end in spans
    ]  # fmt: skip
    return found


def curves(of: Mapping[str, Mapping[str, WaveletVariance]], view: ViewName, units: UnitSystem) -> Panel:
    """Return a panel with the wavelet variances of a sensor's axes, by estimate. An estimate's key is added to the axis
    in the legend: "" for filled symbols, and for example ", robust"."""
    items: dict[str, WaveletVariance] = {}
    strokes: list[Stroke] = []
    for name, axes in of.items():
        for k, (axis, wv) in enumerate(axes.items()):
            letter = sensor_and_letter(axis)[1]
            stroke = letter_stroke(letter) or curve_stroke(k)
            items[f"{letter.upper() or axis}{name}"] = wv
            strokes.append(replace(stroke, dash=stroke.dash if not name else (1.0, 2.0), filled=not name))
    return overlay_panel(items, view=view, units=units, strokes=strokes)


def spectra(axes: Mapping[str, PowerSpectrum], units: UnitSystem) -> Panel:
    """Return a panel with the spectra of the axes of one sensor, with symbols at their lines and broad peaks."""
    marks: list[Mark] = []
    panels = [spectrum_panel(spectrum, units=units, alone=False) for spectrum in axes.values()]
    for k, (axis, panel) in enumerate(zip(axes, panels, strict=True)):
        letter = sensor_and_letter(axis)[1]
        colour = (letter_stroke(letter) or curve_stroke(k)).colour
        for mark in panel.lines:
            symbol = mark.stroke.symbol is not None
            label = mark.label if symbol else letter.upper() or axis
            marks.append(replace(mark, label=label, stroke=mark.stroke if symbol else Stroke(colour, 0.9)))
    low, high = min(panel.y.limits[0] for panel in panels), max(panel.y.limits[1] for panel in panels)
    return replace(panels[0], y=value_axis((low, high), panels[0].y.label), marks=tuple(marks), title="")


def fit_figure(fit: Fit, session: Session, width: float) -> Drawn:
    """Return the figure of a fit. The curve of each term has a handle with which users can drag it."""
    figure = plotly_figure(fit_panel(fit, view=session.view, units=session.units), width, 380)
    shown = view_for(fit.wavelet_variance, session.view, session.units)
    figure["layout"]["shapes"] = [
        {"type": "circle", "xref": "x", "yref": "y", "xsizemode": "pixel", "ysizemode": "pixel", "xanchor": x,
         "yanchor": y, "x0": -HANDLE_PX, "x1": HANDLE_PX, "y0": -HANDLE_PX, "y1": HANDLE_PX, "editable": True,
         "line": {"color": "#1b1f24", "width": 1.5}, "fillcolor": stroke.colour, "label": {"text": ""}}
        for (x, y), stroke in _handles(fit, shown)
    ]  # fmt: skip
    return figure


def _handles(fit: Fit, shown: View) -> list[tuple[tuple[float, float], Stroke]]:
    """Return the position of the handle of each term that is not zero, and the stroke of the term."""
    strokes = term_strokes(fit.model.terms, fit.model.processes)
    return [(_place(fit, term, shown), strokes[term]) for term in movable(fit)]


def movable(fit: Fit) -> list[str]:
    """Return the terms that have a handle, which are all terms that are not zero."""
    return [term for term, curve in fit.decomposition.items() if np.any(np.asarray(curve) > 0)]


def _place(fit: Fit, term: str, shown: View) -> tuple[float, float]:
    """Return the position of the handle of a term: the point of its curve where its share of the model is largest."""
    curve = np.asarray(fit.decomposition[term])
    level = int(np.argmax(curve / np.where(fit.implied > 0, fit.implied, np.inf)))
    time = shown.time(fit.wavelet_variance.tau)[level]
    return float(time), float(shown.height(curve)[level])


def axis_at(fit: Fit, term: str, to: tuple[float, float], session: Session) -> Process:
    """Return the process of a term after its handle was dragged, with its values held fixed. Its curve goes through
    `to` (time, value); a correlation time changes in proportion to the horizontal position."""
    wv = fit.wavelet_variance
    process = fit.model.by_term[term]
    shown = view_for(wv, session.view, session.units)
    (old, _), (time, height) = _place(fit, term, shown), to
    values = {}
    if RATE in [parameter.name for parameter in process.nonlinear_parameters()]:
        values[RATE] = Fixed(process.value(RATE) * old / time)
        process = process.with_values(**{RATE: values[RATE].value})
    curve = process.wavelet_variance(wv.levels, wv.rate, wv.filter)
    log = np.interp(math.log(time), np.log(shown.time(wv.tau)), np.log(np.maximum(shown.height(curve), 1e-300)))
    ratio = (height / math.exp(float(log))) ** (2.0 if shown.name == "allan" else 1.0)
    scale = process.scale_parameter().name
    return process.with_values(**values, **{scale: Fixed(process.value_from(process.scale * ratio))})


def residual_figure(fit: Fit, session: Session, width: float) -> Drawn:
    """Return the figure with the distance of a model from the data at each scale."""
    models = [("Model", np.asarray(fit.implied), FIRST)]
    return plotly_figure(distance_panel(fit.wavelet_variance, models, session.view, session.units), width, 210)
