"""Plot of the autocorrelation of a signal, with confidence limits that hold for white noise."""

from __future__ import annotations

import math
import os
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.errors import OptionError
from gmwm.fitting.likelihood.record import as_record
from gmwm.recording.autocorrelation import autocorrelation, observed_pairs
from gmwm.recording.options import as_whole_number
from gmwm.recording.signals import Signal
from gmwm.showing.plots.curves import BAND, BEHIND, FRONT, MIDDLE
from gmwm.showing.plots.drawing import drawing
from gmwm.showing.plots.figure import Band, Figure, Line, Mark, Panel, Stroke
from gmwm.showing.plots.labels import axis_title
from gmwm.showing.plots.linear import even_axis
from gmwm.showing.plots.series import PAGE
from gmwm.showing.plots.style import BLACK, BLUE, GREY

if TYPE_CHECKING:
    pass

LEVEL = 0.95
"""Confidence level of the limits for white noise."""
FEW = 200
"""Largest number of lags for which each value has a dot. Pinned by tests/plots/test_plot_residuals.py."""
DOTTED = Stroke(BLUE, 0.0, symbol="circle")
EXPECTED = Stroke(BLACK, 0.8)


def autocorrelation_panel(r: Vector, error: Vector, title: str = "") -> Panel:
    """Return a panel with an autocorrelation and its confidence limits for white noise.

    Parameters
    ----------
    r : (L,) array
        Autocorrelation at the lags 1 … L.
    error : (L,) array
        Standard deviation of the autocorrelation at each lag if the signal is white noise.
    title : str
    """
    lag = np.arange(1.0, r.size + 1)
    limit = NormalDist().inv_cdf((1 + LEVEL) / 2) * error
    far = max(float(np.max(np.abs(r))), 1.5 * float(np.max(limit)))
    x = even_axis(0.0, r.size, "Lag (samples)", margin=0.02, at_most=8)
    y = even_axis(-far, far, "Autocorrelation", margin=0.06, at_most=7)
    ends = np.array(x.limits)
    stems = np.column_stack([np.zeros(r.size), r, np.full(r.size, math.nan)]).ravel()
    label = f"{percent(LEVEL)} limits of each point"
    marks: list[Mark] = [
        Band(x=lag, lower=-limit, upper=limit, colour=GREY, opacity=0.25, label=label, layer=BAND),
        Line(ends, np.zeros(2), stroke=EXPECTED, label="Expected", layer=BEHIND),
        Line(np.repeat(lag, 3), stems, stroke=Stroke(BLUE, 0.9 if r.size <= FEW else 0.5), label="", layer=MIDDLE),
    ]
    if r.size <= FEW:
        marks.append(Line(lag, r, stroke=DOTTED, label="Observed", layer=FRONT))
    return Panel(x, y, tuple(marks), title)


def signal_autocorrelation_panel(signal: Signal, lags: int | None = None) -> Panel:
    """Return the panel that `plot_autocorrelation` draws."""
    record = as_record(signal, None)
    most = record.observed - 1
    count = min(int(10 * math.log10(record.observed)), most) if lags is None else as_whole_number(lags, "lags", 1)
    if count > most:
        raise OptionError(argument="lags", expected=f"at most {most}, the number of samples less one", got=lags)
    r = autocorrelation(record.values, count)[1:]
    error = np.sqrt(observed_pairs(record.values, count)) / record.observed
    return autocorrelation_panel(r, error, f"{axis_title(signal.axis) or 'Signal'}, limits for white noise")


@drawing
def plot_autocorrelation(
    signal: Signal, lags: int | None = None, *, path: str | os.PathLike[str] | None = None
) -> Figure:
    """Draw the autocorrelation of a signal at the lags 1 … L, with the 95 % limits of each value for white noise.

    Parameters
    ----------
    signal : Signal
        The signal. Pairs of samples of which one is missing are left out.
    lags : int, optional
        Number of lags L. Default: 10 log₁₀ N for N samples.

    Raises
    ------
    OptionError
        If `lags` is not from 1 to the number of samples less one.
    DataError, ModelError
        If the signal has fewer than 8 samples, or all samples are equal.

    Examples
    --------
    >>> from gmwm.simulation import example_recording
    >>> figure = plot_autocorrelation(example_recording()["gyro_x"], lags=40)
    >>> figure.axes[0].get_ylabel()
    'Autocorrelation'
    """
    return Figure(((signal_autocorrelation_panel(signal, lags),),), width=PAGE, height=70.0)


def percent(share: float) -> str:
    """Format a fraction as a percentage."""
    return f"{100 * share:g} %"
