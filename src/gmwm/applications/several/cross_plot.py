"""Plot of the correlations between several axes by scale, as a triangle of panels."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gmwm.showing.plots.axes import quiet, signed_axis, time_axis
from gmwm.showing.plots.curves import BAND, BEHIND, FRONT
from gmwm.showing.plots.drawing import drawing
from gmwm.showing.plots.figure import Axis, Band, Figure, Line, Panel, Stroke
from gmwm.showing.plots.style import BLUE, GREY, SOLID

if TYPE_CHECKING:
    from gmwm.applications.several.result import CrossCovariance

ZERO = Stroke(GREY, 0.8, SOLID)
"""Stroke of the line at correlation zero."""
SEEN = Stroke(BLUE, 0.7, SOLID, "circle", filled=False)
"""Stroke of all correlations, with open symbols: they may be zero."""
SURE = Stroke(BLUE, 0.0, SOLID, "circle")
"""Stroke of correlations that differ significantly from zero."""
LINEAR = 0.03
"""Correlation up to which the vertical axis is linear. The gyroscopes of one unit typically have correlations of about
0.01 (tests/plots)."""


def cross_figure(found: CrossCovariance, *, confidence: bool = True) -> Figure:
    """Return the figure that `plot_cross` draws. The panel of axes a and b is in row b and column a."""
    x = replace(time_axis(found.tau, "Scale τ (s)"), opposite=())
    shown = [*found.correlation.values(), *([*found.lower.values(), *found.upper.values()] if confidence else [])]
    y = signed_axis(np.concatenate(shown), "Correlation", linear=LINEAR, even=LINEAR)
    rows = []
    for k, b in enumerate(found.axes[1:], start=1):
        row: list[Panel | None] = [
            _panel(found, a, b, x=x if k == len(found.axes) - 1 else quiet(x), y=y if m == 0 else quiet(y),
                   confidence=confidence)
            for m, a in enumerate(found.axes[:k])
        ]  # fmt: skip
        rows.append((*row, *[None] * (len(found.axes) - 1 - k)))
    columns = len(found.axes) - 1
    return Figure(
        tuple(rows), width=max(48.0 * columns, 110.0), height=22.0 + (44.0 if columns > 1 else 66.0) * columns,
        legend_columns=4,
    )  # fmt: skip


def _panel(found: CrossCovariance, a: str, b: str, *, x: Axis, y: Axis, confidence: bool) -> Panel:
    tau, r, p = found.tau, found.correlation[a, b], found.pvalues[a, b]
    tested, sure = np.isfinite(p), p <= found.size
    marks: list[Line | Band] = [Line(np.array(x.limits), np.zeros(2), stroke=ZERO, label="", layer=BEHIND)]
    if confidence:
        level = f"{100 * found.confidence:g} % confidence"
        lower, upper = found.lower[a, b], found.upper[a, b]
        marks.append(Band(tau, lower, upper, colour=BLUE, opacity=0.22, label=level, layer=BAND))
    marks.append(Line(tau, np.where(tested, r, np.nan), stroke=SEEN, label="may be zero", layer=FRONT))
    if np.any(sure):
        name = "shared noise"
        marks.append(Line(tau[sure], r[sure], stroke=SURE, label=name, layer=FRONT))
    return Panel(x, y, tuple(marks), title=f"{a}, {b}")


@drawing
def plot_cross(
    found: CrossCovariance, *, confidence: bool = True, path: str | os.PathLike[str] | None = None
) -> Figure:
    """Draw the correlation of each pair as a function of the scale. Filled symbols mark significant correlations.

    Parameters
    ----------
    confidence : bool
        Whether to draw the confidence limits.
    """
    return cross_figure(found, confidence=confidence)
