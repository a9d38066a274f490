"""Plot of the wavelet deviations of the sensors of an array and of their virtual sensor, with a panel for each axis."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from gmwm.showing.plots.axes import limits_of, time_axis, value_axis
from gmwm.showing.plots.curves import BEHIND, FRONT, MIDDLE
from gmwm.showing.plots.drawing import drawing
from gmwm.showing.plots.figure import Figure, Line, Panel, Stroke
from gmwm.showing.plots.labels import axis_title
from gmwm.showing.plots.style import BLUE, DASHED, ORANGE, PALE, SOLID

if TYPE_CHECKING:
    from gmwm.applications.several.fusion_result import VirtualAxis, VirtualSensor

EACH = Stroke(PALE, 0.8, SOLID)
"""Stroke of the curve of each sensor of the array."""
AVERAGE = Stroke(ORANGE, 1.2, DASHED)
"""Stroke of the curve of the average of all sensors."""
VIRTUAL = Stroke(BLUE, 1.4, SOLID)
"""Stroke of the curve of the virtual sensor."""
HERE = Stroke(BLUE, 0.0, SOLID, "circle", filled=False)
"""Stroke of the deviation that the virtual sensor has in the recording from which its weights were computed."""
MOST_COLUMNS = 3


def fusion_figure(virtual: VirtualSensor) -> Figure:
    """Return the figure that `plot_fusion` draws."""
    panels = [_panel(one) for one in virtual.axes.values()]
    columns = min(len(panels), MOST_COLUMNS)
    rows: list[tuple[Panel | None, ...]] = [tuple(panels[k : k + columns]) for k in range(0, len(panels), columns)]
    rows[-1] = (*rows[-1], *[None] * (columns - len(rows[-1])))
    return Figure(
        tuple(rows), width=110.0 if columns == 1 else 78.0 * columns, height=14.0 + 70.0 * len(rows), legend_columns=2
    )


def _panel(one: VirtualAxis) -> Panel:
    tau = one.tau
    marks = [
        Line(tau, np.sqrt(variance), stroke=EACH, label="each sensor" if k == 0 else "", layer=BEHIND)
        for k, variance in enumerate(one.each)
    ]
    marks.append(Line(tau, np.sqrt(one.average), stroke=AVERAGE, label="average", layer=MIDDLE))
    marks.append(Line(tau, one.deviation, stroke=VIRTUAL, label="virtual sensor, predicted", layer=FRONT))
    marks.append(Line(tau, np.sqrt(one.measured), stroke=HERE, label="in this recording", layer=FRONT))
    heights = np.sqrt(np.concatenate([one.each.ravel(), one.average, one.variance, one.measured]))
    label = f"Wavelet deviation ({one.unit})" if one.unit else "Wavelet deviation"
    return Panel(
        time_axis(tau, "Scale τ (s)"), value_axis(limits_of(heights), label), tuple(marks), title=axis_title(one.axis)
    )


@drawing
def plot_fusion(virtual: VirtualSensor, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Draw the wavelet deviations of each signal, of their average and of the virtual sensor as functions of the
    scale.
    """
    return fusion_figure(virtual)
