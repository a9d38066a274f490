"""Plots of all axes of an inertial unit, with a panel for each axis or for each sensor."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

from gmwm.base.errors import OptionError
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.axis_results import ResultsByAxis
from gmwm.measuring.variance.clusters import ClusterVariance
from gmwm.showing.plots.axes import quiet, thin_ticks, value_axis
from gmwm.showing.plots.curves import Item, checked_items, overlay_panel, wavelet_variance_of, wavelet_variance_panel
from gmwm.showing.plots.figure import PAGE, Axis, Figure, Mark, Panel, Polyline, Stroke, description, drawing
from gmwm.showing.plots.fit import fit_panel
from gmwm.showing.plots.labels import UnitSystem, ViewName, axis_title, sensor_and_letter, sensor_title
from gmwm.showing.plots.style import curve_stroke, letter_stroke

SINGLE_WIDTH_MM = 120.0
"""Width of a plot with a single panel (mm). If it is reduced to a printed column of 85 mm, its text has 5 points."""


@drawing
def plot_imu(
    items: Mapping[str, Item | Mapping[str, Item]], *, split: bool = True, view: ViewName = "auto",
    units: UnitSystem = "auto", path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw all axes of an inertial unit.

    Parameters
    ----------
    items : mapping of axis to WaveletVariance or Fit
        One or more axes named "gyro_x" … "accel_z". A curve with any other name has its own panel. A value may also be
        a mapping from names to curves, which are then drawn in the panel of this axis.
    split : bool
        If True, draw one panel for each axis and one row of panels for each sensor. If False, draw one panel for each
        sensor, in which x, y and z differ in colour (vermillion, green, blue), symbol and dash.

    Raises
    ------
    OptionError
        If an option is unknown, `items` is empty, or `split` is False and an axis has several curves.
    """
    if not isinstance(items, Mapping) or not items:
        checked_items(items)
    axes = {
        name: checked_items(item) if isinstance(item, Mapping) else checked_items({name: item})[name]
        for name, item in items.items()
    }
    if split:
        return _grid(axes, view, units)
    single = {name: item for name, item in axes.items() if not isinstance(item, dict)}
    if len(single) < len(axes):
        raise OptionError(
            "a panel for each sensor can show one curve of each axis only, but an axis has several", argument="split",
            got=split, advice="Use {--split=yes}, or pass one curve for each axis.",
        )  # fmt: skip
    return _by_sensor(single, view, units)


@drawing
def plot_results(
    results: ResultsByAxis[Any], *, units: UnitSystem = "auto", path: str | os.PathLike[str] | None = None
) -> Figure:
    """Draw the results of one function for several axes: fits with a panel for each axis, variances by sensor.

    Parameters
    ----------
    results : mapping of axis to Fit or ClusterVariance
        Results of one kind by the name of their axis.

    Raises
    ------
    OptionError
        If the results are of another kind, such as rankings, which are drawn one by one.

    Examples
    --------
    >>> import gmwm
    >>> imu = gmwm.simulate({"gyro_x": "WN(sigma2=4e-8)", "gyro_y": "WN(sigma2=9e-8)"}, rate=100.0, duration=9.0, rng=1)
    >>> figure = gmwm.plots.plot_results(gmwm.allan_variance(imu))
    """
    from gmwm.showing.plots.allan import plot_allan_axes

    curves = {axis: result for axis, result in results.items() if isinstance(result, ClusterVariance)}
    if curves:
        return description(plot_allan_axes)(curves, units=units, guides=True)
    if any(not hasattr(result, "implied") for result in results.values()):
        raise OptionError(
            f"the results of {', '.join(results)} have no plot together", argument="results", got=results,
            advice="Draw one of them, as in `results[axis].plot()`.",
        )  # fmt: skip
    return description(plot_imu)(results, units=units)


def _grid(items: Mapping[str, Item | dict[str, Item]], view: ViewName, units: UnitSystem) -> Figure:
    labels = dict.fromkeys(label for item in items.values() if isinstance(item, dict) for label in item)
    curves = {label: curve_stroke(k) for k, label in enumerate(labels)}
    panels = {}
    for name, item in items.items():
        if isinstance(item, dict):
            chosen = [curves[label] for label in item]
            panels[name] = overlay_panel(item, view=view, units=units, strokes=chosen)
        elif hasattr(item, "implied"):
            panels[name] = fit_panel(cast("Fit", item), view=view, units=units, alone=False)
        else:
            panels[name] = wavelet_variance_panel(wavelet_variance_of(item), view=view, units=units)
    return grid_figure(_join_entries(panels))


def grid_figure(panels: Mapping[str, Panel]) -> Figure:
    """Return a figure with a panel for each axis, one row for each sensor, and common scales."""
    # Axes without their warm-up are shorter. The scales of the longest one line up all panels.
    axes = [panel.x for panel in panels.values()]
    low, high = min(x.limits[0] for x in axes), max(x.limits[1] for x in axes)
    longest = next((x for x in axes if x.limits == (low, high)), None)
    if longest is not None and len({x.label for x in axes}) == 1:
        panels = {name: replace(panel, x=longest) for name, panel in panels.items()}
    rows = _arrange({name: replace(panel, title=axis_title(name)) for name, panel in panels.items()})
    columns = len(rows[0])
    if columns > 1:
        rows = [tuple(panel and _sparse(panel) for panel in row) for row in rows]
    drawn = Figure(
        _share_labels([_one_scale(row) for row in rows]), width=max(PAGE * columns / 3, SINGLE_WIDTH_MM),
        height=16.0 + 56.0 * len(rows), legend_columns=6,
    )  # fmt: skip
    return _with_room(drawn, entries=2 * drawn.legend_columns)


