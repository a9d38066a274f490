"""Plots over time: one signal, all axes of a recording, or a simulated signal with its latent processes."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.arrays import Integers, Vector, as_rate
from gmwm.base.errors import OptionError
from gmwm.base.text import duration_text
from gmwm.base.units import Quantity, find_unit
from gmwm.measuring.outliers import find_spikes
from gmwm.measuring.variance.transform import Dwt, Modwt
from gmwm.recording.batches import batches
from gmwm.recording.repairs.plan import plans_of
from gmwm.recording.signals import Imu, Signal
from gmwm.showing.plots.axes import elapsed_axis, number_text, quiet, scaled_axis
from gmwm.showing.plots.curves import FRONT
from gmwm.showing.plots.figure import PAGE, Figure, Mark, Panel, Polyline, Stroke, Symbol, drawing
from gmwm.showing.plots.labels import UnitSystem, View, axis_title, model_text, sensor_and_letter, term_label, view_of
from gmwm.showing.plots.style import BLUE, letter_stroke, term_strokes
from gmwm.showing.plots.trace import Outline, even_trace, lone_dots, offset_of, trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gmwm.measuring.inspection import Inspection
    from gmwm.theory.simulation.api import SimulatedSignal

Samples = Mapping[str, Integers]  # numbers of the samples of each finding of one axis

SYMBOLS: dict[str, tuple[str, Symbol]] = {
    "Clipped": ("#b2182b", "triangle"), "Wrong sample": ("#d95f02", "cross"), "Knock": ("#e6ab02", "diamond"),
    "Jump": ("#1b1f24", "square"), "Repeated": ("#6a3d9a", "circle"), "Frozen": ("#1f78b4", "square"),
    "Interpolated": ("#33a02c", "diamond"), "Wrapped": ("#a6761d", "down"), "Rarer level": ("#e7298a", "circle"),
}  # fmt: skip
STROKES = {label: Stroke(colour, 0.0, symbol=symbol) for label, (colour, symbol) in SYMBOLS.items()}
"""Symbols of the findings."""
_MOST, _AVERAGED = 300, 16
"""Largest number of symbols of one finding, and number of samples whose mean is at one of two levels."""


def samples_of_findings(imu: Imu, inspection: Inspection) -> dict[str, Samples]:
    """Return the samples of each finding by axis, evenly thinned."""
    findings: dict[str, dict[str, Integers]] = {axis: {} for axis in imu}
    clipped = {str(remark.subject) for remark in inspection.remarks if remark.code == "output-clipped"}
    for axis, signal in imu.signals.items():
        values = signal.values
        if axis in clipped:
            findings[axis]["Clipped"] = np.flatnonzero((values == values.max()) | (values == values.min()))
        findings[axis]["Wrong sample"] = find_spikes(signal).indices
        times = [step.time for step in inspection.steps if step.axis == axis]
        findings[axis]["Jump"] = _nearest(imu, axis, times)
        # A knock of one sample is a wrong sample.
        knocks = [
            knock.time + 0.5 * knock.duration
            for knock in inspection.knocks
            if axis in knock.axes and knock.duration > 0
        ]
        findings[axis]["Knock"] = _nearest(imu, axis, knocks)
    base = imu.time_base
    begins = np.array([first for first, _ in imu[next(iter(imu))].segments])
    for plan in plans_of(next(batches(imu)), 0.0 if base is None else base.duplicates / max(len(imu), 1)):
        masks = plan.left_out({axis: imu[axis].values for axis in plan.axes}, begins)
        for axis in plan.axes:
            values = imu[axis].values
            for name, mask in masks.items():
                findings[axis][name.capitalize()] = np.flatnonzero(mask)
            if axis in plan.wraps:
                findings[axis]["Wrapped"] = np.flatnonzero(plan.unwrapped(axis, values) != values)
            if axis in plan.levels:
                means = np.convolve(values - np.median(values), np.full(_AVERAGED, 1 / _AVERAGED), "same")
                findings[axis]["Rarer level"] = np.flatnonzero(np.abs(means) > 0.5 * plan.levels[axis].size)
    return {
        axis: {label: _thinned(samples) for label, samples in of_axis.items() if samples.size}
        for axis, of_axis in findings.items()
    }


def _thinned(samples: Integers) -> Integers:
    return samples[np.unique(np.linspace(0, samples.size - 1, min(samples.size, _MOST)).astype(np.int64))]


def _nearest(imu: Imu, axis: str, times: list[float]) -> Integers:
    """Return the samples nearest to times (s) since the first sample of the file."""
    signal = imu[axis]
    if not times:
        return np.empty(0, dtype=np.int64)
    beginning = imu.time_base.left if imu.time_base else 0.0
    since = signal.times(np.arange(len(signal))) - signal.times(np.array([0]))[0] + beginning
    return np.clip(np.searchsorted(since, times), 0, len(signal) - 1)


DOTS_OF_MM = 15.0
"""Horizontal resolution to which long signals are reduced (columns of dots per millimetre), about 400 per inch."""
LINE_WIDTH_PT = 0.5  # width of the line through a long signal (points)
CLIPPED = "#1b1f24"
"""Colour of the symbols that mark clipped samples."""
NAMES: dict[Quantity, str] = {"gyro": "Angular rate", "accel": "Specific force"}


def signal_panel(signal: Signal, *, units: UnitSystem = "si", width: float = PAGE) -> Panel:
    """Return the panel that `plot_signal` draws."""
    shown = view_of(signal.unit, "allan", units)
    samples = trace(signal, shown.factor, round(DOTS_OF_MM * width))
    mean = offset_of(samples)
    title = _without_mean(axis_title(signal.axis), mean, shown.unit)
    return _panels([_SignalRow(samples.less(mean), _stroke(signal.axis), title)], shown, quantity_name(signal.unit))[0]


def _sensor_panels(
    imu: Imu, axes: Sequence[str], units: UnitSystem, width: float, *, findings: Mapping[str, Samples]
) -> list[Panel]:
    """Return the panels of the axes of a sensor, with a common vertical scale if their spans are similar."""
    panels: dict[str, Panel] = {}
    for unit in dict.fromkeys(imu[axis].unit for axis in axes):
        members = [axis for axis in axes if imu[axis].unit == unit]
        shown = view_of(unit, "allan", units)
        begin = imu.time_base.left if imu.time_base else 0.0
        rows = []
        for axis in members:
            samples = trace(imu[axis], shown.factor, round(DOTS_OF_MM * width), begin, clip=True)
            mean = offset_of(samples)
            title = _without_mean(axis_title(axis), mean, shown.unit)
            points = {
                label: (imu[axis].times(index) - imu[axis].times([0]) + begin, shown.factor * imu[axis].values[index])
                for label, index in findings.get(axis, {}).items()
            }
            marked = {
                label: (seconds, np.clip(y, samples.low, samples.high) - mean) for label, (seconds, y) in points.items()
            }
            rows.append(_SignalRow(samples.less(mean), _stroke(axis), title, marked))
        panels |= dict(zip(members, _panels(rows, shown, quantity_name(unit)), strict=True))
    return [panels[axis] for axis in axes]


@dataclass(frozen=True, eq=False)
class _SignalRow:
    trace: Outline
    stroke: Stroke
    title: str
    marked: Mapping[str, tuple[Vector, Vector]] = field(default_factory=dict)
    """Times (s) and values of the samples of each finding."""


def _panels(rows: Sequence[_SignalRow], shown: View, name: str = "") -> list[Panel]:
    """Return panels over the same time with a common vertical scale, or at least power of ten."""
    first, last = (float(end([end(row.trace.seconds) for row in rows])) for end in (np.min, np.max))
    x, size = elapsed_axis(first, last, last - first)
    spans = [row.trace.span for row in rows]
    sizes = [max(abs(row.trace.low), abs(row.trace.high)) for row in rows]
    # Ratio of the largest values up to which panels share a power of ten (tests/plots/test_plot_limits.py).
    one_power = max(sizes) <= 1e3 * min(sizes)
    # On a common scale, a signal with a span below 1/8 would look constant (tests/plots/test_plot_series.py).
    one_scale = max(spans) <= 8.0 * min(spans)
    low, high = min(row.trace.low for row in rows), max(row.trace.high for row in rows)
    panels = []
    for row, largest in zip(rows, sizes, strict=True):
        ends = (low, high) if one_scale else (row.trace.low, row.trace.high)
        y, scale = scaled_axis(*ends, max(sizes) if one_power else largest, name=name, unit=shown.unit)
        panels.append(Panel(x, y, _marks(row, size, scale), row.title))
    return panels


def _marks(row: _SignalRow, size: float, scale: float) -> tuple[Mark, ...]:
    """Return the line of a signal, and symbols for clipped samples and for single samples between two gaps."""
    x, y = row.trace.seconds / size, row.trace.y / scale
    # Each of at most 60 samples has a symbol (tests/plots/test_plot_limits.py).
    stroke = row.stroke if x.size > 60 else replace(row.stroke, width=0.8, symbol="circle")
    symbols: tuple[Symbol, Symbol] = ("triangle", "down")
    beyond = [
        Polyline(x[mask], y[mask], stroke=Stroke(CLIPPED, 0.0, symbol=symbol), label="Beyond the limits", layer=FRONT)
        for mask, symbol in zip(row.trace.beyond(), symbols, strict=True)
        if np.any(mask)
    ]
    dots = () if stroke.symbol else lone_dots(x, y, stroke.colour, FRONT)
    marked = [
        Polyline(seconds / size, values / scale, stroke=STROKES[label], label=label, layer=FRONT)
        for label, (seconds, values) in row.marked.items()
    ]
    return Polyline(x, y, stroke=stroke, layer=FRONT), *beyond, *dots, *marked


def _stroke(axis: str) -> Stroke:
    letter = letter_stroke(sensor_and_letter(axis)[1])
    return Stroke(letter.colour if letter else BLUE, LINE_WIDTH_PT)


def _without_mean(title: str, mean: float, unit: str) -> str:
    """Return the title with the mean that was subtracted from the signal; unchanged if the mean is 0."""
    return f"{title} less its mean of {number_text(mean, 6)} {unit}".strip() if mean else title


def quantity_name(unit: str) -> str:
    """Return the name of the quantity that is measured in a unit, for the label of an axis."""
    definition = find_unit(unit)
    return NAMES[definition.quantity] if definition else "Signal"


def row_height(rows: int, usual: float) -> float:
    """Return the height of a row (mm), readable from 20 mm up to `usual`, so that all fit on a printed page."""
    return max(min(usual, 235.0 / rows), 20.0)


def time_once(rows: Sequence[tuple[Panel | None, ...]]) -> tuple[tuple[Panel | None, ...], ...]:
    """Return the panels with labels of the time axis only at the lowest panel of each column."""
    lowest = {k: i for i, row in enumerate(rows) for k, panel in enumerate(row) if panel is not None}
    return tuple(
        tuple(
            panel if panel is None or lowest[k] == i else replace(panel, x=quiet(panel.x))
            for k, panel in enumerate(row)
        )
        for i, row in enumerate(rows)
    )


@drawing
def plot_signal(
    signal: Signal, *, units: UnitSystem = "si", ax: Axes | None = None, path: str | os.PathLike[str] | None = None
) -> Figure:
    """Draw the signal over time, with its line broken where samples are missing.

    If the samples are far from zero, their mean is subtracted, and the title states it."""
    return Figure(((signal_panel(signal, units=units),),), width=PAGE, height=62.0)


@drawing
def plot_recording(
    imu: Imu, *, units: UnitSystem = "si", inspection: Inspection | None = None,
    path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw all axes over time, gyroscopes next to accelerometers, with lines broken where samples are missing.

    If the samples of an axis are far from zero, as with gravity, their mean is subtracted, and the title states it.
    The axes of a sensor have the same scale, unless a curve would be flat. Symbols mark up to 300 samples of each
    finding of an `inspection` of the recording, such as clipped, repeated or wrapped samples, knocks and jumps."""
    findings = {} if inspection is None else samples_of_findings(imu, inspection)
    places = {axis: sensor_and_letter(axis) for axis in imu}
    named = all(sensor for sensor, _ in places.values())
    sensors = list(dict.fromkeys(sensor for sensor, _ in places.values())) if named else [""]
    columns: list[dict[str, Panel]] = []
    for sensor in sensors:
        members = [axis for axis, place in places.items() if place[0] == sensor or not named]
        columns.append(
            dict(zip(members, _sensor_panels(imu, members, units, PAGE / len(sensors), findings=findings), strict=True))
        )
    letters = sorted({letter for _, letter in places.values()}) if named else []
    rows: list[tuple[Panel | None, ...]] = [
        tuple(column.get(f"{sensor}_{letter}") for sensor, column in zip(sensors, columns, strict=True))
        for letter in letters
    ] or [(panel,) for panel in columns[0].values()]
    labels = len({label for of_axis in findings.values() for label in of_axis})
    height = 12.0 + row_height(len(rows), 44.0) * len(rows) + 5.0 * math.ceil(labels / 5)
    return Figure(time_once(rows), width=PAGE, height=height, legend_columns=5)


