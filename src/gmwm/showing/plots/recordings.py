"""Plot of the recordings of one unit relative to their mean, by scale."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gmwm.measuring.covariance import Design
from gmwm.measuring.covariance.api import variances
from gmwm.showing.plots.axes import signed_axis, time_axis
from gmwm.showing.plots.curves import BAND, BEHIND, FRONT
from gmwm.showing.plots.drawing import drawing
from gmwm.showing.plots.figure import Band, Figure, Mark, Panel, Polyline, Stroke
from gmwm.showing.plots.labels import axis_title
from gmwm.showing.plots.style import GREY, SOLID, curve_stroke

if TYPE_CHECKING:
    from gmwm.choosing.replicates import Replicates

MEAN = Stroke(GREY, 0.8, SOLID)
"""Stroke of the line at zero, which is the mean of the recordings."""
LINEAR, EVEN = 10.0, 100.0
"""Difference (%) up to which the vertical axis is linear, and largest difference (%) for which the whole axis is
linear."""


def recordings_figure(replicates: Replicates) -> Figure:
    """Return the figure that `plot_recordings` draws. It shows by how many per cent the wavelet deviation of each
    recording differs from the mean of all recordings."""
    wv, fit = replicates.fit.wavelet_variance, replicates.fit
    curves = wv.recordings
    ratios = {name: 100 * (np.sqrt(curve.variance[: len(wv)] / wv.variance[: len(curve)]) - 1)
              for name, curve in curves.items()}  # fmt: skip
    typical = sorted(curves.values(), key=lambda curve: curve.samples)[len(curves) // 2]
    typical_levels = min(len(typical), len(wv))
    design = Design.of(typical).only(typical.levels <= typical_levels)
    # A recording contributes to the mean, so it differs less from the mean than from another recording.
    part = np.sqrt(max(1 - typical.samples / wv.samples, 0.0))
    scatter = 50 * 1.96 * part * np.sqrt(variances(fit.model, design)) / fit.implied[:typical_levels]
    x = replace(time_axis(wv.tau, "Scale τ (s)"), opposite=())
    shown = [values[wv.degrees_of_freedom[: values.size] > len(curves)] for values in ratios.values()]
    y = signed_axis(np.concatenate(shown), "Difference from all recordings (%)", linear=LINEAR, even=EVEN)
    marks: list[Mark] = [
        Polyline(np.array(x.limits), np.zeros(2), stroke=MEAN, label="", layer=BEHIND),
        Band(wv.tau[:typical_levels], -scatter, scatter, colour=GREY, opacity=0.25, layer=BAND,
             label="95 % of equal recordings"),
    ]  # fmt: skip
    for k, (name, values) in enumerate(ratios.items()):
        marks.append(Polyline(wv.tau[: values.size], values, stroke=curve_stroke(k), label=name, layer=FRONT))
    return Figure(((Panel(x, y, tuple(marks), title=axis_title(wv.axis)),),), width=150.0, height=95.0)


@drawing
def plot_recordings(replicates: Replicates, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Draw the relative difference between the wavelet deviation of each recording and of all recordings together.

    A band shows the range of differences that chance explains.
    """
    return recordings_figure(replicates)
