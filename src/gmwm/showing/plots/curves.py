"""Plot of a wavelet variance, and its elements that other plots share: curve, confidence band, and axes that fit."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.base.errors import OptionError
from gmwm.showing.plots.axes import limits_near, time_axis, value_axis
from gmwm.showing.plots.drawing import drawing
from gmwm.showing.plots.figure import Band, Figure, Foot, Mark, Panel, Polyline, Stroke, Text, drawable
from gmwm.showing.plots.labels import axis_title
from gmwm.showing.plots.style import GREY, OBSERVED, ROBUST
from gmwm.showing.plots.view import UnitSystem, View, ViewName, view_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gmwm.measuring.variance.result import WaveletVariance

BEHIND, BAND, MIDDLE, ABOVE, FRONT = range(5)
"""Layers from back to front: guides, confidence bands, model, terms of the model, data. Terms are thin lines, so that
the model behind them remains visible."""


def view_for(wv: WaveletVariance, view: ViewName, units: UnitSystem) -> View:
    """Return the view of a wavelet variance by its name and unit system. The Allan deviation needs the Haar filter."""
    if view == "auto" and wv.filter != "haar":
        view = "wavelet"
    chosen = view_of(wv.unit, view, units)
    if chosen.name == "allan" and wv.filter != "haar":
        raise OptionError(
            f"the Allan deviation needs the Haar filter, but the wavelet variance has the filter {wv.filter}",
            argument="view",
            got=view,
            advice="Use {--view=wavelet}, or compute the wavelet variance with {--filter=haar}.",
        )
    return chosen


def observed_marks(
    wv: WaveletVariance, view: View, *, stroke: Stroke | None = None, label: str = "",
    used: NDArray[np.bool_] | None = None,
) -> tuple[Mark, ...]:  # fmt: skip
    """Return the marks of a measured curve: the line with symbols, open at levels that a fit has not `used`, and the
    confidence band. By default, the stroke shows whether the estimate is robust, and the label is the quantity."""
    x, y = view.time(wv.tau), drawable(view.height(wv.variance))
    stroke = stroke or (ROBUST if wv.robust else OBSERVED)
    robust = ", robust" if wv.robust else ""
    name = label or {"wavelet": "Wavelet variance", "allan": "Allan deviation"}[view.name] + robust
    fitted = np.ones(y.shape, dtype=bool) if used is None else np.asarray(used, dtype=bool)
    band = confidence_band(x, *band_edges(wv, view), colour=stroke.colour, label=limits_label(wv))
    line = Polyline(x, y, stroke=stroke if fitted.all() else replace(stroke, symbol=None), label=name, layer=FRONT)
    if fitted.all():
        return line, band
    dots, rings = replace(stroke, width=0.0), replace(stroke, width=0.0, filled=False)
    return (
        line, band, Polyline(x, np.where(fitted, y, np.nan), stroke=dots, layer=FRONT),
        Polyline(x, np.where(fitted, np.nan, y), stroke=rings, label="Left out of the fit", layer=FRONT),
    )  # fmt: skip


def confidence_band(x: Vector, lower: Vector, upper: Vector, *, colour: str, label: str) -> Band:
    """Return the band between confidence limits."""
    return Band(x, lower, upper, colour, opacity=0.22, label=label, layer=BAND)


def limits_label(wv: WaveletVariance) -> str:
    """Return the legend entry of the limits of a wavelet variance. Their degrees of freedom count independent
    coefficients and assume no type of noise, unlike those of `gmwm.allan_variance`."""
    return f"{100 * wv.confidence:g} % limits, any noise"


def curves_then_bands(marks: Iterable[Mark], curves: int) -> list[Mark]:
    """Sort marks for the legend: curves first, then bands. The bands of several curves share a grey entry."""
    ordered = sorted(marks, key=lambda mark: isinstance(mark, Band))
    return [replace(mark, swatch=GREY) if curves > 1 and isinstance(mark, Band) else mark for mark in ordered]


def band_edges(wv: WaveletVariance, view: View) -> tuple[Vector, Vector]:
    """Return the vertical positions of the lower and upper limits; NaN where the estimate itself cannot be drawn."""
    lower, upper = view.height(wv.lower), view.height(wv.upper)
    valid = np.isfinite(drawable(view.height(wv.variance))) & ~np.isnan(lower) & ~np.isnan(upper)
    return np.where(valid, lower, np.nan), np.where(valid, upper, np.nan)


def closed_panel(
    views: Sequence[View], measured: Sequence[WaveletVariance], marks: Iterable[Mark], *, around: Iterable[Vector] = (),
    strokes: Sequence[Stroke] = (OBSERVED,), names: Sequence[str] = ("",), title: str = "",
) -> Panel:  # fmt: skip
    """Return a panel whose axes fit the measured curves with their limits, each in its view, and the heights `around`
    up to a factor `View.reach` beyond. Symbols at the lower border mark variances of zero."""
    shown = list(zip(views, measured, strokes, names, strict=True))
    edges = [edge for view, wv, _, _ in shown for edge in band_edges(wv, view)]
    core = np.concatenate([view.height(wv.variance) for view, wv, _, _ in shown])
    limits = limits_near(core, [*edges, *around], reach=views[0].reach)
    feet = [_zeros(wv, view, stroke, name) for view, wv, stroke, name in shown]
    return Panel(
        time_axis(np.concatenate([view.time(wv.tau) for view, wv, _, _ in shown]), views[0].time_label),
        value_axis(limits, views[0].height_label), marks=(*marks, *(foot for foot in feet if foot is not None)),
        title=title, texts=() if np.any(core > 0) else (Text("Every variance is zero"),),
    )  # fmt: skip


def _zeros(wv: WaveletVariance, view: View, stroke: Stroke, name: str) -> Foot | None:
    zero = wv.variance == 0
    count = int(np.count_nonzero(zero))
    if not count:
        return None
    label = f"{name}: zero" if name else "Zero"
    symbol = replace(stroke, width=0.0, symbol="down", filled=False)
    return Foot(view.time(wv.tau)[zero], symbol, f"{label} at {count} of {zero.size} scales")


def wavelet_variance_panel(wv: WaveletVariance, *, view: ViewName = "auto", units: UnitSystem = "auto") -> Panel:
    """Return the panel that `plot_wavelet_variance` draws."""
    wv = wv.without_lags
    shown = view_for(wv, view, units)
    return closed_panel([shown], [wv], observed_marks(wv, shown), title=axis_title(wv.axis))


@drawing
def plot_wavelet_variance(
    wv: WaveletVariance, *, view: ViewName = "auto", units: UnitSystem = "auto", label: str | None = None,
    color: str | None = None, ax: Axes | None = None, path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw the wavelet variance over the scale, with its confidence band, on logarithmic axes.

    Levels with a variance of zero are marked at the lower edge of the plot.

    Parameters
    ----------
    label : str, optional
        Name of the curve in the legend. Use it to draw several curves on the same axes, as in
        `monday.plot(ax=ax, label="monday")`. Each curve then has its own colour and symbol.
    color : str, optional
        Matplotlib colour such as "#D55E00"; by default a colour that no earlier curve has.

    Raises
    ------
    OptionError
        If an option is unknown, if the data do not support it, or if an earlier curve on `ax` has another unit.

    Examples
    --------
    >>> from gmwm import WaveletVariance
    >>> wv = WaveletVariance.from_values([4e-6, 2e-6, 1e-6], samples=1000, rate=100.0, unit="rad/s")
    >>> figure = wv.plot(view="allan", units="datasheet")
    >>> figure.axes[0].get_ylabel()
    'Allan deviation (deg/h)'
    """
    from gmwm.showing.plots.shared_axes import named_panel

    if label is None and color is None:
        panel = wavelet_variance_panel(wv, view=view, units=units)
    else:
        panel = named_panel(wv, label=label, color=color, view=view, units=units, ax=ax)
    return Figure(((panel,),), height=88.0)
