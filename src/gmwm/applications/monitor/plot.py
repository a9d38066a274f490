"""Plots of a monitor and of the consistency of a filter, and the summary of a monitor as an HTML page."""

from __future__ import annotations

import base64
import io
import os
from collections.abc import Sequence
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np

from gmwm.applications.monitor import Event, Trace
from gmwm.applications.monitor.axis import SHOWN
from gmwm.applications.monitor.consistency import AxisConsistency, Consistency
from gmwm.base.atomic_files import write_text
from gmwm.base.errors import DataError, OptionError
from gmwm.base.text import duration_text, version
from gmwm.base.units import AXES, SI_UNIT, axis_quantity
from gmwm.choosing.datasheets.effective import TRUE_CLAIM
from gmwm.showing.plots.axes import even_axis, limits_of, quiet, time_axis, time_unit, value_axis
from gmwm.showing.plots.figure import PAGE, Axis, Band, Figure, Mark, Panel, Polyline, Stroke, Text, drawing
from gmwm.showing.plots.imu import grid_figure
from gmwm.showing.plots.labels import UnitSystem, axis_title, view_of
from gmwm.showing.plots.style import BLUE, DASHED, GREEN, GREY, IMPLIED, OBSERVED, ORANGE, PURPLE, VERMILLION

_CHARTS = {"noise up": ("Noise up", ORANGE), "noise down": ("Noise down", GREEN), "level": ("Level", PURPLE)}


def _signal(trace: Trace, axis: str, events: Sequence[Event], *, x: Axis, scale: tuple[float, float]) -> Panel:
    times, extremes = trace.signal(axis)
    first, size = scale
    si = SI_UNIT[axis_quantity(axis)] if axis in AXES else ""
    unit, factor = SHOWN.get(si, (si, 1.0))
    low, high = factor * extremes[:, 0], factor * extremes[:, 1]
    middle = float(np.median(0.5 * (low + high)))
    low, high = low - middle, high - middle
    y = even_axis(float(low.min()), float(high.max()), unit, margin=0.1, at_most=4)
    marks: list[Mark] = [Band((times - first) / size, low, high, BLUE, opacity=0.8, label="Signal less its median")]
    if events:
        # One interrupted curve of vertical lines.
        at = np.repeat((np.array([event.time for event in events]) - first) / size, 3)
        height = np.tile(np.array([*y.limits, np.nan]), len(events))
        marks.append(Polyline(at, height, Stroke(VERMILLION, 1.0), label="Event", layer=2))
    return Panel(x, y, tuple(marks), axis_title(axis))


def _charts(trace: Trace, axis: str, *, x: Axis, scale: tuple[float, float]) -> Panel:
    times, heights = trace.heights(axis)
    first, size = scale
    # Values above 1.1 are drawn at 1.1, because the threshold is 1.
    marks: list[Mark] = [
        Polyline((times - first) / size, np.minimum(heights[family], 1.1), Stroke(colour, 0.9), label=label)
        for family, (label, colour) in _CHARTS.items()
    ]
    ends = np.array(x.limits)
    marks.append(Polyline(ends, np.ones(2), Stroke(VERMILLION, 0.9, DASHED), label="Threshold"))
    return Panel(x, even_axis(0.0, 1.1, "", margin=0.0, at_most=4), tuple(marks), "Charts (threshold: 1)")


