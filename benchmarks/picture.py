"""The picture of the benchmarks: time of a sample, cost of terms and of axes, memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.results import Results, Row
from gmwm.showing.plots import style
from gmwm.showing.plots.axes import limits_of, power_ticks
from gmwm.showing.plots.figure import Axis, Figure, Panel, Polyline, Stroke, Tick

WIDTH, HEIGHT = 180.0, 190.0

MEMORY, PIECES = "wavelet variance, in memory", "wavelet variance, in chunks"
FITTED = "certified fit from the samples"

# Ours are solid with filled symbols, those of others broken with open ones.
STROKES = {
    MEMORY: Stroke(style.BLUE, 1.6, symbol="circle"),
    PIECES: Stroke(style.VERMILLION, 1.6, symbol="square"),
    "robust wavelet variance": Stroke(style.GREEN, 1.2, symbol="down"),
    FITTED: Stroke(style.WINE, 1.2, symbol="star"),
    "copy (np.copyto)": Stroke(style.BLACK, 1.2, style.DOTTED),
    "np.cumsum": Stroke(style.GREY, 1.2, style.DASHED),
    "NumPy pyramid": Stroke(style.ORANGE, 1.0, style.LONG, "triangle", filled=False),
    "allantools.oadev": Stroke(style.PURPLE, 1.0, style.DASH_DOT, "diamond", filled=False),
    "pywt.swt": Stroke(style.OLIVE, 1.0, style.SHORT, "circle", filled=False),
    "certified fit": Stroke(style.WINE, 1.2, symbol="circle"),
    "fit without certificate": Stroke(style.WINE, 1.0, style.DASHED, "circle", filled=False),
    "exact covariance": Stroke(style.INDIGO, 1.2, style.DASH_DOT, "square"),
    "choice within k GM + WN + QN + RW + DR": Stroke(style.BROWN, 1.2, style.LONG, "triangle"),
    "calibration, one thread": Stroke(style.FOREST, 1.2, style.DASHED, "diamond", filled=False),
    "calibration, two threads": Stroke(style.FOREST, 1.2, symbol="diamond"),
}


def figure(results: Results) -> Figure:
    """Four panels: the first over the whole width."""
    below = (_terms(results), _axes(results), _memory(results))
    return Figure(((_samples(results),), below), WIDTH, HEIGHT, legend_columns=3, heights=(1.25, 1.0))


def draw(results: Results, path: Path) -> None:
    """Write the picture."""
    from gmwm.showing.plots.matplotlib import draw as drawn

    drawn(figure(results), path=path)


def _samples(results: Results) -> Panel:
    lines = []
    for curve in _along(results, "samples"):
        x = np.array(curve["at"], dtype=np.float64)
        y = 1e9 * np.array(curve["seconds"]) / x
        lines.append(Polyline(x, y, STROKES[curve["name"]], curve["name"]))
    return Panel(_logarithmic("Samples", [line.x for line in lines]),
                 _logarithmic("Time of a sample (ns)", [line.y for line in lines]), tuple(lines))  # fmt: skip


def _terms(results: Results) -> Panel:
    lines = _lines(_along(results, "terms"), 1e3)
    x = _whole("Gauss-Markov terms", max(int(line.x[-1]) for line in lines))
    return Panel(x, _logarithmic("Time (ms)", [line.y for line in lines]), tuple(lines), "10⁶ samples, 19 levels")


def _axes(results: Results) -> Panel:
    lines = _lines(_along(results, "axes"), 1.0)
    top = 1.1 * max(float(line.y.max()) for line in lines)
    step = next(s for s in (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0) if top / s <= 6)
    values = [step * k for k in range(int(top / step) + 1)]
    y = Axis("Time (s)", (0.0, top), tuple(Tick(v, f"{v:g}") for v in values), grid=tuple(values), linear=np.inf)
    x = _whole("Axes of 10⁶ samples", max(int(line.x[-1]) for line in lines))
    return Panel(x, y, tuple(lines), "within GM + WN + RW")


def _memory(results: Results) -> Panel:
    lines = []
    for name in (MEMORY, PIECES):
        rows = sorted((row for row in results.children if row["name"] == name), key=lambda row: row["samples"])
        x, y = (np.array([row[key] for row in rows], dtype=np.float64) for key in ("samples", "beyond"))
        lines.append(Polyline(x, y / 1e6, STROKES[name], name))
    return Panel(_logarithmic("Samples", [line.x for line in lines], at_most=4),
                 _logarithmic("Memory beyond import (MB)", [line.y for line in lines]), tuple(lines))  # fmt: skip


def _along(results: Results, along: str) -> list[Row]:
    return [curve for curve in results.curves if curve["along"] == along]


def _lines(curves: list[Row], scale: float) -> list[Polyline]:
    return [
        Polyline(np.array(c["at"], dtype=np.float64), scale * np.array(c["seconds"]), STROKES[c["name"]], c["name"])
        for c in curves
    ]


def _logarithmic(label: str, values: list[np.ndarray], at_most: int = 8) -> Axis:
    limits = limits_of(np.concatenate(values), margin=0.03)
    ticks, minor = power_ticks(limits, at_most=at_most)
    return Axis(label, limits, ticks, minor, tuple(tick.value for tick in ticks))


def _whole(label: str, most: int) -> Axis:
    ticks = tuple(Tick(float(k), str(k)) for k in range(1, most + 1))
    return Axis(label, (0.7, most + 0.3), ticks, grid=tuple(tick.value for tick in ticks), linear=np.inf)
