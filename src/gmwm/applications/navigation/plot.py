"""Plot of an error budget: errors of attitude, velocity and position over time, and errors of a static alignment."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gmwm.applications.navigation.result import RIGHT_ANGLE, Budget, Growth, largest, merged_terms
from gmwm.base.arrays import Vector
from gmwm.base.text import duration_text
from gmwm.showing.plots.axes import limits_near, time_axis, value_axis
from gmwm.showing.plots.curves import ABOVE, BAND, MIDDLE
from gmwm.showing.plots.figure import Band, Figure, Mark, Panel, Polyline, Stroke, Text, drawing
from gmwm.showing.plots.style import BLACK, GREY, curve_stroke, term_stroke

_TITLES = {"tilt": "Attitude error", "heading": "Attitude error", "velocity": "Velocity error",
           "position": "Position error", "height": "Position error"}  # fmt: skip


def _chosen(budget: Budget) -> dict[str, Growth]:
    """Return the error of the worst axis for each of attitude, velocity and position, by kind."""
    chosen: dict[str, Growth] = {}
    for kinds in (("tilt", "heading"), ("velocity",), ("position", "height")):
        for kind in kinds:
            if (growth := largest(budget, kind)) is not None:
                chosen.setdefault(kinds[0], growth)
    return chosen


def _drawn_terms(growth: Growth) -> dict[str, Vector]:
    """Return the terms to draw."""
    with np.errstate(divide="ignore", invalid="ignore"):
        # Terms of at least 3 % of the total error are drawn (tests/plots/test_plot_budget.py).
        parts = merged_terms(growth).items()
        return {label: values for label, values in parts if np.nanmax(values / growth.error) > 0.03}


def _growth(growth: Growth, strokes: Mapping[str, Stroke], budget: Budget) -> Panel:
    parts = [
        Polyline(growth.times, values, stroke=replace(strokes[label], width=1.2), label=label, layer=ABOVE)
        for label, values in _drawn_terms(growth).items()
    ]
    marks: list[Mark] = [Polyline(growth.times, growth.error, stroke=Stroke(BLACK, 2.0), label="total", layer=MIDDLE)]
    kind = growth.name.partition("_")[0]
    limits = limits_near(
        np.concatenate([growth.error, growth.low[growth.low > 0], growth.high]), [part.y for part in parts], reach=30.0
    )
    if not growth.certain:
        label = f"{100 * budget.level:g} % interval"
        low = np.maximum(growth.low, limits[0])
        marks.append(Band(growth.times, low, growth.high, GREY, label=label, layer=BAND))
    label = f"{_TITLES.get(kind, 'Error')} ({growth.unit})"
    x = time_axis(growth.times, "Time (s)")
    ticks = tuple(tick.value for tick in x.ticks)
    title = growth.title[:1].upper() + growth.title[1:]
    return Panel(replace(x, grid=ticks), value_axis(limits, label), (*marks, *parts), title=title)


def _alignment(budget: Budget) -> Panel:
    curves = list(budget.alignment.values())
    shown = [np.where(growth.error < RIGHT_ANGLE, growth.error, np.nan) for growth in curves]
    lines = [
        Polyline(growth.times, y, replace(curve_stroke(k), symbol=None), label=growth.title, layer=MIDDLE)
        for k, (growth, y) in enumerate(zip(curves, shown, strict=True)) if not np.all(np.isnan(y))
    ]  # fmt: skip
    notes = [f"{c.title}: above {RIGHT_ANGLE:g}°" for c, y in zip(curves, shown, strict=True) if np.all(np.isnan(y))]
    texts = (Text("\n".join(notes), 0.5, 0.95 - 0.035 * len(notes)),) if notes else ()
    x = time_axis(budget.times, "Averaging time (s)")
    limits = limits_near(np.concatenate(shown), [], reach=1.0)
    ticks = tuple(tick.value for tick in x.ticks)
    title = f"Static alignment, at {budget.latitude:g}° latitude"
    y_axis = value_axis(limits, "Error of the mean (deg)")
    return Panel(replace(x, grid=ticks), y_axis, tuple(lines), title=title, texts=texts)


@drawing
def plot_budget(budget: Budget, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Draw the largest attitude, velocity and position error over time with its terms, and the alignment errors."""
    chosen = list(_chosen(budget).values())
    # Each term has the same stroke in all panels.
    labels = dict.fromkeys(label for growth in chosen for label in _drawn_terms(growth))
    strokes = {label: term_stroke(k) for k, label in enumerate(labels)}
    panels: list[Panel] = [_growth(growth, strokes, budget) for growth in chosen]
    if budget.alignment:
        panels.append(_alignment(budget))
    rows = tuple(tuple(panels[k : k + 2]) for k in range(0, len(panels), 2))
    if len(panels) == 1:
        return Figure(rows, width=100.0, height=90.0)
    filled = tuple((*row, None) if len(row) == 1 else row for row in rows)
    alignment = f", after {duration_text(budget.rest)} at rest" if budget.rest else ""
    title = f"Error budget of unaided inertial navigation (1 σ{alignment})"
    return Figure(filled, width=174.0, height=26.0 + 62.0 * len(rows), title=title, legend_columns=3)
