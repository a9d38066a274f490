"""Plot of the wavelet coefficients of a signal over time, with a panel for each level."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.arrays import as_rate
from gmwm.base.errors import OptionError
from gmwm.base.text import duration_text
from gmwm.measuring.variance.transform import Dwt, Modwt
from gmwm.showing.plots.curves import FRONT
from gmwm.showing.plots.drawing import drawing
from gmwm.showing.plots.figure import PAGE, Figure, Panel, Polyline, Stroke
from gmwm.showing.plots.linear import elapsed_axis, scaled_axis
from gmwm.showing.plots.series import DOTS_OF_MM, LINE_WIDTH_PT, row_height, time_once
from gmwm.showing.plots.style import BLUE
from gmwm.showing.plots.trace import even_trace

if TYPE_CHECKING:
    pass


def coefficients_figure(
    transform: Modwt | Dwt, rate: float, *, unit: str = "", levels: Iterable[int] | None = None
) -> Figure:
    """Return the figure that `plot_coefficients` draws."""
    rate = as_rate(rate)
    shown = [j for j in transform.details if transform.interior[j].start < transform.interior[j].stop]
    chosen = shown if levels is None else sorted(set(levels))
    if not chosen or not set(chosen) <= set(shown):
        raise OptionError(argument="levels", expected=f"some of {shown[0]} to {shown[-1]}", got=levels)
    rows = [(_panel(transform, level, rate, unit),) for level in chosen]
    return Figure(time_once(rows), width=PAGE, height=12.0 + row_height(len(rows), 34.0) * len(rows))


def _panel(transform: Modwt | Dwt, level: int, rate: float, unit: str) -> Panel:
    """Return the panel of one level, with each coefficient at the middle of the samples on which it depends."""
    inside = transform.interior[level]
    step = 1 if isinstance(transform, Modwt) else 1 << level
    values = even_trace(np.asarray(transform.details[level][inside]), rate / step, 1.0, round(DOTS_OF_MM * PAGE))
    last = step * (inside.start + 1) - 1
    seconds = values.seconds + (last - (transform.filter.width(level) - 1) / 2) / rate
    duration = transform.samples / rate
    x, size = elapsed_axis(0.0, duration, duration, at_most=8)
    y, scale = scaled_axis(
        values.low, values.high, max(abs(values.low), abs(values.high)), name="Coefficient", unit=unit
    )
    stroke = Stroke(BLUE, LINE_WIDTH_PT, symbol="circle" if values.y.size < 200 else None)
    line = Polyline(seconds / size, values.y / scale, stroke=stroke, layer=FRONT)
    return Panel(x, y, (line,), f"Level {level}, scale {duration_text((1 << level) / rate)}")


@drawing
def plot_coefficients(
    transform: Modwt | Dwt, rate: float, *, unit: str = "", levels: Iterable[int] | None = None,
    path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw wavelet coefficients over time, with a panel for each level, without those affected by the boundaries.

    Parameters
    ----------
    transform : Modwt or Dwt
        Result of `gmwm.variance.modwt` or `gmwm.variance.dwt`.
    rate : float
        Sampling rate of the signal (Hz).
    unit : str
        Unit of the signal, for the labels.
    levels : sequence of int, optional
        Levels to draw. Default: all levels with coefficients that the boundaries do not affect.

    Raises
    ------
    OptionError
        If a level has no such coefficients, or the rate is not a positive number.

    Examples
    --------
    >>> from gmwm.simulation import example_recording
    >>> from gmwm.variance import modwt
    >>> signal = example_recording()["gyro_y"]
    >>> figure = plot_coefficients(modwt(signal, levels=8), signal.rate, unit=signal.unit, levels=[1, 4, 8])
    >>> len(figure.axes)
    3
    """
    return coefficients_figure(transform, rate, unit=unit, levels=levels)
