"""Plots of the Allan deviation and its variants over averaging time, with slope guides and fitted lines."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.errors import OptionError
from gmwm.measuring.variance.allan_regression import AllanRegression, Term, coefficient_unit
from gmwm.measuring.variance.clusters import ClusterVariance
from gmwm.showing.plots.axes import number_text, value_axis
from gmwm.showing.plots.curves import BAND, BEHIND, FRONT, MIDDLE, band_edges, closed_panel, curves_then_bands
from gmwm.showing.plots.figure import (
    Axis,
    Band,
    Figure,
    Mark,
    Panel,
    Polyline,
    Stroke,
    Symbol,
    Text,
    drawable,
    drawing,
    single_panel,
)
from gmwm.showing.plots.imu import grid_figure
from gmwm.showing.plots.labels import UnitSystem, View, axis_title, sensor_and_letter, sensor_title, view_of
from gmwm.showing.plots.style import DASHED, GREY, OBSERVED, curve_stroke, letter_stroke, term_stroke

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gmwm.measuring.variance.result import WaveletVariance

SLOPES = (("+1", 1.0), ("+½", 0.5), ("0", 0.0), ("−½", -0.5), ("−1", -1.0))
"""Labels and values of the log-log slopes that noise processes have in an Allan deviation."""
SYMBOLS: dict[Term, Symbol] = {"Q": "square", "N": "circle", "B": "triangle", "K": "star", "R": "diamond"}
"""Symbols that mark where the coefficients are read from the fitted lines: N at 1 s, B at the minimum, K at 3 s."""
# Width, largest height and distance from the border of the slope guides in a corner, as fractions of the panel.
FAN_WIDTH, FAN_HEIGHT, FAN_MARGIN = 0.13, 0.16, 0.05


@dataclass(frozen=True)
class ClusterView(View):
    """View that shows the square root of an Allan-type variance over the averaging time."""

    title: str = "Allan deviation"

    def time(self, tau: Vector) -> Vector:
        """Return the averaging times τ (s) unchanged, as horizontal positions."""
        return tau

    def height(self, variance: Vector) -> Vector:
        """Return the deviation for a variance, in the unit of the plot."""
        return np.asarray(self.factor * np.sqrt(np.maximum(variance, 0.0)))

    @property
    def height_label(self) -> str:
        """Label of the vertical axis."""
        return f"{self.title} ({self.unit or 'unit of the data'})"


def cluster_view(curve: ClusterVariance, units: UnitSystem) -> ClusterView:
    """Return the view of an Allan-type variance in SI or datasheet units."""
    shown = view_of(curve.unit, "allan", units)
    return ClusterView(shown.name, shown.unit, shown.factor, curve.title)


def allan_panel(
    curves: Mapping[str, ClusterVariance], *, units: UnitSystem = "auto", guides: bool = True, title: str = ""
) -> Panel:
    """Return a panel with deviations of the same quantity and unit, and their confidence bands. The legend shows the
    names of several curves. With `guides`, the panel has guides for the slopes of noise processes."""
    views = [cluster_view(curve, units) for curve in curves.values()]
    if len({(view.unit, view.title) for view in views}) > 1:
        labels = ", ".join(f"{name}: {view.height_label}" for name, view in zip(curves, views, strict=True))
        raise OptionError(
            f"curves in one panel need the same quantity and unit, but they are {labels}", argument="curves",
            got=tuple(view.height_label for view in views), advice="Plot each quantity in its own figure.",
        )  # fmt: skip
    strokes = [OBSERVED] if len(curves) == 1 else [_stroke(name, k) for k, name in enumerate(curves)]
    marks: list[Mark] = []
    for (name, curve), view, stroke in zip(curves.items(), views, strokes, strict=True):
        opacity = 0.22 if len(curves) == 1 else 0.15
        x, y = view.time(curve.tau), drawable(view.height(curve.variance))
        lower, upper = band_edges(cast("WaveletVariance", curve), view)
        # If a curve has many points, symbols at all of them would hide the curve and its band.
        shown = stroke if len(curve) <= 60 else replace(stroke, symbol=None, dash=())
        limits = f"{100 * curve.confidence:g} % limits, identified noise"
        marks += [
            Polyline(x, y, stroke=shown, label=name, layer=FRONT),
            Band(x, lower, upper, stroke.colour, opacity=opacity, label=limits, layer=BAND),
        ]
    marks = curves_then_bands(marks, len(curves))
    # `closed_panel` uses only tau, the variance and its limits. A ClusterVariance has these attributes too.
    measured = cast("Sequence[WaveletVariance]", list(curves.values()))
    names = [""] if len(curves) == 1 else list(curves)
    panel = closed_panel(views, measured, marks, strokes=strokes, names=names, title=title)
    return with_guides(panel) if guides else panel


def _stroke(name: str, index: int) -> Stroke:
    """Return the stroke of the letter of a name such as "gyro_x" or "x", or stroke number `index` for another name."""
    letter = sensor_and_letter(name)[1] or name.lower()
    return letter_stroke(letter) or curve_stroke(index)


def with_guides(panel: Panel) -> Panel:
    """Return the panel with guides for the slopes −1 to +1 in its emptiest corner."""
    if not panel.y.ticks:
        return panel
    wide = math.log10(panel.x.limits[1] / panel.x.limits[0])
    high = math.log10(panel.y.limits[1] / panel.y.limits[0])
    width = min(FAN_WIDTH, FAN_HEIGHT * high / wide)
    steepest = width * wide / high
    start, middle = _emptiest_corner(panel, width, steepest)
    marks: list[Mark] = []
    texts = []
    for label, slope in SLOPES:
        x = np.array([start, start + width])
        y = np.array([middle, middle + slope * steepest])
        position = panel.x.limits[0] * 10 ** (x * wide)
        height = panel.y.limits[0] * 10 ** (y * high)
        marks.append(Polyline(position, height, stroke=Stroke(GREY, 0.7, DASHED), label="", layer=BEHIND))
        texts.append(Text(label, float(x[1]) + 0.034, float(y[1])))
    return replace(panel, marks=(*panel.marks, *marks), texts=(*panel.texts, *texts))


def _emptiest_corner(panel: Panel, width: float, height: float) -> tuple[float, float]:
    """Return left and middle of guides in the emptiest corner, in fractions of the panel (`height`: half)."""
    shares = [np.empty((2, 0))]
    for mark in panel.marks:
        for y in (
            (mark.y,) if isinstance(mark, Polyline) else (mark.lower, mark.upper) if isinstance(mark, Band) else ()
        ):
            shares.append(np.array([_share(mark.x, panel.x.limits), _share(y, panel.y.limits)]))
    points = np.concatenate(shares, axis=1)
    best, corner = points.shape[1] + 1, (FAN_MARGIN, FAN_MARGIN + height)
    for start in (FAN_MARGIN, 1 - FAN_MARGIN - width - 0.05):
        for middle in (FAN_MARGIN + height, 1 - FAN_MARGIN - height):
            near = (np.abs(points[0] - start - width / 2) < width) & (np.abs(points[1] - middle) < 1.5 * height)
            count = int(np.count_nonzero(near))
            if count < best:
                best, corner = count, (start, middle)
    return corner


def _share(values: Vector, limits: tuple[float, float]) -> Vector:
    """Return the positions of values on a logarithmic axis, as fractions of its length; NaN for values ≤ 0."""
    return np.asarray(np.log10(drawable(values) / limits[0]) / math.log10(limits[1] / limits[0]))


def avlr_panel(
    regression: AllanRegression, *, units: UnitSystem = "auto", guides: bool = True, alone: bool = True
) -> Panel:
    """Return `plot_avlr`'s panel: deviation, fitted lines, coefficients; these are a text if a legend is shared."""
    curve = regression.allan
    view = cluster_view(curve, units)
    bare = allan_panel({view.title: curve}, units=units, guides=False, title=axis_title(curve.axis))
    # Draw the curve without symbols, because symbols mark the coefficients here.
    marks = [
        replace(mark, stroke=replace(mark.stroke, symbol=None)) if isinstance(mark, Polyline) else mark
        for mark in bare.marks
    ]
    values = []
    y = _axis_with(bare, [view.factor * line.deviation(line.reading_time) for line in regression.lines])
    for line in regression.lines:
        unit, factor = coefficient_unit(line.term, curve.unit, "datasheet" if view.of_datasheets else "si")
        sign = "≤" if line.bound else "="
        text = f"{line.term} {sign} {number_text(factor * line.coefficient)} {unit}"
        values.append(text)
        stroke = replace(term_stroke(list(SYMBOLS).index(line.term)), width=1.1)
        # The line extends by a factor of 5 beyond the averaging times of its fit (tests/plots/test_plot_limits.py).
        tau = np.array([min(line.first, line.reading_time) / 5.0, max(line.last, line.reading_time) * 5.0])
        marks.append(Polyline(tau, view.factor * line.deviation(tau), stroke=stroke, label="", layer=MIDDLE))
        at = np.array([line.reading_time])
        symbol = replace(stroke, width=0.0, symbol=SYMBOLS[line.term])
        height = view.factor * line.deviation(at)
        where = "at the minimum" if line.slope == 0 else f"at τ = {line.reading_time:.3g} s"
        inside = y.limits[0] < height[0] < y.limits[1] and bare.x.limits[0] < at[0] < bare.x.limits[1]
        where += "" if inside else " (outside the axes)"
        label = f"{text}, {where}" if alone else f"Point that gives {line.term}"
        marks.append(Polyline(at, height, stroke=symbol, label=label, layer=FRONT + 1))
    panel = replace(bare, y=y, marks=tuple(marks))
    if not alone:
        return replace(panel, texts=(*panel.texts, Text("\n".join(values), 0.62, 0.97 - 0.045 * len(values))))
    return with_guides(panel) if guides else panel