@drawing
def plot_components(
    simulated: SimulatedSignal, *, units: UnitSystem = "si", path: str | os.PathLike[str] | None = None
) -> Figure:
    """Draw the simulated signal over time and, below it, each latent process.

    Gravity is subtracted from the signal, and the title states it. All panels have the same scale, unless a curve
    would be flat."""
    signal, model = simulated.signal, simulated.model
    shown = view_of(signal.unit, "allan", units)
    columns = round(DOTS_OF_MM * PAGE)
    offset = shown.factor * simulated.offset
    name = axis_title(signal.axis) if signal.axis else "Signal"
    less = f" less {number_text(offset, 6)} {shown.unit}".rstrip() if offset else ""
    step = simulated.resolution
    steps = f", in steps of {number_text(shown.factor * step)} {shown.unit}".rstrip() if step else ""
    title = f"{name}{less}: {model_text(model.terms)}{steps}"
    rows = [_SignalRow(trace(signal, shown.factor, columns).less(offset), Stroke(BLUE, LINE_WIDTH_PT), title)]
    strokes = term_strokes(model.terms, model.processes)
    for term, process in model.by_term.items():
        outline, stroke = trace(simulated[term], shown.factor, columns), Stroke(strokes[term].colour, LINE_WIDTH_PT)
        rows.append(_SignalRow(outline, stroke, term_label(term, process, shown, signal.rate)))
    panels = _panels(rows, shown)
    stacked = time_once([(panel,) for panel in panels])
    return Figure(stacked, width=PAGE, height=12.0 + row_height(len(rows), 34.0) * len(rows))


