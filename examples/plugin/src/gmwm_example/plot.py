"""A plot: the standard deviation of each axis."""

import numpy as np

from gmwm.showing.plots.axes import even_axis
from gmwm.showing.plots.figure import Figure, Panel, Polyline, Stroke, drawing
from gmwm.showing.plots.style import BLUE
from gmwm_example.command import Spread


def spread_panel(spread: Spread) -> Panel:
    """Return the plot of a `Spread` as data."""
    deviations = np.array([deviation for _, deviation in spread.axes.values()])
    numbers = np.arange(1.0, deviations.size + 1.0)
    return Panel(
        even_axis(0.0, deviations.size + 1.0, "Axis number", margin=0.0),
        even_axis(0.0, float(deviations.max()), "Standard deviation (SI units)", margin=0.1),
        (Polyline(numbers, deviations, Stroke(BLUE, 1.2), "Standard deviation"),),
    )


@drawing
def plot_spread(spread: Spread, *, path=None) -> Figure:
    """Draw the standard deviation of each axis."""
    return Figure(((spread_panel(spread),),), width=110.0, height=75.0)
