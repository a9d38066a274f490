"""Plot of estimated latent processes over time: the record with its bias, and below it each process with its band."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Vector, as_vector
from gmwm.base.errors import OptionError
from gmwm.fitting.likelihood.system import LEVEL
from gmwm.fitting.likelihood.tracks import BIAS, Kind, Tracks, wanders
from gmwm.showing.plots.axes import number_text, quiet
from gmwm.showing.plots.curves import ABOVE, BAND, BEHIND, FRONT, MIDDLE
from gmwm.showing.plots.drawing import drawing
from gmwm.showing.plots.figure import PAGE, Axis, Band, Figure, Mark, Panel, Polyline, Stroke
from gmwm.showing.plots.labels import axis_title, model_text, term_label
from gmwm.showing.plots.linear import elapsed_axis, scaled_axis
from gmwm.showing.plots.series import DOTS_OF_MM, quantity_name
from gmwm.showing.plots.style import BLACK, BLUE, PALE
from gmwm.showing.plots.trace import envelope, even_trace, extremes_there, in_digits, lone_dots, offset_of
from gmwm.showing.plots.view import UnitSystem, View, view_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLUMNS = round(DOTS_OF_MM * PAGE)
RECORD = Stroke(PALE, 0.5)
TRACK = Stroke(BLUE, 1.1)
TRUTH = Stroke(BLACK, 0.5)
WORDS: dict[Kind, str] = {"filter": "Filtered", "smooth": "Smoothed", "predict": "Predicted"}


# --- what is drawn, as data ---------------------------------------------------------------------------


def tracks_figure(
    tracks: Tracks, labels: str | Sequence[str] | None = None, *,
    truth: Mapping[str, ArrayLike] | ArrayLike | None = None, level: float = 0.95, units: UnitSystem = "si",
    record: bool = True,
) -> Figure:  # fmt: skip
    """Return the figure that `plot_tracks` draws: a panel with the record and its bias, and one for each process."""
    chosen, paths = _as_labels(tracks, labels), _as_truth(tracks, truth)
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
        terms = zip(tracks.model.terms, tracks.model.processes, strict=True)
        parts = [term for term, process in terms if wanders(process, tracks.rate)]
        return f"Bias: {model_text([LEVEL] * (LEVEL in tracks.mean) + parts)}"
    if label == LEVEL:
        return "Level of the record"
    process = tracks.model.processes[tracks.model.terms.index(label)]
    return term_label(label, process, shown, tracks.rate)


def _less(title: str, amount: float, shown: View) -> str:
    """Return the title with the constant that was subtracted; unchanged if the constant is 0."""
    written = number_text(amount, 6).replace("-", "−")
    return f"{title}, less {written} {shown.unit}".rstrip() if amount else title


def _value_axis(low: float, high: float, tracks: Tracks, shown: View) -> tuple[Axis, float]:
    return scaled_axis(low, high, max(abs(low), abs(high)), name=quantity_name(tracks.unit), unit=shown.unit)


# --- checks of the arguments --------------------------------------------------------------------------


def _as_labels(tracks: Tracks, labels: str | Sequence[str] | None) -> list[str]:
    names = [BIAS] if labels is None else [labels] if isinstance(labels, str) else list(dict.fromkeys(labels))
    unknown = [label for label in names if label not in tracks.mean]
    if unknown or not names:
        raise OptionError(
            argument="labels",
            expected=f"one or more of {', '.join(tracks.labels)}",
            got=unknown[0] if unknown else labels,
        )
    return names


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


# --- pictures -----------------------------------------------------------------------------------------


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
