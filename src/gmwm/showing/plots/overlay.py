"""Panels with several curves, for example the three axes of a sensor."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, cast

import numpy as np

from gmwm.base.errors import OptionError
from gmwm.showing.plots.curves import MIDDLE, closed_panel, curves_then_bands, observed_marks, view_for
from gmwm.showing.plots.figure import Band, Line, Mark, Panel, Stroke, drawable, single_panel
from gmwm.showing.plots.style import curve_stroke
from gmwm.showing.plots.view import UnitSystem, View, ViewName

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as MatplotlibFigure

    from gmwm.base.arrays import Vector
    from gmwm.fitting.estimation.conditions_fit import ConditionsFit
    from gmwm.fitting.estimation.result import Fit
    from gmwm.measuring.variance.result import WaveletVariance


class AtCondition(NamedTuple):
    """Measured wavelet variance at one condition, and the wavelet variance that the model implies there."""

    wavelet_variance: WaveletVariance
    implied: Vector


Item: TypeAlias = "WaveletVariance | Fit | AtCondition"
"""Something to draw as a curve: a wavelet variance, or a fit, which contains a wavelet variance."""


def measured(item: Item) -> WaveletVariance:
    """Return the wavelet variance of an item.

    Raises
    ------
    OptionError
        If the item is neither a WaveletVariance nor a Fit.
    """
    wv: Any = getattr(item, "wavelet_variance", item)
    if not hasattr(wv, "variance") or not hasattr(wv, "tau"):
        raise OptionError(argument="items", expected="of type WaveletVariance or Fit", got=item)
    return cast("WaveletVariance", wv)


def checked_items(items: Mapping[str, Any]) -> dict[str, Item]:
    """Check a mapping from names to wavelet variances and fits, and return it as a dict.

    Raises
    ------
    OptionError
        If `items` is not a mapping, if it is empty, or if a value is neither a WaveletVariance nor a Fit.
    """
    if not isinstance(items, Mapping) or not items:
        raise OptionError(
            argument="items",
            expected="a mapping of names to WaveletVariance or Fit such as {'gyro_x': wv_x, 'gyro_y': wv_y}",
            got=items,
        )
    for item in items.values():
        measured(item)
    return dict(items)


def overlay_panel(
    items: Mapping[str, Item],
    *,
    view: ViewName = "wavelet",
    units: UnitSystem = "si",
    strokes: Sequence[Stroke] | None = None,
    title: str = "",
) -> Panel:
    """Return a panel with several curves and their confidence bands.

    A fit is drawn with symbols for the data and a line for the model.

    Raises
    ------
    OptionError
        If the curves differ in unit.
    """
    results = [measured(item) for item in items.values()]
    views = [view_for(wv, view, units) for wv in results]
    if len({shown.unit for shown in views}) > 1:
        pairs = zip(items, views, strict=True)
        found = ", ".join(f"{name} in {shown.unit or 'no unit'}" for name, shown in pairs)
        raise OptionError(
            f"curves in one panel need the same unit, but they are {found}",
            argument="items",
            got=tuple(shown.unit for shown in views),
            advice="Plot each sensor in its own figure.",
        )
    strokes = strokes or [curve_stroke(k) for k in range(len(results))]
    marks: list[Mark] = []
    around = []
    for name, item, shown, stroke in zip(items, items.values(), views, strokes, strict=True):
        marks += _curve(name, item, shown, stroke)
        around.append(shown.height(np.asarray(getattr(item, "implied", np.empty(0)))))
    marks = curves_then_bands(marks, len(results))
    return closed_panel(views, results, marks, around=around, strokes=strokes, names=list(items), title=title)


def _curve(name: str, item: Item, view: View, stroke: Stroke) -> list[Mark]:
    implied = getattr(item, "implied", None)
    wv = measured(item)
    if implied is None:
        marks = observed_marks(wv, view, stroke=stroke, label=name)
        return [_faint(mark) for mark in marks]
    used = getattr(item, "used", None)
    dots = observed_marks(wv, view, stroke=replace(stroke, width=0.0), label=name, used=used)
    curve = drawable(view.height(np.asarray(implied)))
    model = Line(view.time(wv.tau), curve, stroke=replace(stroke, symbol=None), label=f"{name}, model", layer=MIDDLE)
    return [*(_faint(mark) for mark in dots), model]


def _faint(mark: Mark) -> Mark:
    """Return the mark with lower opacity if it is a band, because several bands overlap."""
    return replace(mark, opacity=0.15) if isinstance(mark, Band) else mark


def plot_comparison(
    items: Mapping[str, Item],
    *,
    view: ViewName = "wavelet",
    units: UnitSystem = "si",
    title: str = "",
    ax: Axes | None = None,
    path: str | os.PathLike[str] | None = None,
) -> MatplotlibFigure:
    """Draw several wavelet variances in one panel, for example classical and robust, or two recordings.

    Parameters
    ----------
    items : mapping of name to WaveletVariance or Fit
        The curves, with their names for the legend. A fit is drawn with symbols for the data and a line for the model.
    view, units, ax, path
        As for `plot_wavelet_variance`.
    title : str
        Title of the panel.

    Returns
    -------
    matplotlib.figure.Figure
        A figure that is not registered with pyplot, so it need not be closed. Notebooks display it.

    Raises
    ------
    OptionError
        If an option is unknown, or the curves differ in unit.
    """
    from gmwm.showing.plots.matplotlib import draw

    panel = overlay_panel(checked_items(items), view=view, units=units, title=title)
    return draw(single_panel(panel, legend_rows=2), ax=ax, path=path)


def plot_conditions(
    fit: ConditionsFit,
    *,
    view: ViewName = "wavelet",
    units: UnitSystem = "si",
    path: str | os.PathLike[str] | None = None,
) -> MatplotlibFigure:
    """Draw the curves of all conditions with their models.

    Parameters
    ----------
    view : "wavelet" or "allan"
        Quantity to draw: the wavelet variance ν² against the scale τ (s), or the Allan deviation √(2ν²) against the
        averaging time τ/2 (s).
    units : "si" or "datasheet"
        Units of the plot: rad/s and m/s², or deg/h and mg.
    path : path, optional
        File to write the picture to, ending in .png, .pdf or .svg.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    OptionError
        If an option is unknown.
    """
    items: dict[str, Item] = {
        f"{fit.condition} {c:g}": AtCondition(wv, fit.models[c].wavelet_variance(wv.levels, wv.rate, wv.filter))
        for c, wv in fit.curves.items()
    }
    return plot_comparison(items, view=view, units=units, path=path)
