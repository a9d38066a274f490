"""Plot of a fit: the measured wavelet variance, and the curves of the fitted model and of each of its terms."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from textwrap import wrap
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.errors import OptionError
from gmwm.showing.plots.axes import time_axis, value_axis
from gmwm.showing.plots.curves import (
    ABOVE,
    MIDDLE,
    Item,
    closed_panel,
    curves_then_bands,
    observed_marks,
    overlay_panel,
    view_for,
    wavelet_variance_of,
)
from gmwm.showing.plots.figure import Figure, Panel, Polyline, Stroke, Text, drawable, drawing, single_panel
from gmwm.showing.plots.labels import (
    LINES,
    UnitSystem,
    View,
    ViewName,
    axis_title,
    datasheet_label,
    model_text,
    shared_name,
    term_label,
)
from gmwm.showing.plots.style import GREY, IMPLIED, OSCILLATING, curve_stroke, term_strokes
from gmwm.theory.processes.ordered import Ordered
from gmwm.theory.processes.oscillator import name_in_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gmwm.fitting.estimation.result import Fit
    from gmwm.fitting.likelihood.result import LikelihoodFit


Fitted: TypeAlias = "Fit | LikelihoodFit"  # a result that `plot_fit` can draw
MOST_SINUSOIDS = 2
"""Most sinusoids drawn as separate curves, also in `plots.spectrum` (tests/plots/test_plot_limits.py)."""


def fit_panel(
    fit: Fitted, *, view: ViewName = "auto", units: UnitSystem = "auto", decomposition: bool = True, alone: bool = True
) -> Panel:
    """Return `plot_fit`'s panel; if not `alone`, the legend has no parameters, and a text lists the zero terms."""
    fit = getattr(fit, "without_lags", fit)
    wv = fit.wavelet_variance
    shown = view_for(wv, view, units)
    implied = drawable(shown.height(np.asarray(fit.implied)))
    name = f"Model: {model_text(fit.decomposition)}" if alone else "Model"
    model = Polyline(shown.time(wv.tau), implied, stroke=IMPLIED, label=name, layer=MIDDLE)
    terms = term_lines(fit, shown, alone=alone) if decomposition else ()
    marks = [*observed_marks(wv, shown, used=getattr(fit, "used", None)), model, *terms]
    panel = closed_panel([shown], [wv], marks, around=[implied, *map(_summit, terms)], title=axis_title(wv.axis))
    if alone:
        return _with_hidden_terms(panel, terms)
    zero = [
        name_in_text(term, process) for term, process in fit.model.by_term.items()
        if not np.any(fit.decomposition[term] > 0)
    ] if decomposition else []  # fmt: skip
    return replace(panel, texts=(*panel.texts, *_zero_text(zero)))


def _zero_text(zero: Sequence[str]) -> tuple[Text, ...]:
    """Return a narrow list of zero terms for the top centre, between the falling and rising ends of inertial curves."""
    if not zero:
        return ()
    lines = wrap(f"{', '.join(zero)}: zero", 28, break_long_words=False)
    return (Text("\n".join(lines), 0.5, 0.93 - 0.035 * (len(lines) - 1)),)


def term_lines(fit: Fitted, view: View, *, alone: bool = True) -> tuple[Polyline, ...]:
    """Return thin curves of terms between model and data. If `alone`, the legend has key parameters; else all lines
    share a curve, and all oscillations. Zero terms share an entry."""
    wv = fit.wavelet_variance
    times = view.time(wv.tau)
    processes = fit.model.by_term
    strokes = term_strokes(fit.model.terms, fit.model.processes)
    curves = {term: np.asarray(variance) for term, variance in fit.decomposition.items()}
    zero = [term for term, curve in curves.items() if not np.any(curve > 0)]
    names = {term: shared_name(processes[term], wv.rate) for term in curves if term not in zero}
    many = list(names.values()).count(LINES) > MOST_SINUSOIDS
    members: dict[str, list[str]] = {}
    for term, name in names.items():
        shared = name if not alone or (many and name == LINES) else ""
        members.setdefault(shared or term, []).append(term)
    lines = []
    for label, terms in members.items():
        process = processes[terms[0]]
        y = drawable(view.height(np.sum([curves[term] for term in terms], axis=0)))
        stroke = strokes[terms[0]]
        if not alone:
            # The sum has the same stroke on all axes, whatever else their models contain.
            stroke = OSCILLATING if label not in (LINES, terms[0]) else stroke
            label = "Sensor filter" if isinstance(process, Ordered) else label
        elif label == LINES:
            label = f"{len(terms)} lines"
        else:
            # A plot in datasheet units has datasheet values, any other plot has parameters.
            values = datasheet_label(label, process, wv.unit, wv.rate) if view.of_datasheets else ""
            label = values or term_label(label, process, view, wv.rate)
            acting = fit.diagnostics.acts_as.get(terms[0])
            label += f" (like {acting})" if acting else ""
        lines.append(Polyline(times, y, stroke=stroke, label=label, layer=ABOVE))
    if alone and zero:
        nothing = np.full(times.shape, np.nan)
        label = f"{', '.join(name_in_text(term, processes[term]) for term in zero)}: zero, not supported"
        lines.append(Polyline(times, nothing, stroke=Stroke(GREY, 0.0), label=label, layer=ABOVE))
    return tuple(lines)


