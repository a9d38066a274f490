"""Plot of an error budget: errors of attitude, velocity and position over time, and errors of a static alignment."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gmwm.applications.navigation.result import Budget, Growth
from gmwm.applications.navigation.summary_text import RIGHT_ANGLE, largest
from gmwm.base.arrays import Vector
from gmwm.base.text import duration_text
from gmwm.showing.plots.axes import limits_near, time_axis, value_axis
from gmwm.showing.plots.curves import ABOVE, BAND, MIDDLE
from gmwm.showing.plots.drawing import drawing
from gmwm.showing.plots.figure import Band, Figure, Line, Mark, Panel, Stroke
from gmwm.showing.plots.style import BLACK, GREY, curve_stroke, term_stroke

if TYPE_CHECKING:
    pass

LEAST_SHARE = 0.03
"""A term is drawn only if its largest ratio to the total error is above this number. Pinned by
tests/plots/test_plot_budget.py."""
_REACH = 30.0
"""Largest factor by which the axis may extend below the smallest total error to show single terms."""
_TITLES = {"tilt": "Attitude error", "heading": "Attitude error", "velocity": "Velocity error",
           "position": "Position error", "height": "Position error"}  # fmt: skip


def budget_figure(budget: Budget) -> Figure:
    """Return the figure that `plot_budget` draws."""
    chosen = list(_chosen(budget).values())
    named = [label for one in chosen for label in _drawn(one)]
    # Each term has the same stroke in all panels.
    strokes = {label: term_stroke(k) for k, label in enumerate(dict.fromkeys(named))}
    panels: list[Panel] = [_growth(one, strokes, budget) for one in chosen]
    if budget.alignment:
        panels.append(_alignment(budget))
    rows = tuple(tuple(panels[k : k + 2]) for k in range(0, len(panels), 2))
    if len(panels) == 1:
        return Figure(rows, width=100.0, height=90.0)
    filled = tuple((*row, None) if len(row) == 1 else row for row in rows)
    return Figure(filled, width=174.0, height=26.0 + 62.0 * len(rows), title=_title(budget), legend_columns=3)


def _chosen(budget: Budget) -> dict[str, Growth]:
    """Return the error of the worst axis for each of attitude, velocity and position, by kind."""
    found: dict[str, Growth] = {}
    for kinds in (("tilt", "heading"), ("velocity",), ("position", "height")):
        for kind in kinds:
            if (one := largest(budget, kind)) is not None:
                found.setdefault(kinds[0], one)
    return found


def _title(budget: Budget) -> str:
    rest = f", after {duration_text(budget.rest)} at rest" if budget.rest else ""
    return f"Error budget of unaided inertial navigation (1 σ{rest})"


def _drawn(one: Growth) -> list[str]:
    with np.errstate(divide="ignore", invalid="ignore"):
        return [label for label, values in one.terms.items() if np.nanmax(values / one.error) > LEAST_SHARE]


def _growth(one: Growth, strokes: Mapping[str, Stroke], budget: Budget) -> Panel:
    parts = [
        Line(one.times, one.terms[label], stroke=replace(strokes[label], width=1.2), label=label, layer=ABOVE)
        for label in _drawn(one)
    ]
    marks: list[Mark] = [Line(one.times, one.error, stroke=Stroke(BLACK, 2.0), label="total", layer=MIDDLE)]
    if not one.certain:
        marks.append(
            Band(one.times, one.low, one.high, GREY, label=f"{100 * budget.level:g} % interval", layer=BAND)
        )  # fmt: skip
    kind = one.name.partition("_")[0]
    limits = limits_near(np.concatenate([one.error, one.low, one.high]), [part.y for part in parts], reach=_REACH)
    label = f"{_TITLES.get(kind, 'Error')} ({one.unit})"
    x = time_axis(one.times, "Time (s)")
    ticks = tuple(tick.value for tick in x.ticks)
    return Panel(replace(x, grid=ticks), value_axis(limits, label), (*marks, *parts), title=_upper(one.title))


def _alignment(budget: Budget) -> Panel:
    curves = list(budget.alignment.values())
    shown = [np.where(one.error < RIGHT_ANGLE, one.error, np.nan) for one in curves]
    lines = tuple(
        Line(one.times, y, stroke=replace(curve_stroke(k), symbol=None), label=_align_label(one.title, y), layer=MIDDLE)
        for k, (one, y) in enumerate(zip(curves, shown, strict=True))
    )
    x = time_axis(budget.times, "Averaging time (s)")
    limits = limits_near(np.concatenate(shown), [], reach=1.0)
    ticks = tuple(tick.value for tick in x.ticks)
    title = f"Static alignment, at {budget.latitude:g}° latitude"
    return Panel(replace(x, grid=ticks), value_axis(limits, "Error of the mean (deg)"), lines, title=title)


def _align_label(title: str, shown: Vector) -> str:
    return f"{title}: above {RIGHT_ANGLE:g}°" if np.all(np.isnan(shown)) else title


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]


@drawing
def plot_budget(budget: Budget, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Draw the largest attitude, velocity and position error over time with its terms, and the alignment errors."""
    return budget_figure(budget)
