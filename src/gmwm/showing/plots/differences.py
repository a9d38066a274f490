"""Plot of the answers to "do these differ?": ratios with their confidence intervals, one row for each test."""

from __future__ import annotations

import math
import os

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.differences import Difference, DifferenceTests
from gmwm.base.errors import DataError
from gmwm.showing.plots.axes import limits_of, value_axis
from gmwm.showing.plots.figure import PAGE, Axis, Figure, Mark, Panel, Polyline, Stroke, Tick, drawing
from gmwm.showing.plots.style import BLACK, GREY, VERMILLION

_STROKES = {
    True: (Stroke(VERMILLION, 1.2, symbol="square"), "Differs"),
    False: (Stroke(GREY, 0.9, symbol="circle", filled=False), "No difference found"),
}


def _ends(test: Difference) -> Vector:
    """Return the confidence limits and the ratio; NaN for a limit that is not known."""
    return np.array([test.lower or math.nan, test.upper or math.nan, test.ratio], dtype=np.float64)


@drawing
def plot_differences(
    result: DifferenceTests, *, limit: int = 40, path: str | os.PathLike[str] | None = None
) -> Figure:  # fmt: skip
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
