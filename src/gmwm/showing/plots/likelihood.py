"""Plots of an autocorrelation, of the innovations of a model, and of latent processes over time."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Vector, as_vector
from gmwm.base.errors import OptionError
from gmwm.base.statistics import observed_pairs
from gmwm.base.text import p_relation
from gmwm.fitting.likelihood.correlations import as_lags, autocorrelation, pair_factors
from gmwm.fitting.likelihood.innovations import Residuals
from gmwm.fitting.likelihood.problem import as_record
from gmwm.fitting.likelihood.system import LEVEL
from gmwm.fitting.likelihood.tracks import BIAS, Kind, Modelled, Tracks, wanders
from gmwm.recording.signals import Signal
from gmwm.showing.plots.axes import elapsed_axis, even_axis, number_at, number_text, quiet, scaled_axis
from gmwm.showing.plots.curves import ABOVE, BAND, BEHIND, FRONT, MIDDLE
from gmwm.showing.plots.figure import PAGE, Axis, Band, Figure, Mark, Panel, Polyline, Stroke, drawing
from gmwm.showing.plots.labels import UnitSystem, View, axis_title, model_text, term_label, view_of
from gmwm.showing.plots.series import DOTS_OF_MM, quantity_name
from gmwm.showing.plots.style import BLACK, BLUE, GREY, PALE, VERMILLION
from gmwm.showing.plots.trace import envelope, even_trace, extremes_there, in_digits, lone_dots, offset_of
from gmwm.theory.processes.model import as_model

if TYPE_CHECKING:
    from matplotlib.axes import Axes


LIMIT_LEVEL = 0.95  # confidence level of the limits for white noise
DOTTED = Stroke(BLUE, 0.0, symbol="circle")
EXPECTED = Stroke(BLACK, 0.8)


LINE = Stroke(BLUE, 0.5)
LIMIT = Stroke(VERMILLION, 0.9)
ROBUST = Stroke(BLACK, 0.0, symbol="cross")


def time_panel(residuals: Residuals) -> Panel:
    """Return the panel of residuals over time, with limits that the largest exceeds with a probability of 5 %."""
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
    """Return observed against normal quantiles: near the diagonal and mostly within limits if the model is right."""
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
    return Panel(x, y, marks, f"Jarque-Bera: p {p_relation(normality.p_value)}")


def order_limits(normal: Vector, count: int, level: float = LIMIT_LEVEL) -> tuple[Vector, Vector]:
    """Return confidence limits (n,) of normal order statistics: Φ(z) of the k-th of N is Beta(k, N − k + 1). `normal`
    (n,) are their expected values, and `level` the probability of each within its limits."""
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
    return f"Ljung-Box, {test.lags} lags: p {p_relation(test.p_value)}"


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
    below = (quantile_panel(residuals), correlation_panel(residuals, lags))
    return Figure(((time_panel(residuals),), below), width=PAGE, height=126.0, heights=(0.8, 1.0), legend_columns=4)


def autocorrelation_panel(
    r: Vector, error: Vector, title: str = "", name: str = "Autocorrelation", most: float = 0.0
) -> Panel:
    """Return a panel of an autocorrelation (L,) with limits for white noise (`error`), and at least ± `most`."""
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
    signal: Signal | ArrayLike, lags: int | None = None, *, partial: bool = False, robust: bool = False,
    model: Modelled | None = None,
) -> Panel:  # fmt: skip
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
        theory = autocorrelation(terms, count, record.rate, partial=partial)[1:]
        others.append((theory, LIMIT, f"Model: {model_text(terms.terms)}"))
    title = f"{axis_title(record.axis) or 'Signal'}, limits for white noise"
    name = "Partial autocorrelation" if partial else "Autocorrelation"
    most = max((float(np.max(np.abs(curve))) for curve, _, _ in others), default=0.0)
    panel = autocorrelation_panel(r, error, title, name=name, most=most)
    lag = np.arange(1.0, count + 1)
    added = (Polyline(lag, curve, stroke=stroke, label=label, layer=FRONT) for curve, stroke, label in others)
    return replace(panel, marks=(*panel.marks, *added))


@drawing
def plot_autocorrelation(
    signal: Signal | ArrayLike, lags: int | None = None, *, partial: bool = False, robust: bool = False,
    model: Modelled | None = None, path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw the autocorrelation of a signal at the lags 1 … L, with the 95 % limits of each value for white noise.

    Parameters
    ----------
    signal : Signal or (N,) array
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


COLUMNS = round(DOTS_OF_MM * PAGE)
RECORD = Stroke(PALE, 0.5)
TRACK = Stroke(BLUE, 1.1)
TRUTH = Stroke(BLACK, 0.5)
WORDS: dict[Kind, str] = {"filter": "Filtered", "smooth": "Smoothed", "predict": "Predicted"}


def tracks_figure(
    tracks: Tracks, labels: str | Sequence[str] | None = None, *,
    truth: Mapping[str, ArrayLike] | ArrayLike | None = None, level: float = 0.95, units: UnitSystem = "si",
    record: bool = True,
) -> Figure:  # fmt: skip
    """Return the figure that `plot_tracks` draws: a panel with the record and its bias, and one for each process."""
    names = [BIAS] if labels is None else [labels] if isinstance(labels, str) else list(dict.fromkeys(labels))
    unknown = [label for label in names if label not in tracks.mean]
    if unknown or not names:
        raise OptionError(
            argument="labels",
            expected=f"one or more of {', '.join(tracks.labels)}",
            got=unknown[0] if unknown else labels,
        )
    chosen, paths = names, _as_truth(tracks, truth)
    shown = view_of(tracks.unit, "allan", units)
    panels: list[Panel] = []
    less = 0.0
    if record and np.any(np.isfinite(tracks.data)):
        panel, less = _record_panel(tracks, shown)
        panels.append(panel)
    panels += [
        _track_panel(_Drawn(tracks, label, truth=paths.get(label), level=level, shown=shown), less) for label in chosen
    ]
    stacked = [replace(panel, x=quiet(panel.x)) for panel in panels[:-1]] + panels[-1:]
    height = max(min(46.0, 235.0 / len(panels)), 22.0)
    return Figure(
        tuple((panel,) for panel in stacked), width=PAGE, height=18.0 + height * len(panels), legend_columns=4
    )


@dataclass(frozen=True, eq=False)
class _Drawn:
    """What to draw in one panel: the process `label` of `tracks`, its true path (N,) if known, and the unit."""

    tracks: Tracks
    label: str
    truth: Vector | None
    level: float
    shown: View


def _record_panel(tracks: Tracks, shown: View) -> tuple[Panel, float]:
    """Return the panel with the record and its bias, and the constant that was subtracted from both."""
    samples = even_trace(tracks.data, tracks.rate, shown.factor, COLUMNS)
    mean = offset_of(samples)
    samples = samples.less(mean)
    x, size = _time_axis(tracks)
    y, scale = _value_axis(samples.low, samples.high, tracks, shown)
    times, record = samples.seconds / size, samples.y / scale
    marks: list[Mark] = [Polyline(times, record, stroke=RECORD, label="Record", layer=BEHIND)]
    marks += lone_dots(times, record, PALE, BEHIND)
    bias = _estimates(tracks, BIAS)
    index = extremes_there(bias, COLUMNS)
    path = (shown.factor * bias[index] - mean) / scale
    marks.append(Polyline(index / tracks.rate / size, path, stroke=TRACK, label=WORDS[tracks.kind], layer=FRONT))
    name = axis_title(tracks.axis) or "Record"
    return Panel(x, y, tuple(marks), _less(f"{name} and its bias: {model_text(tracks.model.terms)}", mean, shown)), mean


def _track_panel(drawn: _Drawn, less: float) -> Panel:
    """Return the panel of one process with its confidence band. `less` is the constant subtracted from the record."""
    tracks, shown = drawn.tracks, drawn.shown
    mean = shown.factor * _estimates(tracks, drawn.label)
    lower, upper = (shown.factor * end for end in tracks.band(drawn.label, drawn.level))
    truth = None if drawn.truth is None else shown.factor * drawn.truth
    low, high = _ends(tracks, drawn.label, lower=lower, upper=upper, truth=truth)
    # Subtract the same constant as from the record, but only if the process contains the level of the record.
    less = less if abs(low - less) < abs(low) else 0.0
    # Values above 50 times their span have long tick labels (tests/plots/test_plot_limits.py).
    if max(abs(low - less), abs(high - less)) > 50.0 * (high - low) > 0:
        less = in_digits((low + high) / 2, high - low)
    low, high = low - less, high - less
    x, size = _time_axis(tracks)
    y, scale = _value_axis(low, high, tracks, shown)
    first = _first_time(tracks) / size
    place, below, above = envelope((lower - less) / scale, (upper - less) / scale, COLUMNS)
    interval = f"{100 * drawn.level:g} % interval"
    marks: list[Mark] = [Band(first + place / tracks.rate / size, below, above, BLUE, label=interval, layer=BAND)]
    curves: list[tuple[Vector, Stroke, str, int]] = [(mean, TRACK, WORDS[tracks.kind], MIDDLE)]
    if truth is not None:
        curves.append((truth, TRUTH, "Truth", BEHIND if _dense(truth, high - low) else ABOVE))
    for values, stroke, label, layer in curves:
        index = extremes_there(values, COLUMNS)
        times = first + index / tracks.rate / size
        marks.append(Polyline(times, (values[index] - less) / scale, stroke=stroke, label=label, layer=layer))
    return Panel(x, y, tuple(marks), _less(_title(tracks, drawn.label, shown), less, shown))


def _ends(tracks: Tracks, label: str, lower: Vector, upper: Vector, truth: Vector | None) -> tuple[float, float]:
    """Return the smallest and the largest value that the panel must show, without those of a filter that settles."""
    error = tracks.error[label]
    shown = np.isfinite(error)
    if tracks.kind == "filter" and np.any(shown):
        # A filter has settled when its standard error is below twice the median (tests/plots/test_plot_tracks.py).
        shown &= np.arange(error.size) >= int(np.argmax(error <= 2.0 * np.median(error[shown])))
    values = np.concatenate([lower[shown], upper[shown], [] if truth is None else truth[np.isfinite(truth)]])
    return (float(np.min(values)), float(np.max(values))) if values.size else (0.0, 0.0)


def _dense(values: Vector, height: float) -> bool:
    """Return whether a line varies so fast that it looks like a filled area and would hide the curves behind it."""
    index = extremes_there(values, COLUMNS)
    steps = np.abs(np.diff(values[index]))
    # A line whose points differ by more than 3 % of the height looks filled (tests/plots/test_plot_tracks.py).
    return index.size > COLUMNS and bool(np.nanmean(steps) > 0.03 * height)


def _estimates(tracks: Tracks, label: str) -> Vector:
    """Return the estimated values of a process, with NaN where the standard error is not finite."""
    return np.where(np.isfinite(tracks.error[label]), tracks.mean[label], math.nan)


def _first_time(tracks: Tracks) -> float:
    """Return the time of the first value (s). A prediction starts one step after the end of the record."""
    return 1 / tracks.rate if tracks.kind == "predict" else 0.0


def _time_axis(tracks: Tracks) -> tuple[Axis, float]:
    """Return the time axis of the tracks, and the length of its unit (s)."""
    first = _first_time(tracks)
    since = "the end of the record" if first else "the first sample"
    return elapsed_axis(0.0, first + (len(tracks) - 1) / tracks.rate, len(tracks) / tracks.rate, since=since)


def _title(tracks: Tracks, label: str, shown: View) -> str:
    if label == BIAS:
        terms = tracks.model.by_term.items()
        parts = [term for term, process in terms if wanders(process, tracks.rate)]
        return f"Bias: {model_text([LEVEL] * (LEVEL in tracks.mean) + parts)}"
    if label == LEVEL:
        return "Level of the record"
    process = tracks.model.by_term[label]
    return term_label(label, process, shown, tracks.rate)


def _less(title: str, amount: float, shown: View) -> str:
    """Return the title with the constant that was subtracted; unchanged if the constant is 0."""
    written = number_text(amount, 6)
    return f"{title}, less {written} {shown.unit}".rstrip() if amount else title


def _value_axis(low: float, high: float, tracks: Tracks, shown: View) -> tuple[Axis, float]:
    return scaled_axis(low, high, max(abs(low), abs(high)), name=quantity_name(tracks.unit), unit=shown.unit)


def _as_truth(tracks: Tracks, truth: Mapping[str, ArrayLike] | ArrayLike | None) -> dict[str, Vector]:
    """Return the true paths (N,) by label. A single array is the path of the bias."""
    if truth is None:
        return {}
    by_label = truth if isinstance(truth, Mapping) else {BIAS: truth}
    unknown = [str(label) for label in by_label if label not in tracks.mean]
    if unknown:
        raise OptionError(
            argument="truth", expected=f"a mapping with keys among {', '.join(tracks.labels)}", got=unknown[0]
        )
    paths = {label: as_vector(path, f"truth of {label}", finite=False) for label, path in by_label.items()}
    for label, path in paths.items():
        if path.size != len(tracks):
            raise OptionError(
                f"the truth of {label} has {path.size} values, but the tracks have {len(tracks)} samples",
                argument="truth", got=path.size, advice="Pass one value for each sample.",
            )  # fmt: skip
    return paths


@drawing
def plot_tracks(
    tracks: Tracks, labels: str | Sequence[str] | None = None, *,
    truth: Mapping[str, ArrayLike] | ArrayLike | None = None, level: float = 0.95, units: UnitSystem = "si",
    ax: Axes | None = None, path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw the recording with its bias and, below it, the bias or other tracks with their confidence bands.

    The line of the recording has gaps where samples are missing; the tracks do not. Samples with an infinite
    standard deviation are not drawn. For a prediction, only the tracks are drawn.

    Parameters
    ----------
    labels : str or sequence of str, optional
        The tracks to draw, one panel each; the bias by default.
    truth : mapping of label to (N,) array, or (N,) array, optional
        The true values, in the unit of the recording, if they are known. A single array is the true bias.
    level : float
        Probability that the band contains the process at a given sample, if the parameters of the model are exact.
    ax : matplotlib Axes, optional
        Axes on which to draw one track without the recording; a new figure by default.

    Raises
    ------
    OptionError
        If a label or an option is unknown, if `truth` has another length than the tracks, or if the picture cannot
        be drawn on `ax`.
    DataError
        If `truth` is not a vector of real numbers.

    Examples
    --------
    >>> from gmwm import simulate_signal
    >>> made = simulate_signal("WN(sigma2=1.0) + RW(gamma2=1e-4)", rate=100.0, samples=1000, rng=1)
    >>> tracks = made.model.smooth(made.signal)
    >>> picture = tracks.plot(truth=made["RW"])
    >>> [axes.get_title() for axes in picture.axes]
    ['Record and its bias: WN + RW', 'Bias: RW']
    """
    return tracks_figure(tracks, labels, truth=truth, level=level, units=units, record=ax is None)
