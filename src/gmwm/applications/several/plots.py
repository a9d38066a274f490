"""Plots of shared noise, joint fits and virtual sensors."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np

from gmwm.applications.several.fusion_result import VirtualAxis, VirtualSensor
from gmwm.applications.several.joint_fit import JointFit
from gmwm.applications.several.result import CrossCovariance
from gmwm.base.arrays import Vector
from gmwm.showing.plots.axes import limits_of, quiet, signed_axis, time_axis, value_axis
from gmwm.showing.plots.curves import BAND, BEHIND, FRONT, MIDDLE
from gmwm.showing.plots.figure import Axis, Band, Figure, Mark, Panel, Polyline, Stroke, drawing
from gmwm.showing.plots.labels import axis_title, sensor_and_letter
from gmwm.showing.plots.style import BLUE, DASHED, GREY, IMPLIED, OBSERVED, ORANGE, PALE, SOLID

ZERO = Stroke(GREY, 0.8, SOLID)  # correlation zero
UNCERTAIN, SIGNIFICANT = Stroke(BLUE, 0.7, SOLID, "circle", filled=False), Stroke(BLUE, 0.0, SOLID, "circle")
SENSOR, AVERAGE, VIRTUAL = Stroke(PALE, 0.8, SOLID), Stroke(ORANGE, 1.2, DASHED), Stroke(BLUE, 1.4, SOLID)
MEASURED = Stroke(BLUE, 0.0, SOLID, "circle", filled=False)  # virtual sensor in the recording of its weights


def _panel(result: CrossCovariance, a: str, b: str, *, x: Axis, y: Axis, confidence: bool) -> Panel:
    tau, r, p = result.tau, result.correlation[a, b], result.pvalues[a, b]
    significant = p <= result.size
    marks: list[Polyline | Band] = [Polyline(np.array(x.limits), np.zeros(2), stroke=ZERO, label="", layer=BEHIND)]
    if confidence:
        level = f"{100 * result.confidence:g} % limits"
        lower, upper = result.lower[a, b], result.upper[a, b]
        marks.append(Band(tau, lower, upper, colour=BLUE, opacity=0.22, label=level, layer=BAND))
    marks.append(Polyline(tau, np.where(np.isfinite(p), r, np.nan), UNCERTAIN, label="Not significant", layer=FRONT))
    if np.any(significant):
        marks.append(Polyline(tau[significant], r[significant], SIGNIFICANT, label="Shared noise", layer=FRONT))
    return Panel(x, y, tuple(marks), title=_pair(a, b))


def _pair(one: str, other: str) -> str:
    """Return the title of two axes, "Gyroscope X, Y" for axes of one sensor."""
    (sensor, _), (same, letter) = sensor_and_letter(one), sensor_and_letter(other)
    return f"{axis_title(one)}, {letter.upper() if sensor and sensor == same else axis_title(other)}"


def _curves(tau: Vector, data: Vector, model: Vector) -> tuple[Mark, ...]:
    return (
        Polyline(tau, model, stroke=IMPLIED, label="Joint model", layer=MIDDLE),
        Polyline(tau, data, stroke=replace(OBSERVED, width=0.0), label="Data", layer=FRONT),
    )


def _axis_panel(fusion: VirtualAxis) -> Panel:
    tau = fusion.tau
    marks = [
        Polyline(tau, np.sqrt(variance), SENSOR, label="Each sensor" if k == 0 else "", layer=BEHIND)
        for k, variance in enumerate(fusion.each)
    ]
    marks.append(Polyline(tau, np.sqrt(fusion.average), AVERAGE, label="Average", layer=MIDDLE))
    marks.append(Polyline(tau, fusion.deviation, VIRTUAL, label="Virtual sensor, predicted", layer=FRONT))
    marks.append(
        Polyline(tau, np.sqrt(fusion.measured), MEASURED, label="Virtual sensor, in this recording", layer=FRONT)
    )
    heights = np.sqrt(np.concatenate([fusion.each.ravel(), fusion.average, fusion.variance, fusion.measured]))
    y = _deviation_axis(heights, fusion.unit)
    return Panel(time_axis(tau, "Scale τ (s)"), y, tuple(marks), title=axis_title(fusion.axis))


def _deviation_axis(heights: Vector, unit: str) -> Axis:
    return value_axis(limits_of(heights), f"Wavelet deviation ({unit})" if unit else "Wavelet deviation")


@drawing
def plot_cross(
    result: CrossCovariance, *, confidence: bool = True, path: str | os.PathLike[str] | None = None
) -> Figure:
    """Draw the correlation of each pair as a function of the scale. Filled symbols mark significant correlations.

    Parameters
    ----------
    confidence : bool
        Whether to draw the confidence limits.
    """
    x = replace(time_axis(result.tau, "Scale τ (s)"), opposite=())
    shown = [*result.correlation.values(), *([*result.lower.values(), *result.upper.values()] if confidence else [])]
    y = signed_axis(np.concatenate(shown), "Correlation", linear=0.03, even=0.03)  # gyroscopes: about 0.01
    rows = []
    for k, b in enumerate(result.axes[1:], start=1):
        row: list[Panel | None] = [
            _panel(result, a, b, x=x if k == len(result.axes) - 1 else quiet(x), y=y if m == 0 else quiet(y),
                   confidence=confidence)
            for m, a in enumerate(result.axes[:k])
        ]  # fmt: skip
        rows.append((*row, *[None] * (len(result.axes) - 1 - k)))
    columns = len(result.axes) - 1
    return Figure(
        tuple(rows), width=max(48.0 * columns, 110.0), height=22.0 + (44.0 if columns > 1 else 66.0) * columns,
        legend_columns=4,
    )  # fmt: skip


@drawing
def plot_joint(fit: JointFit, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Draw the wavelet deviation of each signal and the correlation of each pair of signals, for data and model."""
    d = len(fit.axes)
    tau = np.exp2(fit.levels.astype(np.float64)) / fit.rate
    x = replace(time_axis(tau, "Scale τ (s)"), opposite=())
    size = [np.sqrt(np.einsum("jaa->ja", gamma)) for gamma in (fit.measured, fit.implied)]
    pairs = [
        gamma / (s[:, :, None] * s[:, None, :]) for gamma, s in zip((fit.measured, fit.implied), size, strict=True)
    ]
    below = np.tril_indices(d, -1)
    y = signed_axis(np.concatenate([r[:, below[0], below[1]].ravel() for r in pairs]), "Correlation", linear=1.0,
                    even=1.0)  # fmt: skip
    rows: list[tuple[Panel | None, ...]] = []
    for k, axis in enumerate(fit.axes):
        bottom = x if k == d - 1 else quiet(x)
        row: list[Panel | None] = []
        for m, other in enumerate(fit.axes[:k]):
            side = y if m == 0 else quiet(y)
            zero = Polyline(np.array(bottom.limits), np.zeros(2), stroke=ZERO, label="", layer=BEHIND)
            curves = _curves(tau, *(r[:, k, m] for r in pairs))
            row.append(Panel(bottom, side, (zero, *curves), title=_pair(other, axis)))
        heights = [s[:, k] for s in size]
        side = _deviation_axis(np.concatenate(heights), fit.units.get(axis, ""))
        panel = Panel(bottom, side, _curves(tau, *heights), title=axis_title(axis))
        rows.append((*row, panel, *[None] * (d - 1 - k)))
    return Figure(tuple(rows), width=58.0 * d, height=20.0 + 48.0 * d, legend_columns=2)


@drawing
def plot_fusion(virtual: VirtualSensor, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Draw the wavelet deviations of each signal, of their average and of the virtual sensor by scale."""
    panels = [_axis_panel(axis) for axis in virtual.axes.values()]
    columns = min(len(panels), 3)
    rows: list[tuple[Panel | None, ...]] = [tuple(panels[k : k + columns]) for k in range(0, len(panels), columns)]
    rows[-1] = (*rows[-1], *[None] * (columns - len(rows[-1])))
    return Figure(
        tuple(rows), width=110.0 if columns == 1 else 78.0 * columns, height=14.0 + 70.0 * len(rows), legend_columns=2
    )
