"""Plot of a joint fit as a triangle of panels, with deviations on the diagonal and correlations below it."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gmwm.applications.several.cross_plot import ZERO
from gmwm.showing.plots.axes import limits_of, quiet, signed_axis, time_axis, value_axis
from gmwm.showing.plots.curves import BEHIND, FRONT, MIDDLE
from gmwm.showing.plots.drawing import drawing
from gmwm.showing.plots.figure import Axis, Figure, Line, Mark, Panel
from gmwm.showing.plots.style import IMPLIED, OBSERVED

if TYPE_CHECKING:
    from gmwm.applications.several.joint_result import JointFit


def joint_figure(fit: JointFit) -> Figure:
    """Return the figure that `plot_joint` draws."""
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
            row.append(_correlations(tau, *(r[:, k, m] for r in pairs), x=bottom, y=side, title=f"{other}, {axis}"))
        unit = f" ({fit.units[axis]})" if fit.units.get(axis) else ""
        heights = [s[:, k] for s in size]
        label = f"Wavelet deviation{unit}"
        panel = Panel(bottom, value_axis(limits_of(np.concatenate(heights)), label), _curves(tau, *heights), title=axis)
        rows.append((*row, panel, *[None] * (d - 1 - k)))
    return Figure(tuple(rows), width=58.0 * d, height=20.0 + 48.0 * d, legend_columns=2)


def _curves(tau: np.ndarray, data: np.ndarray, model: np.ndarray) -> tuple[Mark, ...]:
    return (
        Line(tau, model, stroke=IMPLIED, label="joint model", layer=MIDDLE),
        Line(tau, data, stroke=replace(OBSERVED, width=0.0), label="data", layer=FRONT),
    )


def _correlations(tau: np.ndarray, data: np.ndarray, model: np.ndarray, *, x: Axis, y: Axis, title: str) -> Panel:
    zero = Line(np.array(x.limits), np.zeros(2), stroke=ZERO, label="", layer=BEHIND)
    return Panel(x, y, (zero, *_curves(tau, data, model)), title=title)


@drawing
def plot_joint(fit: JointFit, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Draw the wavelet deviation of each signal and the correlation of each pair of signals, for the data and the
    model.
    """
    return joint_figure(fit)
