"""Plots of one or several wavelet variances, and their parts that other plots share."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, cast

import numpy as np

from gmwm.base.arrays import Booleans, Vector
from gmwm.base.errors import OptionError
from gmwm.measuring.covariance import Design
from gmwm.measuring.covariance.api import variances
from gmwm.showing.plots.axes import limits_near, signed_axis, time_axis, value_axis
from gmwm.showing.plots.figure import (
    Band,
    Figure,
    Foot,
    Mark,
    Panel,
    Polyline,
    Stroke,
    Text,
    description,
    drawable,
    drawing,
    single_panel,
)
from gmwm.showing.plots.labels import UnitSystem, View, ViewName, axis_title, view_of
from gmwm.showing.plots.style import GREY, OBSERVED, ROBUST, SOLID, curve_stroke

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gmwm.choosing.replicates import Replicates
    from gmwm.fitting.estimation.conditions_fit import ConditionsFit
    from gmwm.fitting.estimation.result import Fit
    from gmwm.fitting.likelihood.result import LikelihoodFit
    from gmwm.measuring.variance.result import WaveletVariance


BEHIND, BAND, MIDDLE, ABOVE, FRONT = range(5)
"""Layers from back to front: guides, bands, model, its terms (thin lines, so the model stays visible), data."""


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
    used: Booleans | None = None,
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
    """Return the legend entry of limits, whose freedom assumes no type of noise, unlike `gmwm.allan_variance`."""
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
    from gmwm.showing.plots.fit import named_panel

    if label is None and color is None:
        panel = wavelet_variance_panel(wv, view=view, units=units)
    else:
        panel = named_panel(wv, label=label, color=color, view=view, units=units, ax=ax)
    return Figure(((panel,),), height=88.0)


class AtCondition(NamedTuple):
    """Measured wavelet variance at one condition, and the wavelet variance that the model implies there."""

    wavelet_variance: WaveletVariance
    implied: Vector


Item: TypeAlias = "WaveletVariance | Fit | LikelihoodFit | AtCondition"
"""Something to draw as a curve: a wavelet variance, or a fit, which contains a wavelet variance."""


def wavelet_variance_of(item: Item) -> WaveletVariance:
    """Return the wavelet variance of an item. Anything else than a wavelet variance or a fit is an OptionError."""
    wv: Any = getattr(item, "wavelet_variance", item)
    if not hasattr(wv, "variance") or not hasattr(wv, "tau"):
        raise OptionError(argument="items", expected="of type WaveletVariance or Fit", got=item)
    return cast("WaveletVariance", wv)


def checked_items(items: Mapping[str, Any]) -> dict[str, Item]:
    """Check a mapping from names to wavelet variances and fits, and return it as a dict."""
    if not isinstance(items, Mapping) or not items:
        raise OptionError(
            argument="items",
            expected="a mapping of names to WaveletVariance or Fit such as {'gyro_x': wv_x, 'gyro_y': wv_y}",
            got=items,
        )
    for item in items.values():
        wavelet_variance_of(item)
    return dict(items)


def overlay_panel(
    items: Mapping[str, Item], *, view: ViewName = "auto", units: UnitSystem = "auto",
    strokes: Sequence[Stroke] | None = None, title: str = "",
) -> Panel:  # fmt: skip
    """Return a panel with curves of one unit and bands; a fit has symbols for data and a line for the model."""
    items = {name: getattr(item, "without_lags", item) for name, item in items.items()}
    results = [wavelet_variance_of(item) for item in items.values()]
    views = [view_for(wv, view, units) for wv in results]
    if len({shown.unit for shown in views}) > 1:
        pairs = zip(items, views, strict=True)
        descriptions = ", ".join(f"{name} in {shown.unit or 'no unit'}" for name, shown in pairs)
        raise OptionError(
            f"curves in one panel need the same unit, but they are {descriptions}", argument="items",
            got=tuple(shown.unit for shown in views), advice="Plot each sensor in its own figure.",
        )  # fmt: skip
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
    wv = wavelet_variance_of(item)
    if implied is None:
        marks = observed_marks(wv, view, stroke=stroke, label=name)
        return [_faint(mark) for mark in marks]
    used = getattr(item, "used", None)
    dots = observed_marks(wv, view, stroke=replace(stroke, width=0.0), label=name, used=used)
    curve = drawable(view.height(np.asarray(implied)))
    model = Polyline(
        view.time(wv.tau), curve, stroke=replace(stroke, symbol=None), label=f"{name}, model", layer=MIDDLE
    )
    return [*(_faint(mark) for mark in dots), model]


def _faint(mark: Mark) -> Mark:
    """Return the mark with lower opacity if it is a band, because several bands overlap."""
    return replace(mark, opacity=0.15) if isinstance(mark, Band) else mark


@drawing
def plot_comparison(
    items: Mapping[str, Item], *, view: ViewName = "auto", units: UnitSystem = "auto", title: str = "",
    ax: Axes | None = None, path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw several wavelet variances in one panel, for example classical and robust, or two recordings.

    Parameters
    ----------
    items : mapping of name to WaveletVariance or Fit
        The curves, with their names for the legend. A fit is drawn with symbols for the data and a line for the model.
    title : str
        Title of the panel.

    Raises
    ------
    OptionError
        If an option is unknown, or the curves differ in unit.
    """
    panel = overlay_panel(checked_items(items), view=view, units=units, title=title)
    return single_panel(panel, legend_rows=2)


