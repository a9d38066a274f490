"""Plot of a fleet: each quantity of each axis for all units, with outliers and a prediction interval for a new unit."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

import numpy as np
from numpy.typing import NDArray

from gmwm.applications.fleets.result import Fleet
from gmwm.applications.fleets.statistics import FleetSamples, ParameterSample
from gmwm.applications.fleets.statistics_result import FleetNumber, FleetStatistics
from gmwm.base.arrays import Vector
from gmwm.base.errors import OptionError
from gmwm.base.text import counted
from gmwm.base.units import usual_unit
from gmwm.showing.plots.axes import even_axis, limits_of, power_of, scaled_unit, value_axis
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
    Text,
    Tick,
    drawing,
)
from gmwm.showing.plots.labels import sensor_and_letter, sensor_title
from gmwm.showing.plots.style import BLACK, DASHED, GREY, curve_stroke, letter_stroke

SINGLY = 40
"""Largest number of units drawn as dots with intervals, not as a curve. Pinned by tests/plots/test_plot_fleet.py."""
UNIT_SYMBOLS: tuple[Symbol, ...] = ("circle", "square", "triangle", "diamond", "cross", "plus")
"""Symbols of single units. They are used only if there are at most as many units as symbols."""
HALF_STRIP = 0.4
"""Half of the width of the strip that shows one axis. The centres of neighbouring strips have the distance 1."""
NAMED, LETTERS = 3, 14
"""Largest number of named outliers in a panel, and letters of a name. Pinned by tests/plots/test_plot_fleet.py."""
CLEAR, LETTER = 0.07, 0.036
"""Height of the name of an outlier, and width of each of its letters, as fractions of the panel."""
ROW, BELOW = 52.0, 22.0  # height (mm) of a row of panels, and of the legend


@drawing
def plot_fleet(fleet: Fleet, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Draw the datasheet parameters of all units in ascending order, for each axis.

    A number of an axis is drawn if at least two units have it or a limit of it, parameters of processes in the same
    model. Up to 40 units are drawn as dots with confidence intervals, more units as a curve. The line is the typical
    value. The shaded region contains the true value of a further unit with the confidence level. Stars with names
    are outlying units, and triangles are upper limits.

    Raises
    ------
    OptionError
        If there is nothing to draw, or if the picture cannot be written to `path`.
    """
    statistics = fleet.statistics
    if not statistics.rows:
        raise OptionError(
            "the fleet has no estimated parameter to draw", argument="fleet",
            advice="Read the reasons in the column `reason` of the table.",
        )  # fmt: skip
    reading = FleetSamples(fleet.table, statistics.confidence)
    groups: dict[str, dict[str, list[ParameterSample]]] = {}
    samples = reading.samples()
    shared = [sample for sample in samples if np.count_nonzero(np.isfinite(sample.x) | sample.limited) > 1]
    for sample in sorted(shared or samples, key=lambda sample: reading.symbols.index(sample.symbol)):
        sensor = sensor_and_letter(sample.axis)[0] or sample.axis
        groups.setdefault(sensor, {}).setdefault(sample.symbol, []).append(sample)
    rows: list[tuple[Panel | None, ...]] = []
    for sensor, symbols in groups.items():
        panels: list[Panel | None] = [_panel(sensor, of, statistics, reading.units) for of in symbols.values()]
        width = min(3, max(map(len, groups.values())))
        panels += [None] * (-len(panels) % width)
        rows += [tuple(panels[k : k + width]) for k in range(0, len(panels), width)]
    odd = len({outlier.unit for outlier in statistics.outliers})
    title = counted(statistics.units, "unit") + (f", {counted(odd, 'outlier')}" if odd else "")
    return Figure(tuple(rows), width=PAGE, height=ROW * len(rows) + BELOW, title=title, legend_columns=3)


def _panel(sensor: str, samples: Sequence[ParameterSample], statistics: FleetStatistics, units: Sequence[str]) -> Panel:
    first = samples[0]
    signed = statistics[f"{first.axis}.{first.symbol}"].signed
    unit, factor = usual_unit(first.unit)
    power, strips = 0, _strips(samples, statistics, factor, units)
    size = float(np.nanmax(np.abs(np.concatenate([strip.heights for strip in strips])), initial=0.0))
    # Smaller values have a power of ten in the label of the axis (tests/plots/test_plot_fleet.py).
    if size < 0.005:
        power = power_of(size)
        strips = _strips(samples, statistics, factor / 10.0**power, units)
    ticks = tuple(Tick(k, sensor_and_letter(sample.axis)[1].upper()) for k, sample in enumerate(samples, start=1))
    x = Axis("", (0.5, len(samples) + 0.7), ticks, linear=math.inf)  # upper limits are beside the last strip
    label = f"{first.symbol} ({scaled_unit(unit, power)})"
    y = _height_axis(np.concatenate([strip.heights for strip in strips]), label, signed=signed)
    marks = tuple(sorted((mark for strip in strips for mark in strip.marks), key=_rank(units)))
    stars = [star for strip in strips for star in strip.stars]
    return Panel(x, y, marks=marks, title=f"{sensor_title(sensor)} {first.symbol}", texts=_names(stars, x, y))


