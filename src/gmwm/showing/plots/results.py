"""Plots of a plan, of tests for differences, and of a regression."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.errors import DataError
from gmwm.base.results import Difference, DifferenceTests
from gmwm.base.text import duration_text
from gmwm.base.units import datasheet_units
from gmwm.fitting.inference.planning import CERTAIN_ERROR, Plan, as_accuracy
from gmwm.measuring.regression.against import TEMPERATURE, WARM_UP
from gmwm.recording.options import one_of
from gmwm.showing.plots.axes import even_axis, limits_of, power_of, scaled_unit, time_axis, value_axis
from gmwm.showing.plots.curves import BAND, BEHIND, FRONT, MIDDLE
from gmwm.showing.plots.figure import (
    PAGE,
    Axis,
    Band,
    Figure,
    Mark,
    Panel,
    Polyline,
    Stroke,
    Symbol,
    Tick,
    drawing,
    single_panel,
)
from gmwm.showing.plots.labels import UnitSystem, axis_title, model_text
from gmwm.showing.plots.style import BLACK, BLUE, DOTTED, GREY, ORANGE, VERMILLION, term_strokes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gmwm.measuring.regression.result import Regression


HIGHEST_ERROR = 2.0
"""Largest relative standard error that is drawn. Pinned by tests/plots/test_plot_plan.py."""
FURTHER = (2.0, 100.0)
"""Smallest and largest duration at which the curves may end, as multiples of the planned duration. Between these
limits, they end where all parameters have reached the accuracy. Pinned by tests/plots/test_plot_limits.py."""
SYMBOLS: tuple[Symbol, ...] = ("circle", "square", "triangle", "diamond", "star", "plus", "cross", "down")
OPEN: tuple[Symbol, ...] = ("square", "triangle", "diamond", "star", "down")
"""Symbols also used unfilled, without the circle, which marks where a parameter reaches the accuracy."""


def plan_panel(plan: Plan, *, accuracy: float = 0.1) -> Panel:
    """Return the panel that `plot_plan` draws, with a curve for each parameter and a circle at the accuracy."""
    target, needed = as_accuracy(accuracy), plan.needed(accuracy)
    times, curves = _curves(plan, needed)
    strokes = _strokes(plan)
    heights = np.concatenate([100 * curve for curve in curves.values()])
    y = value_axis(
        limits_of(np.append(np.minimum(heights, 100 * HIGHEST_ERROR), [100 * HIGHEST_ERROR, 50 * target])), _LABEL
    )
    x = time_axis(times, "Length of the recording (s)")
    across, along = np.array(x.limits), np.array(y.limits)
    length = f"{duration_text(plan.duration)}: planned duration"
    chosen = f"{100 * target:g} %: chosen accuracy"
    unseen = f"above {100 * CERTAIN_ERROR:g} %: not determined by the data"
    marks: list[Mark] = []
    for name, curve in curves.items():
        label = f"{name}: {_need_text(name, needed[name], plan, target)}"
        if np.all(np.isfinite(curve) & (curve > HIGHEST_ERROR)):
            label += f", above {100 * HIGHEST_ERROR:g} % throughout"
        heights = np.where(curve <= HIGHEST_ERROR, 100 * curve, np.nan)
        marks.append(Polyline(times, heights, stroke=strokes[name], label=label, layer=MIDDLE))
    reached = np.array([t for t in needed.values() if times[0] < t <= times[-1]])
    dots = Stroke(BLACK, 0.0, symbol="circle", filled=False)
    marks += [
        Polyline(reached, np.full(reached.shape, 100 * target), stroke=dots, label="", layer=FRONT),
        Polyline(across, np.full(2, 100 * target), stroke=Stroke(BLACK, 0.7), label=chosen, layer=BEHIND),
        Polyline(np.full(2, plan.duration), along, stroke=Stroke(GREY, 1.1, DOTTED), label=length, layer=BEHIND),
        Band(across, np.full(2, 100 * CERTAIN_ERROR), np.full(2, np.inf), GREY, opacity=0.16, label=unseen, layer=BAND),
    ]
    return Panel(x, y, tuple(marks), f"{model_text(plan.model.terms)} at {plan.rate:g} Hz, weighting {plan.weighting}")


_LABEL = "Relative standard error (%)"


def _curves(plan: Plan, needed: dict[str, float]) -> tuple[Vector, dict[str, Vector]]:
    """Return durations (s) and relative errors of each parameter, from below `HIGHEST_ERROR` until all are accurate."""
    furthest = max((t for t in needed.values() if math.isfinite(t)), default=0.0)
    least, most = (plan.duration * factor for factor in FURTHER)
    end = min(max(1.5 * furthest, least), most, plan.horizon)
    # Eight points per decade of duration (tests/plots/test_plot_limits.py).
    count = max(1, math.ceil(8 * math.log10(end / plan.duration)))
    beyond = np.geomspace(plan.duration, end, count + 1)[1:]
    further = [plan.at(t) for t in beyond.tolist()]
    times = np.concatenate([plan.durations, beyond])
    curves = {name: np.append(curve, [at[name] for at in further]) for name, curve in plan.errors.items()}
    shown = np.min(np.array(list(curves.values())), axis=0) <= HIGHEST_ERROR
    first = int(np.argmax(shown)) if np.any(shown) else 0
    return times[first:], {name: curve[first:] for name, curve in curves.items()}


def _strokes(plan: Plan) -> dict[str, Stroke]:
    """Return each parameter's stroke: that of its term for scales, or a solid line with symbols in its colour."""
    strokes = {}
    symbols = cycle([*((symbol, True) for symbol in SYMBOLS), *((symbol, False) for symbol in OPEN)])
    by_term = term_strokes(plan.model.terms, plan.model.processes)
    for term, process in plan.model.by_term.items():
        for parameter in process.parameters:
            stroke = replace(by_term[term], width=1.3)
            if parameter.scale_power is None:
                symbol, filled = next(symbols)
                stroke = Stroke(stroke.colour, 0.8, symbol=symbol, filled=filled)
            strokes[f"{term}.{parameter.name}"] = stroke
    return strokes


