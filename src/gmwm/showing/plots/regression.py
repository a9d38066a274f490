"""Plot of a regression: the signal of an axis against a covariate, before and after the effect is removed."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.errors import OptionError
from gmwm.base.units import datasheet_units
from gmwm.measuring.regression.against import TIME, WARM_UP
from gmwm.showing.plots.axes import even_axis, power_of, scaled_unit
from gmwm.showing.plots.figure import Band, Figure, Panel, Polyline, Stroke, drawing, single_panel
from gmwm.showing.plots.labels import UnitSystem, axis_title
from gmwm.showing.plots.style import BLUE, GREY, ORANGE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gmwm.measuring.regression.result import Regression

BEFORE = Stroke(BLUE, 0.0, (), "circle", filled=False)
AFTER = Stroke(GREY, 0.0, (), "cross")
EFFECT = Stroke(ORANGE, 2.2)
_NAMES = {"temperature": "Temperature (°C)", TIME: "Time (h)", WARM_UP: "Time (h)"}


def regression_panel(regression: Regression, *, units: UnitSystem = "si") -> Panel:
    """Return the panel that `plot_regression` draws: block means of the signal against the first covariate, before
    (with all effects) and after the removal, and the estimated effect with its 95 % band, relative to the reference
    value."""
    unit, factor = regression.unit, 1.0
    if units == "datasheet" and (others := datasheet_units(regression.unit)):
        unit, factor = next(iter(others.items()))
    name = regression.terms[0].name
    before = factor * (regression.points.before - regression.mean)
    after = factor * (regression.points.after - regression.mean)
    reach = float(np.max(np.abs(np.concatenate([before, after]))))
    power = power_of(reach)
    size = 10.0**-power
    low, high = float(np.min(regression.points.at)), float(np.max(regression.points.at))
    x = even_axis(low, high, _NAMES.get(name, name), margin=0.03)
    values = np.concatenate([before, after]) * size
    label = f"{axis_title(regression.axis) or 'Signal'} ({scaled_unit(unit, power)})"
    y = even_axis(float(np.min(values)), float(np.max(values)), label, margin=0.06)
    marks: list[Polyline | Band] = [
        Polyline(regression.points.at, before * size, stroke=BEFORE, label="Before", layer=1)
    ]
    if name != WARM_UP:
        effect = regression.curve(np.linspace(*regression.ranges[name], 100), name)
        scale = factor * size
        marks = [
            Band(effect.at, effect.lower * scale, effect.upper * scale, ORANGE, label="95 % confidence band", layer=2),
            *marks,
            Polyline(effect.at, effect.value * scale, stroke=EFFECT, label="Effect", layer=3),
        ]
    marks.append(Polyline(regression.points.at, after * size, stroke=AFTER, label="After", layer=2))
    return Panel(x, y, tuple(marks), f"{axis_title(regression.axis)} against {regression.against}")


@drawing
def plot_regression(
    regression: Regression, *, units: UnitSystem = "si", ax: Axes | None = None,
    path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw the axis against its first covariate, before and after the effect is subtracted, with the effect and its
    band.
    """
    if units not in ("si", "datasheet"):
        raise OptionError(argument="units", expected="'si' or 'datasheet'", got=units)
    return single_panel(regression_panel(regression, units=units))