def _panel(transform: Modwt | Dwt, level: int, rate: float, unit: str) -> Panel:
    """Return the panel of one level, with each coefficient at the middle of the samples on which it depends."""
    inside = transform.interior[level]
    step = 1 if isinstance(transform, Modwt) else 1 << level
    values = even_trace(np.asarray(transform.details[level][inside]), rate / step, 1.0, round(DOTS_OF_MM * PAGE))
    last = step * (inside.start + 1) - 1
    seconds = values.seconds + (last - (transform.filter.width(level) - 1) / 2) / rate
    duration = transform.samples / rate
    x, size = elapsed_axis(0.0, duration, duration, at_most=8)
    y, scale = scaled_axis(
        values.low, values.high, max(abs(values.low), abs(values.high)), name="Coefficient", unit=unit
    )
    stroke = Stroke(BLUE, LINE_WIDTH_PT, symbol="circle" if values.y.size < 200 else None)
    line = Polyline(seconds / size, values.y / scale, stroke=stroke, layer=FRONT)
    return Panel(x, y, (line,), f"Level {level}, scale {duration_text((1 << level) / rate)}")


@drawing
def plot_coefficients(
    transform: Modwt | Dwt, rate: float, *, unit: str = "", levels: Iterable[int] | None = None,
    path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw wavelet coefficients over time, with a panel for each level, without those affected by the boundaries.

    Parameters
    ----------
    transform : Modwt or Dwt
        Result of `gmwm.variance.modwt` or `gmwm.variance.dwt`.
    rate : float
        Sampling rate of the signal (Hz).
    unit : str
        Unit of the signal, for the labels.
    levels : sequence of int, optional
        Levels to draw. Default: all levels with coefficients that the boundaries do not affect.

    Raises
    ------
    OptionError
        If a level has no such coefficients, or the rate is not a positive number.

    Examples
    --------
    >>> from gmwm.simulation import example_recording
    >>> from gmwm.variance import modwt
    >>> signal = example_recording()["gyro_y"]
    >>> figure = plot_coefficients(modwt(signal, levels=8), signal.rate, unit=signal.unit, levels=[1, 4, 8])
    >>> len(figure.axes)
    3
    """
    rate = as_rate(rate)
    shown = [j for j in transform.details if transform.interior[j].start < transform.interior[j].stop]
    chosen = shown if levels is None else sorted(set(levels))
    if not chosen or not set(chosen) <= set(shown):
        raise OptionError(argument="levels", expected=f"some of {shown[0]} to {shown[-1]}", got=levels)
    rows = [(_panel(transform, level, rate, unit),) for level in chosen]
    return Figure(time_once(rows), width=PAGE, height=12.0 + row_height(len(rows), 34.0) * len(rows))
