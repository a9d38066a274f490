"""Plots of an autocorrelation, and of the innovations of a model over time and against normal quantiles."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.fitting.likelihood.correlations import as_lags, autocorrelation, pair_factors
from gmwm.fitting.likelihood.innovations import Residuals
from gmwm.fitting.likelihood.problem import as_record
from gmwm.fitting.likelihood.tracks import Modelled
from gmwm.recording.autocorrelation import observed_pairs
from gmwm.recording.signals import Signal
from gmwm.showing.plots.axes import number_text, power_text
from gmwm.showing.plots.curves import BAND, BEHIND, FRONT, MIDDLE
from gmwm.showing.plots.drawing import drawing
from gmwm.showing.plots.figure import PAGE, Band, Figure, Mark, Panel, Polyline, Stroke
from gmwm.showing.plots.labels import axis_title, model_text
from gmwm.showing.plots.linear import elapsed_axis, even_axis, number_at
from gmwm.showing.plots.series import DOTS_OF_MM
from gmwm.showing.plots.style import BLACK, BLUE, GREY, VERMILLION
from gmwm.showing.plots.trace import even_trace, lone_dots
from gmwm.theory.processes.model import as_model

if TYPE_CHECKING:
    pass

LIMIT_LEVEL = 0.95
"""Confidence level of the limits for white noise."""
DOTTED = Stroke(BLUE, 0.0, symbol="circle")
EXPECTED = Stroke(BLACK, 0.8)


LINE = Stroke(BLUE, 0.5)
LIMIT = Stroke(VERMILLION, 0.9)
ROBUST = Stroke(BLACK, 0.0, symbol="cross")


def residuals_figure(residuals: Residuals, lags: int | None = None) -> Figure:
    """Return the figure that `plot_residuals` draws."""
    below = (quantile_panel(residuals), correlation_panel(residuals, lags))
    return Figure(((time_panel(residuals),), below), width=PAGE, height=126.0, heights=(0.8, 1.0), legend_columns=4)


def time_panel(residuals: Residuals) -> Panel:
    """Return the panel of the residuals over time. If the model is right, the largest residual exceeds the limits in
    the panel with a probability of 5 %."""
    z = residuals.observed
    largest = NormalDist().inv_cdf((1 + LIMIT_LEVEL ** (1 / z.size)) / 2)
    samples = even_trace(residuals.values, residuals.rate, 1.0, round(DOTS_OF_MM * PAGE))
    count = residuals.values.size
    x, size = elapsed_axis(0.0, (count - 1) / residuals.rate, count / residuals.rate)
    ends = min(samples.low, -largest), max(samples.high, largest)
    y = even_axis(*ends, "Standardised innovation", margin=0.06, at_most=7)
    times = samples.seconds / size
    across = np.array([*x.limits, math.nan, *x.limits])
    limits = np.array([largest, largest, math.nan, -largest, -largest])
    marks: list[Mark] = [Polyline(times, samples.y, stroke=LINE, layer=MIDDLE)]
    marks += lone_dots(times, samples.y, BLUE, MIDDLE)
    marks.append(
        Polyline(across, limits, stroke=LIMIT, label=f"{percent(LIMIT_LEVEL)} limits of the largest", layer=FRONT)
    )
    beyond = int(np.count_nonzero(np.abs(z) > largest))
    name = ", ".join(filter(None, [axis_title(residuals.axis), model_text(residuals.model.terms)]))
    mean, spread = (number_at(round(float(value), 3), 3) for value in (np.mean(z), np.std(z)))
    return Panel(x, y, tuple(marks), f"{name}: mean {mean}, standard deviation {spread}, {beyond} beyond the limit")


def quantile_panel(residuals: Residuals) -> Panel:
    """Return the panel of observed against normal quantiles. If the model is right, the points are near the diagonal
    and mostly within the limits."""
    normal, observed = residuals.quantiles()
    lower, upper = order_limits(normal, residuals.observed.size)
    reach = float(np.max(np.abs(normal)))
    x = even_axis(-reach, reach, "Normal quantile", margin=0.05, at_most=7)
    # The panel shows all points, but the limits of the outermost points may lie outside.
    low, high = min(-reach, float(np.min(observed))), max(reach, float(np.max(observed)))
    y = even_axis(low, high, "Observed quantile", margin=0.08, at_most=7)
    normality = residuals.normality()
    marks = (
        Band(normal, lower, upper, GREY, label=f"{percent(LIMIT_LEVEL)} limits of each point", layer=BAND),
        Polyline(np.array(x.limits), np.array(x.limits), stroke=EXPECTED, label="Expected", layer=BEHIND),
        Polyline(normal, observed, stroke=DOTTED, label="Observed", layer=FRONT),
    )
    return Panel(x, y, marks, f"Jarque-Bera: {_p_text(normality.p_value)}")


def order_limits(normal: Vector, count: int, level: float = LIMIT_LEVEL) -> tuple[Vector, Vector]:
    """Return the lower and upper confidence limits (n,) of order statistics of a standard normal sample.

    For the k-th smallest value z of N, Φ(z) has the distribution Beta(k, N − k + 1), where Φ is the normal distribution
    function.

    `normal` (n,) has the normal quantiles that are the expected values of the order statistics of `count` = N samples.
    `level` is the probability that an order statistic lies within its limits.

    >>> low, high = order_limits(np.array([-2.0, 2.0]), 10_000)
    >>> print(*(f"{a:.3f} to {b:.3f};" for a, b in zip(low, high, strict=True)))
    -2.054 to -1.946; 1.946 to 2.054;
    """
    from scipy.special import betaincinv, ndtr, ndtri

    # The limits are computed for negative quantiles, where small probabilities have full relative precision.
    mirrored = -np.abs(normal)
    place = np.clip(np.round(ndtr(mirrored) * count + 0.5), 1, count)
    ends = [ndtri(betaincinv(place, count - place + 1, share)) for share in ((1 - level) / 2, (1 + level) / 2)]
    below = normal <= 0
    return np.where(below, ends[0], -ends[1]), np.where(below, ends[1], -ends[0])


def correlation_panel(residuals: Residuals, lags: int | None = None) -> Panel:
    """Return the panel of the autocorrelation of the residuals, with confidence limits for white noise."""
    r = residuals.acf(lags)[1:]
    return autocorrelation_panel(r, residuals.acf_error(r.size), _whiteness(residuals, lags))


def _whiteness(residuals: Residuals, lags: int | None) -> str:
    """Return the result of the Ljung-Box test as a title."""
    if (residuals.usual_lags if lags is None else lags) <= residuals.estimated:
        return f"No Ljung-Box test: {residuals.estimated} parameters were estimated"
    test = residuals.ljung_box(lags)
    return f"Ljung-Box, {test.lags} lags: {_p_text(test.p_value)}"


def _p_text(p_value: float) -> str:
    # Pinned by tests/plots/test_plot_residuals.py.
    return f"p < {power_text(1e-6)}" if p_value < 1e-6 else f"p = {number_text(p_value, 2)}"


@drawing
def plot_residuals(
    residuals: Residuals, lags: int | None = None, *, path: str | os.PathLike[str] | None = None
) -> Figure:
    """Draw the residuals over time, their normal probability plot, and their autocorrelation.

    The titles give the results of the tests.

    Parameters
    ----------
    lags : int, optional
        Number of lags of the autocorrelation and of the Ljung-Box test; 10 log₁₀ N by default.

    Raises
    ------
    OptionError
        If `lags` is not a whole number below the number of samples, or the ending of `path` is unknown.

    Examples
    --------
    >>> from gmwm import RW, WN
    >>> model = WN(sigma2=1.0) + RW(gamma2=1e-4)
    >>> picture = model.residuals(model.simulate(1000, 100.0, rng=1), rate=100.0).plot()
    >>> [axes.get_title().partition(":")[0] for axes in picture.findobj(match=type(picture.axes[0]))]
    ['WN + RW', 'Jarque-Bera', 'Ljung-Box, 30 lags']
    """
    return residuals_figure(residuals, lags)


def autocorrelation_panel(
    r: Vector, error: Vector, title: str = "", name: str = "Autocorrelation", most: float = 0.0
) -> Panel:
    """Return a panel with an autocorrelation r (L,) at the lags 1 … L, and its confidence limits for white noise.
    `error` (L,) is the standard deviation of each value for white noise. The axis includes ± `most`."""
    lag = np.arange(1.0, r.size + 1)
    limit = NormalDist().inv_cdf((1 + LIMIT_LEVEL) / 2) * error
    far = max(float(np.max(np.abs(r))), 1.5 * float(np.max(limit)), most)
    x = even_axis(0.0, r.size, "Lag (samples)", margin=0.02, at_most=8)
    y = even_axis(-far, far, name, margin=0.06, at_most=7)
    ends = np.array(x.limits)
    stems = np.column_stack([np.zeros(r.size), r, np.full(r.size, math.nan)]).ravel()
    label = f"{percent(LIMIT_LEVEL)} limits of each point"
    # Each of at most 200 lags has a dot (tests/plots/test_plot_residuals.py).
    marks: list[Mark] = [
        Band(lag, -limit, limit, GREY, label=label, layer=BAND),
        Polyline(ends, np.zeros(2), stroke=EXPECTED, label="Expected", layer=BEHIND),
        Polyline(np.repeat(lag, 3), stems, stroke=Stroke(BLUE, 0.9 if r.size <= 200 else 0.5), label="", layer=MIDDLE),
    ]
    if r.size <= 200:
        marks.append(Polyline(lag, r, stroke=DOTTED, label="Observed", layer=FRONT))
    return Panel(x, y, tuple(marks), title)


def signal_autocorrelation_panel(
    signal: Signal,
    lags: int | None = None,
    *,
    partial: bool = False,
    robust: bool = False,
    model: Modelled | None = None,
) -> Panel:
    """Return the panel that `plot_autocorrelation` draws."""
    record = as_record(signal, None)
    count = as_lags(lags, record.observed)
    r = autocorrelation(signal, count, partial=partial)[1:]
    error = np.sqrt(observed_pairs(record.values, count)) / record.observed * pair_factors(record.values, count)
    others: list[tuple[Vector, Stroke, str]] = []
    if robust:
        scores = autocorrelation(signal, count, partial=partial, robust=True)[1:]
        others.append((scores, ROBUST, "Observed, robust"))
    if model is not None:
        terms = as_model(getattr(model, "model", model))
        theory = autocorrelation(terms, count, signal.rate, partial=partial)[1:]
        others.append((theory, LIMIT, f"Model: {model_text(terms.terms)}"))
    title = f"{axis_title(signal.axis) or 'Signal'}, limits for white noise"
    name = "Partial autocorrelation" if partial else "Autocorrelation"
    most = max((float(np.max(np.abs(curve))) for curve, _, _ in others), default=0.0)
    panel = autocorrelation_panel(r, error, title, name=name, most=most)
    lag = np.arange(1.0, count + 1)
    added = (Polyline(lag, curve, stroke=stroke, label=label, layer=FRONT) for curve, stroke, label in others)
    return replace(panel, marks=(*panel.marks, *added))


@drawing
def plot_autocorrelation(
    signal: Signal, lags: int | None = None, *, partial: bool = False, robust: bool = False,
    model: Modelled | None = None, path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw the autocorrelation of a signal at the lags 1 … L, with the 95 % limits of each value for white noise.

    Parameters
    ----------
    signal : Signal
        The signal. Pairs of samples of which one is missing are left out.
    lags : int, optional
        Number of lags L. Default: 10 log₁₀ N for N samples.
    partial, robust : bool
        Whether to draw the partial autocorrelation, and also the robust estimate for comparison; see
        `gmwm.likelihood.autocorrelation`.
    model : Fit, LikelihoodFit, Model or str, optional
        Stationary model whose theoretical autocorrelation is drawn as a line.

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
    panel = signal_autocorrelation_panel(signal, lags, partial=partial, robust=robust, model=model)
    return Figure(((panel,),), width=PAGE, height=70.0)


def percent(share: float) -> str:
    """Format a fraction as a percentage."""
    return f"{100 * share:g} %"