def _join_entries(panels: Mapping[str, Panel]) -> dict[str, Panel]:
    """Return the panels with one common legend entry for lines with the same stroke, such as "GM, GM[1]"."""
    entries: dict[Stroke, dict[str, None]] = {}
    lines = [mark for panel in panels.values() for mark in panel.marks if isinstance(mark, Polyline) and mark.label]
    for line in lines:
        entries.setdefault(line.stroke, {})[line.label] = None

    def rename(mark: Mark) -> Mark:
        if not isinstance(mark, Polyline) or not mark.label:
            return mark
        return replace(mark, label=", ".join(sorted(entries[mark.stroke])))

    return {name: replace(panel, marks=tuple(map(rename, panel.marks))) for name, panel in panels.items()}


def _with_room(drawn: Figure, entries: int) -> Figure:
    """Return the figure with more height if its legend has more than `entries` entries."""
    more = -(-max(len(drawn.labels) - entries, 0) // drawn.legend_columns)
    return replace(drawn, height=drawn.height + 4.0 * more)


def _by_sensor(items: Mapping[str, Item], view: ViewName, units: UnitSystem) -> Figure:
    sensors: dict[str, dict[str, Item]] = {}
    for name, item in items.items():
        sensor, letter = sensor_and_letter(name)
        sensors.setdefault(sensor or name, {})[letter.upper() or name] = item
    panels = []
    for sensor, members in sensors.items():
        strokes = [letter_stroke(name.lower()) or curve_stroke(k) for k, name in enumerate(members)]
        title = sensor_title(sensor) if sensor not in members else sensor
        panels.append(overlay_panel(members, view=view, units=units, strokes=strokes, title=title))
    rows: list[tuple[Panel | None, ...]] = [tuple(panels[k : k + 2]) for k in range(0, len(panels), 2)]
    if len(rows) > 1 and len(panels) % 2:
        rows[-1] = (*rows[-1], None)
    width = PAGE if len(panels) > 1 else SINGLE_WIDTH_MM
    drawn = Figure(tuple(rows), width=width, height=10.0 + 74.0 * len(rows), legend_columns=7)
    return _with_room(drawn, entries=drawn.legend_columns)


def _arrange(panels: Mapping[str, Panel]) -> list[tuple[Panel | None, ...]]:
    """Arrange panels in rows of sensors and columns of letters, or in rows of three if a name is no axis."""
    places = {name: sensor_and_letter(name) for name in panels}
    if all(sensor for sensor, _ in places.values()):
        letters = sorted({letter for _, letter in places.values()})
        sensors = dict.fromkeys(sensor for sensor, _ in places.values())
        return [tuple(panels.get(f"{sensor}_{letter}") for letter in letters) for sensor in sensors]
    everything = list(panels.values())
    width = min(3, len(everything))
    padded = [*everything, *[None] * (-len(everything) % width)]
    return [tuple(padded[k : k + width]) for k in range(0, len(padded), width)]


def _one_scale(row: tuple[Panel | None, ...]) -> tuple[Panel | None, ...]:
    """Return a row of panels with a common vertical scale, if all of them show the same quantity."""
    present = [panel for panel in row if panel is not None and panel.y.ticks]
    if len({panel.y.label for panel in present}) != 1:
        return row
    low = min(panel.y.limits[0] for panel in present)
    high = max(panel.y.limits[1] for panel in present)
    axis = value_axis((low, high), present[0].y.label)
    return tuple(replace(panel, y=axis) if panel in present else panel for panel in row)


def _share_labels(rows: Sequence[tuple[Panel | None, ...]]) -> tuple[tuple[Panel | None, ...], ...]:
    """Return rows without repeated labels: common vertical scales at the left, common times below."""
    result: list[tuple[Panel | None, ...]] = []
    for i, row in enumerate(rows):
        done: list[Panel | None] = []
        for k, panel in enumerate(row):
            if panel is None:
                done.append(None)
                continue
            neighbour = next((p for p in row[:k] if p is not None), None)
            above = next((upper[k] for upper in rows[:i] if upper[k] is not None), None)
            below = next((lower[k] for lower in rows[i + 1 :] if lower[k] is not None), None)
            y = quiet(panel.y) if neighbour is not None and _same(neighbour.y, panel.y) else panel.y
            x = quiet(panel.x) if below is not None and _same(below.x, panel.x) else panel.x
            if above is not None and _same(above.x, panel.x):
                x = replace(x, opposite=())
            done.append(replace(panel, x=x, y=y))
        result.append(tuple(done))
    return tuple(result)


def _sparse(panel: Panel) -> Panel:
    """Return the panel with fewer ticks at its upper side, because it is narrow."""
    return replace(panel, x=replace(panel.x, opposite=thin_ticks(panel.x.opposite, panel.x.limits, 0.2)))


def _same(one: Axis, other: Axis) -> bool:
    return one.label == other.label and one.limits == other.limits