def _axis_with(panel: Panel, heights: Sequence[Vector]) -> Axis:
    """Return the vertical axis of a panel, extended to include `heights`, but at most by the factor `MOST_ADDED`."""
    low, high = panel.y.limits
    # The point where a coefficient is read extends the axis by 20 at most (tests/plots/test_plot_limits.py).
    points = [float(height) for height in heights if low / 20.0 < height < high * 20.0]
    if all(low < height < high for height in points):
        return panel.y
    return value_axis((min(low, *(0.8 * h for h in points)), max(high, *(1.25 * h for h in points))), panel.y.label)


@drawing
def plot_allan(
    result: ClusterVariance, *, units: UnitSystem = "auto", guides: bool = True, ax: Axes | None = None,
    path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw the deviation over the averaging time, with its confidence band, on logarithmic axes.

    A variance of zero is marked at the lower edge of the plot.

    Parameters
    ----------
    guides : bool
        Whether to draw the slopes −1 (quantization), −½ (white), 0 (bias instability), +½ (random walk) and +1
        (ramp).
    """
    panel = allan_panel({result.title: result}, units=units, guides=guides, title=axis_title(result.axis))
    return single_panel(panel, 84.0)


@drawing
def plot_avlr(
    regression: AllanRegression, *, units: UnitSystem = "auto", guides: bool = True, ax: Axes | None = None,
    path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw the Allan deviation with the fitted lines and the points that give Q, N, B, K and R.

    Parameters
    ----------
    units : "auto", "datasheet" or "si"
        Units of the plot: deg/h and mg with coefficients in units such as deg/√h, or rad/s and m/s². By default
        datasheet units, if the data have a unit of angular rate or acceleration.
    guides : bool
        Whether to draw the slopes −1 (quantization), −½ (white), 0 (bias instability), +½ (random walk) and +1
        (ramp).
    """
    return single_panel(avlr_panel(regression, units=units, guides=guides), 84.0)


@drawing
def plot_allan_axes(
    curves: Mapping[str, ClusterVariance] | Mapping[str, AllanRegression], *, units: UnitSystem = "auto",
    guides: bool = True, path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw the deviations of several axes, with one panel for each sensor. Regressions have one panel for each axis.

    Parameters
    ----------
    curves : mapping of axis name to ClusterVariance or AllanRegression
        Curves by axis, for example {"gyro_x": allan_x, "accel_z": allan_z}. Curves with other names share one panel.
    guides : bool
        As for `plot_allan`.

    Raises
    ------
    OptionError
        If an option is unknown, or the curves of a panel differ in quantity or unit.
    """
    named = dict(curves) if isinstance(curves, Mapping) else {}
    variances = {name: curve for name, curve in named.items() if isinstance(curve, ClusterVariance)}
    regressions = {name: curve for name, curve in named.items() if isinstance(curve, AllanRegression)}
    if not named or len(named) not in (len(variances), len(regressions)):
        raise OptionError(
            argument="curves",
            expected="a mapping of names to ClusterVariance such as {'gyro_x': allan_x, 'gyro_y': allan_y}",
            got=curves,
        )
    if regressions:
        return grid_figure({name: avlr_panel(r, units=units, alone=False) for name, r in regressions.items()})
    sensors: dict[str, dict[str, ClusterVariance]] = {}
    for name, variance in variances.items():
        sensor, letter = sensor_and_letter(name)
        sensors.setdefault(sensor, {})[letter.upper() if sensor else name] = variance
    panels = tuple(
        allan_panel(group, units=units, guides=guides, title=sensor_title(sensor) if sensor else "")
        for sensor, group in sensors.items()
    )
    return Figure((panels,), width=105.0 * len(panels), height=92.0, legend_columns=4)
