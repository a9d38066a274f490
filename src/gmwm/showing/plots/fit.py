"""Plot of a fit: the measured wavelet variance, the curve of the fitted model, and the curve of each of its terms."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from textwrap import wrap
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.showing.plots.curves import ABOVE, MIDDLE, closed_panel, observed_marks, view_for
from gmwm.showing.plots.drawing import drawing
from gmwm.showing.plots.figure import Figure, Panel, Polyline, Stroke, Text, drawable, single_panel
from gmwm.showing.plots.labels import LINES, axis_title, datasheet_label, model_text, shared_name, term_label
from gmwm.showing.plots.style import GREY, IMPLIED, OSCILLATING, term_strokes
from gmwm.showing.plots.view import UnitSystem, View, ViewName
from gmwm.theory.processes.ordered import Ordered

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gmwm.fitting.estimation.result import Fit
    from gmwm.fitting.likelihood.result import LikelihoodFit


Fitted: TypeAlias = "Fit | LikelihoodFit"
"""A result that `plot_fit` can draw."""
MOST_SINUSOIDS = 2
"""Largest number of sinusoids that are drawn as separate curves, also in `gmwm.showing.plots.spectrum`. Pinned by
tests/plots/test_plot_limits.py."""


def fit_panel(
    fit: Fitted, *, view: ViewName = "auto", units: UnitSystem = "auto", decomposition: bool = True, alone: bool = True
) -> Panel:
    """Return the panel that `plot_fit` draws. If it shares a legend with others (not `alone`), the legend names the
    terms without parameters, and a text in the panel lists the terms that are zero."""
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
        process.name_in_text(term) for term, process in zip(fit.model.terms, fit.model.processes, strict=True)
        if not np.any(fit.decomposition[term] > 0)
    ] if decomposition else []  # fmt: skip
    return replace(panel, texts=(*panel.texts, *_zero_text(zero)))


def _zero_text(zero: Sequence[str]) -> tuple[Text, ...]:
    """Return a text that lists the terms that are zero, wrapped for a narrow panel. It is at the top centre, because
    the curves of inertial sensors fall on the left and rise on the right."""
    if not zero:
        return ()
    lines = wrap(f"{', '.join(zero)}: zero", 28, break_long_words=False)
    return (Text("\n".join(lines), 0.5, 0.93 - 0.035 * (len(lines) - 1)),)


def term_lines(fit: Fitted, view: View, *, alone: bool = True) -> tuple[Polyline, ...]:
    """Return the curve of each term as a thin line, in front of the model and behind the data. If `alone`, the legend
    gives its key parameters. Otherwise all lines of the axis are one curve, and so are all oscillations. Terms that are
    zero have no curve and share one entry of the legend."""
    wv = fit.wavelet_variance
    times = view.time(wv.tau)
    processes = dict(zip(fit.model.terms, fit.model.processes, strict=True))
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
        label = f"{', '.join(processes[term].name_in_text(term) for term in zero)}: zero, not supported"
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
    from gmwm.showing.plots.shared_axes import named_fit_panel

    if label is None and color is None:
        panel = fit_panel(fit, view=view, units=units, decomposition=decomposition is not False)
    else:
        panel = named_fit_panel(
            fit, label=label, color=color, view=view, units=units, ax=ax, decomposition=decomposition is True
        )
    return single_panel(panel)