def _summit(line: Polyline) -> Vector:
    """Return half of the highest value of a term, as an array. An axis that includes it shows the top of the curve."""
    return np.array([0.5 * np.nanmax(line.y)]) if np.any(np.isfinite(line.y)) else np.empty(0)


def _with_hidden_terms(panel: Panel, terms: tuple[Polyline, ...]) -> Panel:
    """Return the panel with a note in the legend entry of each term whose curve is completely below the axes."""
    low = panel.y.limits[0]
    hidden = {id(line) for line in terms if np.any(line.y > 0) and not np.any(line.y >= low)}
    marks = tuple(
        replace(mark, label=f"{mark.label} (below the axes)") if id(mark) in hidden else mark for mark in panel.marks
    )
    return replace(panel, marks=marks)


@drawing
def plot_fit(
    fit: Fitted, *, view: ViewName = "auto", units: UnitSystem = "auto", decomposition: bool | None = None,
    label: str | None = None, color: str | None = None, ax: Axes | None = None,
    path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw the data with their confidence band, the curve that the model implies, and the curve of each term.

    Parameters
    ----------
    decomposition : bool, optional
        Whether to draw the curves of the terms. By default they are drawn unless `label` or `color` is given.
    label : str, optional
        Name of the fit in the legend. Use it to draw several fits on the same axes, as in
        `monday.plot(ax=ax, label="monday")`. Each fit then has its own colour and symbol.
    color : str, optional
        Matplotlib colour such as "#D55E00"; by default a colour that no earlier fit has.

    Raises
    ------
    OptionError
        If an option is unknown, if the data do not support it, or if an earlier fit on `ax` has another unit.
    ModelError
        If a maximum-likelihood fit was read from a file, which does not hold the recording.
    """

    if label is None and color is None:
        panel = fit_panel(fit, view=view, units=units, decomposition=decomposition is not False)
    else:
        panel = named_fit_panel(
            fit, label=label, color=color, view=view, units=units, ax=ax, decomposition=decomposition is True
        )
    return single_panel(panel)


def named_panel(
    item: Item, *, label: str | None = None, color: str | None = None, view: ViewName = "auto",
    units: UnitSystem = "auto", ax: Axes | None = None,
) -> Panel:  # fmt: skip
    """Return a panel with one named curve. Its axes include the curves that gmwm has already drawn on `ax`, and its
    default colour is the next free one. Raises an OptionError if the earlier curves have another quantity or unit."""
    from matplotlib.axes import Axes
    from matplotlib.collections import PolyCollection

    drawn = ax if isinstance(ax, Axes) else None
    # Each earlier curve has one confidence band, so the number of bands is the number of curves.
    before = 0 if drawn is None else sum(isinstance(artist, PolyCollection) for artist in drawn.collections)
    stroke = curve_stroke(before)
    if color is not None:
        stroke = replace(stroke, colour=_hex(color))
    name = wavelet_variance_of(item).axis or "Data" if label is None else label
    panel = overlay_panel({name: item}, view=view, units=units, strokes=[stroke])
    # The bands of all curves share one legend entry.
    panel = replace(panel, marks=tuple(curves_then_bands(panel.marks, 2)))
    return panel if drawn is None or not before else _join(panel, drawn)


def named_fit_panel(
    fit: Fitted, *, label: str | None, color: str | None, view: ViewName, units: UnitSystem, ax: Axes | None,
    decomposition: bool,
) -> Panel:  # fmt: skip
    """Return the panel of `named_panel` for a fit, with a thin line for each term in its colour if `decomposition`."""
    panel = named_panel(fit, label=label, color=color, view=view, units=units, ax=ax)
    if not decomposition:
        return panel
    name = panel.marks[0].label
    shown = view_for(fit.wavelet_variance, view, units)
    colour = next(mark.stroke.colour for mark in panel.marks if isinstance(mark, Polyline))
    terms = (
        replace(line, stroke=replace(line.stroke, colour=colour), label=f"{name}, {line.label}")
        for line in term_lines(fit, shown, alone=False)
    )
    return replace(panel, marks=(*panel.marks, *terms))


def _hex(color: str) -> str:
    from matplotlib.colors import to_hex

    try:
        return to_hex(color)
    except (ValueError, TypeError) as error:
        raise OptionError(argument="color", expected='a colour such as "#0072B2" or "red"', got=color) from error


def _join(panel: Panel, ax: Axes) -> Panel:
    """Return the panel with axes that also include the curves on `ax`, which must show the same quantity and unit."""
    if ax.get_ylabel() != panel.y.label:
        raise OptionError(
            f"curves on the same axes need the same quantity and unit, but they are {ax.get_ylabel()!r} and "
            f"{panel.y.label!r}",
            argument="ax",
            got=ax,
            advice="Plot them on axes of their own.",
        )
    # Minor ticks are lines too. They are excluded because their positions are not in the units of the data.
    curves = [line for line in ax.lines if all(line.get_transform().contains_branch_seperately(ax.transData))]
    times = [np.asarray(line.get_xdata(), dtype=float) for line in curves] + [line.x for line in panel.lines]
    (low, high), (bottom, top) = ax.get_ylim(), panel.y.limits
    return replace(
        panel,
        x=time_axis(np.unique(np.concatenate(times)), panel.x.label),
        y=value_axis((min(low, bottom), max(high, top)), panel.y.label),
    )