@drawing
def plot_conditions(
    fit: ConditionsFit, *, view: ViewName = "auto", units: UnitSystem = "auto",
    path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw the curves of all conditions with their models; of more than five, four from the lowest to the highest."""
    conditions = sorted(fit.curves)
    if len(conditions) > 5:
        conditions = [conditions[round(k * (len(conditions) - 1) / 3)] for k in range(4)]
    items: dict[str, Item] = {}
    for c in conditions:
        wv = fit.curves[c]
        implied = fit.models[c].wavelet_variance(wv.levels, wv.rate, wv.filter)
        items[f"{fit.condition} {c:.4g}"] = AtCondition(wv, implied)
    return description(plot_comparison)(items, view=view, units=units)


@drawing
def compare(
    *items: Item, labels: Sequence[str] | None = None, view: ViewName = "auto", units: UnitSystem = "auto",
    title: str = "", ax: Axes | None = None, path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw several wavelet variances in one panel, for example classical and robust, or several axes or recordings.

    Parameters
    ----------
    items : WaveletVariance or Fit
        One or more curves. A fit is drawn with symbols for the data and a line for the model.
    labels : sequence of str, optional
        Names for the legend. By default, they state the properties in which the curves differ: axis, classical or
        robust estimate, filter, length and rate, or fitted model.
    title : str
        Title of the panel.

    Raises
    ------
    OptionError
        If an option is unknown, a label is missing or repeated, or the curves differ in unit.

    References
    ----------
    The comparison of classical and robust wavelet variances follows Balamuta, Guerrier, Molinari and Yang.

    Examples
    --------
    >>> import numpy as np
    >>> from gmwm import Signal, wavelet_variance
    >>> signal = Signal(np.random.default_rng(1).normal(size=4096), 100.0, "rad/s", "gyro_x")
    >>> figure = compare(wavelet_variance(signal), wavelet_variance(signal, robust=True))
    >>> figure.axes[0].get_ylabel()
    'Allan deviation (deg/h)'
    """
    if not items:
        raise OptionError(argument="items", expected="one or more of WaveletVariance and Fit", got=items)
    for item in items:
        if not hasattr(wavelet_variance_of(item), "robust"):
            raise OptionError(
                argument="items", expected="of type WaveletVariance or Fit", got=item,
                advice="Draw Allan variances with `gmwm.plots.plot_allan_axes`.",
            )  # fmt: skip
    names = automatic_labels(items) if labels is None else [str(name) for name in labels]
    if len(names) != len(items):
        raise OptionError(
            argument="labels", expected=f"a sequence of {len(items)} names, one for each curve", got=names
        )
    if len(set(names)) != len(names):
        raise OptionError(argument="labels", expected="a sequence of different names", got=names)
    return description(plot_comparison)(dict(zip(names, items, strict=True)), view=view, units=units, title=title)


def automatic_labels(items: Sequence[Item]) -> list[str]:
    """Return names that state how items differ, such as by axis or model, or else their numbers."""
    results = [wavelet_variance_of(item) for item in items]
    aspects = [
        [axis_title(wv.axis) for wv in results], _estimators(results),
        [f"{wv.filter} {wv.transform.upper()}" for wv in results], [wv.extent for wv in results],
        [_model(item) for item in items],
    ]  # fmt: skip
    telling = [aspect for aspect in aspects if len(set(aspect)) > 1] or [aspects[0]]
    names = [", ".join(filter(None, words)) or "Wavelet variance" for words in zip(*telling, strict=True)]
    for name in {name for name in names if names.count(name) > 1}:
        same = [k for k, other in enumerate(names) if other == name]
        for number, k in enumerate(same, 1):
            names[k] = f"{name} ({number})"
    return names


def _model(item: Item) -> str:
    """Return the structure of a fitted model, for example "2*GM + WN"; "" for a measured curve."""
    model = getattr(item, "model", None)
    return "" if model is None else str(model.structure)


def _estimators(results: Sequence[WaveletVariance]) -> list[str]:
    """Return "classical" or "robust" for each result, with the efficiency if it differs between robust results."""
    several = len({wv.efficiency for wv in results if wv.robust}) > 1
    return [
        (f"robust, efficiency {wv.efficiency:g}" if several else "robust") if wv.robust else "classical"
        for wv in results
    ]


MEAN = Stroke(GREY, 0.8, SOLID)  # stroke of the line at zero, which is the mean of the recordings
LINEAR, EVEN = 10.0, 100.0
"""Differences (%) up to which the vertical axis is linear, and from which it is not linear throughout."""


@drawing
def plot_recordings(replicates: Replicates, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Draw the relative difference between the wavelet deviation of each recording and of all recordings together.

    A band shows the range of differences that chance explains."""
    wv, fit = replicates.fit.wavelet_variance, replicates.fit
    curves = wv.recordings
    ratios = {name: 100 * (np.sqrt(curve.variance[: len(wv)] / wv.variance[: len(curve)]) - 1)
              for name, curve in curves.items()}  # fmt: skip
    typical = sorted(curves.values(), key=lambda curve: curve.samples)[len(curves) // 2]
    typical_levels = min(len(typical), len(wv))
    design = Design.of(typical).only(typical.levels <= typical_levels)
    # A recording contributes to the mean, so it differs less from the mean than from another recording.
    part = np.sqrt(max(1 - typical.samples / wv.samples, 0.0))
    scatter = 50 * 1.96 * part * np.sqrt(variances(fit.model, design)) / fit.implied[:typical_levels]
    x = replace(time_axis(wv.tau, "Scale τ (s)"), opposite=())
    shown = [values[wv.degrees_of_freedom[: values.size] > len(curves)] for values in ratios.values()]
    y = signed_axis(np.concatenate(shown), "Difference from all recordings (%)", linear=LINEAR, even=EVEN)
    marks: list[Mark] = [
        Polyline(np.array(x.limits), np.zeros(2), stroke=MEAN, label="", layer=BEHIND),
        Band(wv.tau[:typical_levels], -scatter, scatter, colour=GREY, opacity=0.25, layer=BAND,
             label="95 % of equal recordings"),
    ]  # fmt: skip
    for k, (name, values) in enumerate(ratios.items()):
        marks.append(Polyline(wv.tau[: values.size], values, stroke=curve_stroke(k), label=name, layer=FRONT))
    return Figure(((Panel(x, y, tuple(marks), title=axis_title(wv.axis)),),), width=150.0, height=95.0)