def _need_text(name: str, seconds: float, plan: Plan, accuracy: float) -> str:
    if math.isfinite(seconds):
        return f"{100 * accuracy:g} % in {duration_text(seconds)}"
    if math.isinf(plan.errors[name][-1]):
        return "not determined"
    return f"more than {100 * accuracy:g} % in {duration_text(plan.horizon)}"


@drawing
def plot_plan(
    plan: Plan, *, accuracy: float = 0.1, ax: Axes | None = None, path: str | os.PathLike[str] | None = None
) -> Figure:
    """Draw the relative standard error of each parameter over the length of the recording.

    The curves continue beyond the planned duration, which is marked.

    Parameters
    ----------
    accuracy : float
        Desired relative standard error. It is drawn as a horizontal line, with a ring where each parameter reaches
        it.

    Raises
    ------
    OptionError
        If `accuracy` is not between 0 and 0.5, or the plot cannot be drawn on `ax` or written to `path`.
    """
    panel = plan_panel(plan, accuracy=accuracy)
    return single_panel(panel, 84.0)


_STROKES = {
    True: (Stroke(VERMILLION, 1.2, symbol="square"), "Differs"),
    False: (Stroke(GREY, 0.9, symbol="circle", filled=False), "No difference found"),
}


def _ends(test: Difference) -> Vector:
    """Return the confidence limits and the ratio; NaN for a limit that is not known."""
    return np.array([test.lower or math.nan, test.upper or math.nan, test.ratio], dtype=np.float64)


