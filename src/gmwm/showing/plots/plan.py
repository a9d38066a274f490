"""Plot of the relative standard errors of parameters against the duration of a planned recording."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.text import duration_text
from gmwm.fitting.inference.planning import CERTAIN_ERROR, Plan, as_accuracy
from gmwm.showing.plots.axes import limits_of, time_axis, value_axis
from gmwm.showing.plots.curves import BAND, BEHIND, FRONT, MIDDLE
from gmwm.showing.plots.figure import Band, Figure, Mark, Panel, Polyline, Stroke, Symbol, drawing, single_panel
from gmwm.showing.plots.labels import model_text
from gmwm.showing.plots.style import BLACK, DOTTED, GREY, term_strokes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

HIGHEST_ERROR = 2.0
"""Largest relative standard error that is drawn. Pinned by tests/plots/test_plot_plan.py."""
FURTHER = (2.0, 100.0)
"""Smallest and largest duration at which the curves may end, as multiples of the planned duration. Between these
limits, they end where all parameters have reached the accuracy. Pinned by tests/plots/test_plot_limits.py."""
SYMBOLS: tuple[Symbol, ...] = ("circle", "square", "triangle", "diamond", "star", "plus", "cross", "down")
OPEN: tuple[Symbol, ...] = ("square", "triangle", "diamond", "star", "down")
"""Symbols that are used unfilled too. The unfilled circle is not among them, because it marks where a parameter reaches
the accuracy."""


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
    """Return the durations (s) of the points of the curves, and the relative standard errors of each parameter there:
    from where the first error falls below `HIGHEST_ERROR` until the last one has reached the accuracy."""
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
    """Return the stroke of each parameter: that of its term for a scale parameter, or a solid line with symbols in its
    colour."""
    strokes = {}
    symbols = cycle([*((symbol, True) for symbol in SYMBOLS), *((symbol, False) for symbol in OPEN)])
    by_term = term_strokes(plan.model.terms, plan.model.processes)
    for term, process in zip(plan.model.terms, plan.model.processes, strict=True):
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