def _rank(units: Sequence[str]) -> Callable[[Mark], int]:
    """Return a function that orders marks for the legend: units in their order, then what is said about all units."""
    order = [*_short(units), *units, "Unit", "Outlier", "Typical value", "Range", "Upper limits"]
    return lambda mark: next((k for k, start in enumerate(order) if mark.label.startswith(start)), len(order))


@dataclass(frozen=True, eq=False)
class _Strip:
    """Part of a panel that shows one axis."""

    marks: list[Mark]
    heights: Vector  # (n,) values that the vertical axis must include
    stars: list[tuple[float, float, str]]  # positions and names of outliers


def _strips(
    samples: Sequence[ParameterSample], statistics: FleetStatistics, factor: float, units: Sequence[str]
) -> list[_Strip]:
    return [
        _strip(k, sample, found=statistics, factor=factor, units=units) for k, sample in enumerate(samples, start=1)
    ]


def _strip(place: int, sample: ParameterSample, found: FleetStatistics, factor: float, units: Sequence[str]) -> _Strip:
    row = found[f"{sample.axis}.{sample.symbol}"]
    finite = np.isfinite(sample.x)
    order = np.flatnonzero(finite)[np.argsort(sample.x[finite], kind="stable")]
    across = (
        place + HALF_STRIP * np.linspace(-1, 1, order.size) if order.size > 1 else np.full(order.size, float(place))
    )
    value, low, high = (factor * part[order] for part in (sample.value, sample.low, sample.high))
    odd = {outlier.unit for outlier in found.outliers if (outlier.axis, outlier.symbol) == (sample.axis, sample.symbol)}
    alike = np.array([units[k] not in odd for k in order], dtype=bool)
    stroke = letter_stroke(sensor_and_letter(sample.axis)[1]) or curve_stroke(place - 1)
    marks, limits = _limit_marks(place, sample, row, factor)
    if order.size <= SINGLY:
        bars = np.repeat(across, 3), np.column_stack([low, high, np.full(order.size, np.nan)]).ravel()
        marks.append(Polyline(*bars, Stroke(stroke.colour, 0.8), "", BEHIND))
        marks += _dots(across, value, order, alike=alike, colour=stroke.colour, units=units)
        # An interval extends the axis by a factor of 3 at most (tests/plots/test_plot_limits.py).
        heights = np.concatenate([value, np.maximum(low, value / 3.0), np.minimum(high, value * 3.0)])
        heights = np.concatenate([value, low, high]) if row.signed else heights
    else:
        shown = np.flatnonzero(alike)
        points = shown[np.unique(np.linspace(0, shown.size - 1, 400).astype(int))]
        curve = Stroke(stroke.colour, 1.8)
        marks.append(
            Polyline(across[points], value[points], curve, label="Units, sorted by value", layer=MIDDLE, swatch=GREY)
        )
        heights = value
    further, edges = _further(place, row, factor=factor, colour=stroke.colour, confidence=found.confidence)
    marks = [*further[:1], *marks, *further[1:]]
    heights = np.concatenate([heights, edges])
    names = _short(units)
    stars = [(float(w), float(v), names[k]) for k, w, v in zip(order, across, value, strict=True) if units[k] in odd]
    if stars:
        spots = np.array([star[:2] for star in stars])
        marks.append(
            Polyline(spots[:, 0], spots[:, 1], Stroke(BLACK, 0.0, symbol="star"), label="Outlier", layer=FRONT)
        )
    return _Strip(marks, np.concatenate([heights, limits]), stars)


def _dots(
    across: Vector, value: Vector, order: NDArray[np.intp], *, alike: NDArray[np.bool_], colour: str,
    units: Sequence[str],
) -> list[Mark]:  # fmt: skip
    """Return the dots of the units. If there are few units, each has its own symbol and its name in the legend."""
    if len(units) > len(UNIT_SYMBOLS):
        dots = Stroke(colour, 0.0, symbol="circle")
        label = "Unit, with its confidence interval"
        return [Polyline(across[alike], value[alike], stroke=dots, label=label, layer=MIDDLE, swatch=GREY)]
    short = _short(units)
    names = short if len(set(short)) == len(short) else units
    return [
        Polyline(
            across[[i]], value[[i]], Stroke(colour, 0.0, symbol=UNIT_SYMBOLS[k]),
            label=names[k], layer=MIDDLE, swatch=GREY,
        )
        for i, k in enumerate(order) if alike[i]
    ]  # fmt: skip