@drawing
def plot_trace(trace: Trace, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Draw the signals with the events, and the chart statistics over time.

    Raises
    ------
    DataError
        If there are no samples.
    OptionError
        If the ending of `path` is unknown.
    """
    axes = trace.monitor.axes
    times = [trace.signal(axis)[0] for axis in axes]
    if not times[0].size:
        raise DataError("the monitor has no samples to draw", advice="Pass samples to the trace first.")
    first, last = float(times[0][0]), float(times[0][-1])
    unit, size = time_unit(max(last - first, 1.0 / trace.monitor.rate))
    rows = []
    # The time of the first sample may be seconds since 1970, or after the start of the recording.
    label = f"Time since the first sample{f', at {first:.10g} s' if first else ''} ({unit})"
    for axis in axes:
        below = axis == axes[-1]
        x = even_axis(0.0, max(last - first, 1e-9) / size, label, margin=0.01, at_most=6)
        x = x if below else quiet(x)
        events = [event for event in trace.events if event.axis in (axis, "")]
        scale = (first, size)
        rows.append((_signal(trace, axis, events, x=x, scale=scale), _charts(trace, axis, x=x, scale=scale)))
    return Figure(tuple(rows), width=PAGE, height=18.0 + 30.0 * len(rows), legend_columns=3)


def _panel(axis: AxisConsistency, level: float, units: UnitSystem) -> Panel:
    view = view_of(axis.unit, "allan", units)
    times, claimed, real, low, high = np.array(
        [[error.horizon, error.claimed, error.real, error.low, error.high] for error in axis.curve]
    ).T
    claimed, real = view.factor * claimed, view.factor * real
    least, most = TRUE_CLAIM
    marks: list[Mark] = [
        Band(times, claimed / most, claimed / least, GREY, label=f"Claim of {least:g} to {most:g} times the error"),
        Band(times, claimed / high, claimed / low, BLUE, label=f"{100 * level:g} % interval of the error", layer=1),
        Polyline(times, claimed, IMPLIED, label="Claimed error", layer=2),
        Polyline(times, real, OBSERVED, label="Real error", layer=3),
    ]
    y = value_axis(limits_of(np.concatenate([claimed, real])), f"Error of the mean ({view.unit or 'unit of the data'})")
    at = ", ".join(duration_text(error.horizon) for error in axis.errors if error.verdict == axis.verdict)
    text = Text(f"{axis.verdict} at {at}", 0.5, 0.94)
    return Panel(time_axis(times, "Horizon (s)"), y, tuple(marks), texts=(text,))


@drawing
def plot_consistency(
    result: Consistency, *, units: UnitSystem = "auto", path: str | os.PathLike[str] | None = None
) -> Figure:
    """Draw the claimed and the real error of the mean over the next T seconds against T, a panel for each axis."""
    return grid_figure({axis: _panel(each, result.level, units) for axis, each in result.items()})


def monitor_data(trace: Trace) -> dict[str, Any]:
    """Return the content of the page, without the plot, as plain data."""
    monitor = trace.monitor
    rows = [["Time (s)", "Began (s)", "Axis", "Kind", "Event"]]
    rows += [
        [f"{event.time:.2f}", f"{event.began:.2f}", event.axis or "unit", event.kind, event.description]
        for event in trace.events
    ]
    facts = [
        *([("Source", PureWindowsPath(trace.source).name)] if trace.source else []), ("Axes", ", ".join(monitor.axes)),
        ("Duration", duration_text(monitor.samples / monitor.rate)), ("Samples", str(monitor.samples)),
        ("Sampling rate", f"{monitor.rate:g} Hz"), ("Time between false alarms", duration_text(monitor.every)),
        ("Baseline", ", ".join(monitor.baselines) or "none: the models alone"),
    ]  # fmt: skip
    models = [["Axis", "Model"], *([axis, model.structure] for axis, model in monitor.models.items())]
    return {
        "title": "Monitor of a sensor at rest", "gmwm": version(), "state": "bad" if trace.events else "good",
        "headline": trace.summary(), "facts": facts, "rows": rows, "models": models,
    }  # fmt: skip


def monitor_report(trace: Trace, path: str | os.PathLike[str]) -> Path:
    """Write the summary of a monitor as HTML. `Trace.report` describes the arguments."""
    file = Path(path)
    if file.suffix.lower() not in (".html", ".htm"):
        raise OptionError(argument="path", expected="a file name that ends in .html", got=str(path))
    write_text(file, page(trace))
    return file


def page(trace: Trace) -> str:
    """Return the summary as HTML, which includes the plot."""
    from gmwm.showing.reports.write import part, template  # imports most of gmwm, which plots do not need

    buffer = io.BytesIO()
    trace.plot().savefig(buffer, format="png", dpi=120)
    html: str = template("monitor.html").render(
        **monitor_data(trace),
        policy="default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'",
        style=part("page/report.css"), picture=base64.b64encode(buffer.getvalue()).decode(),
    )  # fmt: skip
    return html
