"""A fitted model over the data: the implied curve, and each term by itself."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from textwrap import wrap
from typing import TYPE_CHECKING, Protocol

import numpy as np

from gmwm._arrays import Vector
from gmwm.plots.curves import ABOVE, MIDDLE, closed_panel, observed_marks, view_for
from gmwm.plots.figure import Line, Panel, Stroke, Text, drawable, single_panel
from gmwm.plots.labels import axis_title, datasheet_label, model_text, term_label
from gmwm.plots.style import GREY, IMPLIED, term_strokes
from gmwm.plots.view import UnitSystem, View, ViewName

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as MatplotlibFigure

    from gmwm.processes.base import Process
    from gmwm.processes.model import Model
    from gmwm.variance.result import WaveletVariance


class HasNotes(Protocol):
    """What is to be known of a fit."""

    @property
    def acts_as(self) -> Mapping[str, str]:
        """Terms that act as another process."""


class Fitted(Protocol):
    """What can be drawn: a fit to a wavelet variance, or one by maximum likelihood."""

    @property
    def model(self) -> Model:
        """With its estimates."""

    @property
    def wavelet_variance(self) -> WaveletVariance:
        """The data."""

    @property
    def implied(self) -> Vector:
        """The model's curve (J,)."""

    @property
    def decomposition(self) -> Mapping[str, Vector]:
        """That of each term."""

    @property
    def diagnostics(self) -> HasNotes:
        """What is to be known of it."""


REMARK = (0.5, 0.93)
"""Where a panel says what is not seen in it: curves of inertial sensors fall from the left and rise to the right."""
LINE = 28
"""Characters in a line of such a remark."""


def fit_panel(
    fit: Fitted,
    *,
    view: ViewName = "wavelet",
    units: UnitSystem = "si",
    decomposition: bool = True,
    alone: bool = True,
) -> Panel:
    """What `plot_fit` draws, as data.

    Where it is not alone, the legend names the terms without their parameters, as several panels with one
    legend need it, and a term that is zero is told in the panel.
    """
    wv = fit.wavelet_variance
    shown = view_for(wv, view, units)
    implied = drawable(shown.height(np.asarray(fit.implied)))
    name = f"Model: {model_text(fit.decomposition)}" if alone else "Model"
    model = Line(shown.time(wv.tau), implied, stroke=IMPLIED, label=name, layer=MIDDLE)
    terms = term_lines(fit, shown, alone=alone) if decomposition else ()
    marks = [*observed_marks(wv, shown, used=getattr(fit, "used", None)), model, *terms]
    panel = closed_panel([shown], [wv], marks, around=[implied, *map(_summit, terms)], title=axis_title(wv.axis))
    if alone:
        return _say_what_is_not_seen(panel, terms)
    zero = [term for term, variance in fit.decomposition.items() if not np.any(variance > 0)] if decomposition else []
    return replace(panel, texts=(*panel.texts, *_zero_text(zero)))


def _zero_text(zero: Sequence[str]) -> tuple[Text, ...]:
    """The terms that are zero as a remark in a panel that may be narrow."""
    if not zero:
        return ()
    lines = wrap(f"{', '.join(zero)}: zero", LINE, break_long_words=False)
    return (Text("\n".join(lines), REMARK[0], REMARK[1] - 0.035 * (len(lines) - 1)),)


def term_lines(fit: Fitted, view: View, *, alone: bool = True) -> tuple[Line, ...]:
    """The wavelet variance of every term, thin, over the model and behind the data.

    Where the plot is alone, they are named with their key parameters or the numbers of a datasheet, and those that were
    estimated as zero, which have no curve, together in one entry.
    """
    times = view.time(fit.wavelet_variance.tau)
    processes = dict(zip(fit.model.terms, fit.model.processes, strict=True))
    strokes = term_strokes(fit.model.terms, fit.model.processes)
    lines, zero = [], []
    for term, variance in fit.decomposition.items():
        y = drawable(view.height(np.asarray(variance)))
        if not np.any(np.isfinite(y)):
            zero.append(term)
            continue
        label = term
        if alone:
            label = _told(term, processes[term], view, fit.wavelet_variance)
            acting = fit.diagnostics.acts_as.get(term)
            label += f" (acts as {acting})" if acting else ""
        lines.append(Line(times, y, stroke=strokes[term], label=label, layer=ABOVE))
    if alone and zero:
        nothing = np.full(times.shape, np.nan)
        lines.append(
            Line(times, nothing, stroke=Stroke(GREY, 0.0), label=f"{', '.join(zero)}: zero, not supported", layer=ABOVE)
        )
    return tuple(lines)


def _told(term: str, process: Process, view: View, wv: WaveletVariance) -> str:
    """A term with what the units shown tell of it: numbers of a datasheet, or its key parameters."""
    found = datasheet_label(term, process, wv.unit, wv.rate) if view.of_datasheets else ""
    return found or term_label(term, process, view, wv.rate)


def _summit(line: Line) -> Vector:
    """A little under the highest point of a term: enough of it to be seen."""
    return np.array([0.5 * np.nanmax(line.y)]) if np.any(np.isfinite(line.y)) else np.empty(0)


def _say_what_is_not_seen(panel: Panel, terms: tuple[Line, ...]) -> Panel:
    """Terms that lie under the lower border everywhere say so in the legend."""
    low = panel.y.limits[0]
    hidden = {id(line) for line in terms if np.any(line.y > 0) and not np.any(line.y >= low)}
    marks = tuple(
        replace(mark, label=f"{mark.label} (below the axes)") if id(mark) in hidden else mark for mark in panel.marks
    )
    return replace(panel, marks=marks)


def plot_fit(
    fit: Fitted,
    *,
    view: ViewName = "wavelet",
    units: UnitSystem = "si",
    decomposition: bool = True,
    ax: Axes | None = None,
    path: str | os.PathLike[str] | None = None,
) -> MatplotlibFigure:
    """Draw a fit: see `Fit.plot`."""
    from gmwm.plots.matplotlib import draw

    panel = fit_panel(fit, view=view, units=units, decomposition=decomposition)
    return draw(single_panel(panel), ax=ax, path=path)