def _further(
    place: int, row: FleetNumber, *, factor: float, colour: str, confidence: float
) -> tuple[list[Mark], Vector]:
    """Return the marks of the prediction interval and the typical value, and the interval's ends; all may be empty."""
    if row.predicted_low is None or row.predicted_high is None or row.typical is None:
        return [], np.array([])
    ends = place + np.array([-HALF_STRIP, HALF_STRIP])
    low, high = factor * row.predicted_low, factor * row.predicted_high
    label = f"Range of a further unit ({100 * confidence:g} %)"
    band = Band(
        x=ends, lower=np.full(2, low), upper=np.full(2, high), colour=colour, opacity=0.16, label=label, layer=BAND,
        swatch=GREY,
    )  # fmt: skip
    typical = np.full(2, factor * row.typical)
    line = Polyline(ends, typical, stroke=Stroke(BLACK, 0.9, DASHED), label="Typical value", layer=BEHIND)
    return [band, line], np.array([low, high])


def _limit_marks(place: int, sample: ParameterSample, row: FleetNumber, factor: float) -> tuple[list[Mark], Vector]:
    """Return the marks of upper limits and their heights: triangles, or a line over the quantiles of many limits."""
    if row.signed or not np.any(sample.limited):
        return [], np.array([])
    high = np.sort(factor * sample.high[sample.limited])
    width = 0.0
    if high.size > SINGLY:
        high, width = np.quantile(high, (0.05, 0.5, 0.95)), 0.8
    stroke = Stroke(GREY, width, symbol="down", filled=False)
    return [
        Polyline(np.full(high.size, place + HALF_STRIP + 0.05), high, stroke, label="Upper limits", layer=BEHIND)
    ], high


def _height_axis(values: Vector, label: str, *, signed: bool) -> Axis:
    """Return the vertical axis: linear for signed values and for values of similar size, otherwise logarithmic."""
    shown = values[np.isfinite(values)]
    if signed:
        return even_axis(float(shown.min(initial=0.0)), float(shown.max(initial=0.0)), label, margin=0.1, at_most=6)
    shown = shown[shown > 0]
    if not shown.size:
        return value_axis(limits_of(shown), label)
    low, high = float(shown.min()), float(shown.max())
    # Values within a factor of 4 have a linear axis with more ticks (tests/plots/test_plot_limits.py).
    if high < 4.0 * low:
        # Leave room above for the names of outliers.
        return even_axis(low, high, label, margin=0.16, at_most=6)
    room = (high / low) ** 0.16
    return value_axis((low / room, high * room), label)


def _names(stars: Sequence[tuple[float, float, str]], x: Axis, y: Axis) -> tuple[Text, ...]:
    """Return the names of outliers as texts beside their symbols, as long as the texts do not overlap."""
    texts: list[Text] = []
    for across, tall, name in stars:
        low, high = y.limits
        up = (tall - low) / (high - low) if y.linear else math.log(tall / low) / math.log(high / low)
        half = LETTER * (len(name) + 1) / 2
        # The dots of the strip have other heights, and the interval is at the star: the name is beside the star.
        inward = -half if across > round(across) else half
        side = min(1 - half, max(half, (across - x.limits[0]) / (x.limits[1] - x.limits[0]) + inward))
        clear = all(
            abs(up - text.y) > CLEAR or abs(side - text.x) > half + LETTER * len(text.text) / 2 for text in texts
        )
        if len(texts) < NAMED and clear:
            texts.append(Text(name, side, up))
    return tuple(texts)


def _short(units: Sequence[str]) -> list[str]:
    """Return the last letters in which most file names (or folders, if all files have one name) differ.

    >>> _short(["lot2/unit_0005.csv", "a_recording_of_unit_0006.csv"])
    ['unit_0005', '…g_of_unit_0006']
    >>> _short(["unit_1/static.csv", "unit_2/static.csv"])
    ['unit_1', 'unit_2']
    """
    paths = [PurePosixPath(unit) for unit in units]
    names = [path.stem for path in paths]
    if len(set(names)) == 1 < len(names):
        names = [path.parent.name for path in paths]
    return [name if len(name) <= LETTERS else f"…{name[-LETTERS:]}" for name in names]
