"""Plot of claimed and real errors of filters against the horizon, with a panel for each axis."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from gmwm.showing.exporters.quality import TRUE
from gmwm.showing.plots.axes import limits_of, time_axis, value_axis
from gmwm.showing.plots.drawing import drawing
from gmwm.showing.plots.figure import Band, Figure, Mark, Panel, Polyline, Text
from gmwm.showing.plots.imu import grid_figure
from gmwm.showing.plots.style import BLUE, GREY, IMPLIED, OBSERVED
from gmwm.showing.plots.view import UnitSystem, view_of

if TYPE_CHECKING:
    from gmwm.applications.monitor.consistency_result import AxisConsistency, Consistency


def consistency_figure(result: Consistency, units: UnitSystem = "auto") -> Figure:
    """Return the figure of `Consistency.plot`."""
    return grid_figure({axis: _panel(each, result.level, units) for axis, each in result.items()})


def _panel(axis: AxisConsistency, level: float, units: UnitSystem) -> Panel:
    view = view_of(axis.unit, "allan", units)
    times, claimed, real, low, high = np.array(
        [[error.horizon, error.claimed, error.real, error.low, error.high] for error in axis.curve]
    ).T
    claimed, real = view.factor * claimed, view.factor * real
    least, most = TRUE
    marks: list[Mark] = [
        Band(times, claimed / most, claimed / least, GREY, label=f"Claim of {least:g} to {most:g} times the error"),
        Band(times, claimed / high, claimed / low, BLUE, label=f"{100 * level:g} % interval of the error", layer=1),
        Polyline(times, claimed, IMPLIED, label="Claimed error", layer=2),
        Polyline(times, real, OBSERVED, label="Real error", layer=3),
    ]
    y = value_axis(limits_of(np.concatenate([claimed, real])), f"Error of the mean ({view.unit or 'unit of the data'})")
    return Panel(time_axis(times, "Horizon (s)"), y, tuple(marks), texts=(Text(axis.verdict, 0.5, 0.94),))


@drawing
def plot_consistency(
    result: Consistency, *, units: UnitSystem = "auto", path: str | os.PathLike[str] | None = None
) -> Figure:
    """Draw the claimed and the real error of the mean over the next T seconds against T, a panel for each axis."""
    return consistency_figure(result, units)