@drawing
def plot_differences(result: DifferenceTests, *, limit: int = 40, path: str | os.PathLike[str] | None = None) -> Figure:
    """Draw the ratio of each part to the others with its confidence interval, and mark those that differ.

    Parameters
    ----------
    limit : int
        Largest number of tests to draw, those with the smallest p-values.

    Raises
    ------
    DataError
        If no ratio is known.
    """
    drawn = [test for test in result.tests if test.ratio > 0 and math.isfinite(test.ratio)]
    if not drawn:
        raise DataError("there is nothing to draw: no ratio is known")
    # A plot of all 120 ratios of two recordings could not be read: the clearest differences are drawn.
    clearest = sorted(drawn, key=lambda test: (1.0 if test.pvalue is None else test.pvalue, -abs(math.log(test.ratio))))
    shown = [test for test in drawn if test in clearest[:limit]]
    places = np.arange(len(shown), 0, -1.0)
    left_out = f", the {len(shown)} clearest of {len(drawn)} tests" if len(shown) < len(drawn) else ""
    heights = np.concatenate([_ends(test) for test in shown])
    limits = limits_of(np.append(heights[np.isfinite(heights) & (heights > 0)], 1.0))
    x = value_axis(limits, f"Ratio (1: no difference){left_out}")
    # If all ratios are of one recording or unit, the title has its name instead of each row.
    parts = {test.name.partition(", ")[2] for test in shown}
    title = f"{parts.pop()} over the others" if len(parts) == 1 and "" not in parts else ""
    names = [test.name.partition(", ")[0] if title else test.name for test in shown]
    ticks = tuple(Tick(place, name) for name, place in zip(names, places, strict=True))
    y = Axis("", (0.4, len(shown) + 0.6), ticks, linear=math.inf)
    marks: list[Mark] = [Polyline(np.ones(2), np.array(y.limits), stroke=Stroke(BLACK, 0.9), label="Equal")]
    for differs, (stroke, label) in _STROKES.items():
        rows = [(test, place) for test, place in zip(shown, places, strict=True) if test.differs is differs]
        if rows:
            across = np.concatenate([[*np.clip(_ends(test)[:2], *limits), np.nan] for test, _ in rows])
            lines = np.concatenate([[place, place, np.nan] for _, place in rows])
            ratios, at = np.array([test.ratio for test, _ in rows]), np.array([place for _, place in rows])
            marks.append(Polyline(across, lines, stroke=Stroke(stroke.colour, stroke.width), label="", layer=1))
            marks.append(Polyline(ratios, at, stroke=Stroke(
                stroke.colour, 0.0, symbol=stroke.symbol, filled=stroke.filled), label=label, layer=2))  # fmt: skip
    return Figure(((Panel(x, y, tuple(marks), title),),), width=PAGE, height=40.0 + 4.5 * len(shown), legend_columns=3)


BEFORE = Stroke(BLUE, 0.0, (), "circle", filled=False)
AFTER = Stroke(GREY, 0.0, (), "cross")
EFFECT = Stroke(ORANGE, 2.2)


def regression_panel(regression: Regression, *, units: UnitSystem = "si") -> Panel:
    """Return `plot_regression`'s panel: block means before and after removal, and the effect with its 95 % band."""
    unit, factor = regression.unit, 1.0
    if units == "datasheet" and (others := datasheet_units(regression.unit)):
        unit, factor = next(iter(others.items()))
    term = regression.terms[0]
    name = term.name
    before = factor * (regression.points.before - regression.mean)
    after = factor * (regression.points.after - regression.mean)
    reach = float(np.max(np.abs(np.concatenate([before, after]))))
    power = power_of(reach)
    size = 10.0**-power
    low, high = float(np.min(regression.points.at)), float(np.max(regression.points.at))
    time = f"Time ({term.unit or 'h'})"
    title = "Temperature (°C)" if name == TEMPERATURE else name if term.is_measured else time
    x = even_axis(low, high, title, margin=0.03)
    values = np.concatenate([before, after]) * size
    label = f"{axis_title(regression.axis) or 'Signal'} ({scaled_unit(unit, power)})"
    y = even_axis(float(np.min(values)), float(np.max(values)), label, margin=0.06)
    marks: list[Polyline | Band] = [
        Polyline(regression.points.at, before * size, stroke=BEFORE, label="Before", layer=1)
    ]
    if name in regression.references and name != WARM_UP:
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
    band."""
    one_of(units, "units", ("si", "datasheet"))
    return single_panel(regression_panel(regression, units=units))
