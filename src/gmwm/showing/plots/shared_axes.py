"""Draw fits or wavelet variances one after another on the same Matplotlib axes, each with a name and a colour."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex

from gmwm.base.errors import OptionError
from gmwm.showing.plots.axes import time_axis, value_axis
from gmwm.showing.plots.curves import curves_then_bands, view_for
from gmwm.showing.plots.figure import Panel, Polyline
from gmwm.showing.plots.fit import term_lines
from gmwm.showing.plots.overlay import Item, overlay_panel, wavelet_variance_of
from gmwm.showing.plots.style import curve_stroke
from gmwm.showing.plots.view import UnitSystem, ViewName

if TYPE_CHECKING:
    from gmwm.showing.plots.fit import Fitted


def named_panel(
    item: Item, *, label: str | None = None, color: str | None = None, view: ViewName = "auto",
    units: UnitSystem = "auto", ax: Axes | None = None,
) -> Panel:  # fmt: skip
    """Return a panel with one named curve. Its axes include the curves that gmwm has already drawn on `ax`, and its
    default colour is the next free one. Raises an OptionError if the earlier curves have another quantity or unit."""
    drawn = ax if isinstance(ax, Axes) else None
    # Each earlier curve has one confidence band, so the number of bands is the number of curves.
    before = 0 if drawn is None else sum(isinstance(artist, PolyCollection) for artist in drawn.collections)
    stroke = curve_stroke(before)
    if color is not None:
        stroke = replace(stroke, colour=_hex(color))
    name = wavelet_variance_of(item).axis or "Data" if label is None else label
    panel = overlay_panel({name: item}, view=view, units=units, strokes=[stroke])
    # The bands of all curves share one legend entry.
    panel = replace(panel, marks=tuple(curves_then_bands(panel.marks, 2)))
    return panel if drawn is None or not before else _join(panel, drawn)


def named_fit_panel(
    fit: Fitted, *, label: str | None, color: str | None, view: ViewName, units: UnitSystem, ax: Axes | None,
    decomposition: bool,
) -> Panel:  # fmt: skip
    """Return the panel of `named_panel` for a fit, with a thin line for each term in its colour if `decomposition`."""
    panel = named_panel(fit, label=label, color=color, view=view, units=units, ax=ax)
    if not decomposition:
        return panel
    name = panel.marks[0].label
    shown = view_for(fit.wavelet_variance, view, units)
    colour = next(mark.stroke.colour for mark in panel.marks if isinstance(mark, Polyline))
    terms = (
        replace(line, stroke=replace(line.stroke, colour=colour), label=f"{name}, {line.label}")
        for line in term_lines(fit, shown, alone=False)
    )
    return replace(panel, marks=(*panel.marks, *terms))


def _hex(color: str) -> str:
    try:
        return to_hex(color)
    except (ValueError, TypeError) as error:
        raise OptionError(argument="color", expected='a colour such as "#0072B2" or "red"', got=color) from error


def _join(panel: Panel, ax: Axes) -> Panel:
    """Return the panel with axes that also include the curves on `ax`, which must show the same quantity and unit."""
    if ax.get_ylabel() != panel.y.label:
        raise OptionError(
            f"curves on the same axes need the same quantity and unit, but they are {ax.get_ylabel()!r} and "
            f"{panel.y.label!r}",
            argument="ax",
            got=ax,
            advice="Plot them on axes of their own.",
        )
    # Minor ticks are lines too. They are excluded because their positions are not in the units of the data.
    curves = [line for line in ax.lines if all(line.get_transform().contains_branch_seperately(ax.transData))]
    times = [np.asarray(line.get_xdata(), dtype=float) for line in curves] + [line.x for line in panel.lines]
    (low, high), (bottom, top) = ax.get_ylim(), panel.y.limits
    return replace(
        panel,
        x=time_axis(np.unique(np.concatenate(times)), panel.x.label),
        y=value_axis((min(low, bottom), max(high, top)), panel.y.label),
    )
