"""Plot of a ranking of models: their curves with the data, their distances from the data, and their criteria."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from textwrap import wrap

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.errors import OptionError
from gmwm.base.text import with_minus
from gmwm.choosing.selection.ranking import Candidate, Comparison, Ranking
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.showing.plots.axes import signed_axis, time_axis
from gmwm.showing.plots.curves import (
    ABOVE,
    BEHIND,
    FRONT,
    MIDDLE,
    closed_panel,
    confidence_band,
    limits_label,
    observed_marks,
    view_for,
)
from gmwm.showing.plots.figure import PAGE, Axis, Figure, Mark, Panel, Polyline, Stroke, Symbol, Tick, drawable, drawing
from gmwm.showing.plots.imu import SINGLE_WIDTH_MM
from gmwm.showing.plots.labels import UnitSystem, ViewName, axis_title, model_text
from gmwm.showing.plots.style import GREY, IMPLIED, OBSERVED, term_stroke

MOST_CURVES = 8
"""Largest number of candidates whose curve can be drawn. Pinned by tests/plots/test_plot_ranking.py."""
FIRST = replace(IMPLIED, symbol="circle")  # stroke of the recommended candidate
SYMBOLS: tuple[Symbol, ...] = ("square", "triangle", "diamond", "down", "star", "plus", "cross")
OTHER = Stroke(GREY, 0.0, symbol="circle", filled=False)  # stroke of candidates whose curve is not drawn

EVEN_DIFFERENCE, EVEN_DISTANCE = 1.0, 5.0
"""Value up to which the axis of differences is linear, and largest value for which a whole axis is linear."""


def _stroke(place: int) -> Stroke:
    return replace(term_stroke(place), width=1.2, symbol=SYMBOLS[place % len(SYMBOLS)])


def _curves(candidates: Sequence[Candidate], strokes: Sequence[Stroke], view: ViewName, units: UnitSystem) -> Panel:
    """Return the panel with the data and the curves of the models, whose legend entries the other panel has."""
    wv = candidates[0].fit.wavelet_variance
    shown = view_for(wv, view, units)
    marks: list[Mark] = list(observed_marks(wv, shown, stroke=replace(OBSERVED, width=0.0)))
    heights = [drawable(shown.height(np.asarray(c.fit.implied))) for c in candidates]
    for height, stroke in zip(heights, strokes, strict=True):
        layer = MIDDLE if stroke is FIRST else ABOVE
        marks.append(Polyline(shown.time(wv.tau), height, stroke=replace(stroke, symbol=None), label="", layer=layer))
    return closed_panel([shown], [wv], marks, around=heights, title="Data and models")


def _distances(candidates: Sequence[Candidate], strokes: Sequence[Stroke], view: ViewName, units: UnitSystem) -> Panel:
    curves = [(_name(c), np.asarray(c.fit.implied), stroke) for c, stroke in zip(candidates, strokes, strict=True)]
    return distance_panel(candidates[0].fit.wavelet_variance, curves, view, units)


def distance_panel(
    wv: WaveletVariance, models: Sequence[tuple[str, Vector, Stroke]], view: ViewName, units: UnitSystem
) -> Panel:
    """Return the panel of models' distances (name, wavelet variance, stroke) from data, in confidence limits."""
    times = view_for(wv, view, units).time(wv.tau)
    x = time_axis(times, view_for(wv, view, units).time_label)
    ends = np.array(x.limits)
    band = confidence_band(ends, np.full(2, -1.0), np.full(2, 1.0), colour=OBSERVED.colour, label=limits_label(wv))
    marks: list[Mark] = [band, Polyline(ends, np.zeros(2), stroke=Stroke(OBSERVED.colour, 0.9), label="", layer=BEHIND)]
    rows = [distance(wv, implied) for _, implied, _ in models]
    for (name, _, stroke), row in zip(models, rows, strict=True):
        layer = MIDDLE if stroke is FIRST else ABOVE
        marks.append(Polyline(times, row, stroke=stroke, label=name, layer=layer))
    y = signed_axis(np.concatenate(rows), "Distance (confidence limit = 1)", linear=1.0, even=EVEN_DISTANCE, least=1.2)
    return Panel(x, y, tuple(marks), "Models above (+) and below (−) the data")


def distance(wv: WaveletVariance, implied: Vector) -> Vector:
    """Return ν²(θ̂) − ν̂² (J,) over the distance to the upper limit if positive, else to the lower; NaN without."""
    above = implied - wv.variance
    room = np.where(above > 0, wv.upper - wv.variance, wv.variance - wv.lower)
    limited = np.isfinite(room) & (room > 0)
    return np.where(limited, above / np.where(limited, room, 1.0), np.nan)


def _criteria(listed: Sequence[Candidate], strokes: dict[int, Stroke]) -> Panel:
    """Return the panel with the criterion of each candidate minus the best criterion, and the values as text."""
    places = np.arange(len(listed), 0, -1.0)
    name = _score_name(listed[0])
    marks: list[Mark] = []
    for candidate, place in zip(listed, places, strict=True):
        stroke = strokes.get(id(candidate), OTHER)
        at = np.array([candidate.difference])
        marks.append(Polyline(at, np.array([place]), stroke=replace(stroke, width=0.0), label="", layer=FRONT))
    ticks = [Tick(place, _row_name(c)) for c, place in zip(listed, places, strict=True)]
    numbers = [Tick(place, _numbers(c)) for c, place in zip(listed, places, strict=True)]
    head = Tick(len(listed) + 1.0, _NUMBERS if name == "WIC" else f"{name}; {_NUMBERS}")
    y = Axis("", (0.4, len(listed) + 1.4), tuple(ticks), grid=tuple(places), opposite=(*numbers, head), linear=np.inf)
    x = signed_axis(
        np.array([c.difference for c in listed]), f"{name} above the best", linear=EVEN_DIFFERENCE, even=EVEN_DISTANCE
    )
    return Panel(x, y, tuple(marks))


_NUMBERS = "WIC = loss + optimism"


def _numbers(candidate: Candidate) -> str:
    wic = candidate.wic
    text = f"{wic.value:.2f} = {wic.loss:.2f} + {wic.optimism:.2f}"
    if candidate.out_of_sample is not None:
        text = f"{candidate.out_of_sample:.2f}; {text}"
    return ", ".join(filter(None, [text, _word(candidate)]))


def _word(candidate: Candidate) -> str:
    return "recommended" if candidate.recommended else "equivalent" if candidate.equivalent else ""


def _name(candidate: Candidate) -> str:
    word = _word(candidate)
    name = model_text(candidate.model.terms)
    return f"{name} ({word})" if word else name


def _row_name(candidate: Candidate) -> str:
    """Return the name of a model as the label of its row, wrapped to leave space for the panel."""
    # The no-break space prevents lines that start with a plus sign.
    name = model_text(candidate.model.terms).replace(" + ", "\N{NO-BREAK SPACE}+ ")
    return "\n".join(wrap(name, 44, break_long_words=False)).replace("\N{NO-BREAK SPACE}", " ")


def _score_name(candidate: Candidate) -> str:
    return "WIC" if candidate.out_of_sample is None else "Loss out of sample"


@drawing
def plot_ranking(
    ranking: Ranking, *, limit: int = 4, view: ViewName = "auto", units: UnitSystem = "auto",
    path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw the best models with the data, their distances from the data, and the criteria.

    The curves of different models often look the same. The second panel shows their distances from the data, scaled
    so that the confidence limits are at −1 and 1. With several recordings, the mean wavelet variance is drawn.

    Parameters
    ----------
    limit : int
        Number of the best distinct candidates to draw. The recommended candidate is always drawn.

    Examples
    --------
    >>> from gmwm import QN, RW, WN, select
    >>> x = (WN(sigma2=4.0) + RW(gamma2=1e-3)).simulate(20_000, 100.0, rng=1)
    >>> figure = select(WN() + QN() + RW(), x, rate=100.0).plot()
    >>> figure.axes[2].get_xlabel()
    'WIC above the best'
    """
    if isinstance(limit, bool) or not isinstance(limit, (int, np.integer)) or not 1 <= limit <= MOST_CURVES:
        raise OptionError(argument="limit", expected=f"a whole number from 1 to {MOST_CURVES}", got=limit)
    drawn = [c for k, c in enumerate(ranking.distinct) if k < limit or c.recommended]
    others = iter(range(len(drawn)))
    strokes = [FIRST if c.recommended else _stroke(next(others)) for c in drawn]
    # Candidates that are equivalent to the best one are always drawn (tests/plots/test_plot_ranking.py).
    listed = [c for k, c in enumerate(ranking.distinct) if k < max(10, limit) or c.equivalent or c.recommended]
    rows = ((_curves(drawn, strokes, view, units), _distances(drawn, strokes, view, units)),)
    criteria = _criteria(listed, dict(zip(map(id, drawn), strokes, strict=True)))
    lines = max(_row_name(c).count("\n") + 1 for c in listed)
    heights = (64.0, 16.0 + (1.8 + 2.8 * lines) * len(listed))
    foot = 6.0 + 4.0 * ((len(drawn) + 4) // 3)
    recordings = len(ranking.best.fit.wavelet_variance.recordings)
    words = [axis_title(drawn[0].fit.wavelet_variance.axis), f"models within {model_text(ranking.within.terms)}"]
    if recordings > 1:
        words.append(f"mean of {recordings} recordings")
    title = ", ".join(filter(None, words))
    return Figure(
        rows=(*rows, (criteria,)), width=PAGE, height=sum(heights) + foot, title=title[:1].upper() + title[1:],
        legend_columns=3, heights=heights,
    )  # fmt: skip


@drawing
def plot_candidates(
    comparison: Comparison, *, view: ViewName = "auto", units: UnitSystem = "auto",
    path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw the two candidates with the data, and their distances from the data.

    The title states the difference of the criteria. With several recordings, the mean wavelet variance is drawn."""
    pair = (comparison.first, comparison.second)
    strokes = [FIRST, _stroke(0)]
    curves = _curves(pair, strokes, view, units)
    names = " against ".join(model_text(c.model.terms) for c in pair)
    name, scores = _score_name(pair[0]), [(c.wic.value if c.out_of_sample is None else c.out_of_sample) for c in pair]
    difference = with_minus(f"{round(comparison.difference, 2) + 0.0:.2f} ± {comparison.error:.2f}")
    title = f"{names}\n{name} {scores[0]:.2f} against {scores[1]:.2f}, difference {difference}"
    heights = (74.0, 56.0)
    panels = ((curves,), (_distances(pair, strokes, view, units),))
    return Figure(
        rows=panels, width=SINGLE_WIDTH_MM, height=sum(heights) + 20.0, title=title, legend_columns=2, heights=heights
    )
