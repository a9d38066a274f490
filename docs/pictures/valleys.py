"""A criterion with two valleys: one Gauss-Markov process fitted to the data of two, along its β."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import gmwm
from gmwm.showing.plots.axes import even_axis, time_axis
from gmwm.showing.plots.figure import Figure, Panel, Polyline, Stroke
from gmwm.showing.plots.matplotlib import draw
from gmwm.showing.plots.style import BLUE, VERMILLION

TRUTH = "GM(beta=10, sigma2=1e-6) + GM(beta=0.05, sigma2=2e-7) + WN(sigma2=4e-6)"
RATE, SAMPLES, SEED = 100.0, 360_000, 1


def write(folder: Path) -> list[Path]:
    """The criterion where β is held, all else at its best for it; and where `fit` ends."""
    signal = gmwm.simulate_signal(TRUTH, rate=RATE, samples=SAMPLES, rng=SEED).signal
    wv = gmwm.wavelet_variance(signal)
    best = gmwm.fit("GM + WN", wv)
    held = np.geomspace(2e-3, 100, 120)
    models = [gmwm.GM(beta=gmwm.fixed(float(beta))) + gmwm.WN() for beta in held]
    criterion = np.array([gmwm.fit(model, wv, weighting=best.weighting_matrix).objective for model in models]) / 1000
    found = np.array([best.parameters["GM.beta"]])
    least, dot = np.array([best.objective / 1000]), Stroke(VERMILLION, 0.0, symbol="circle")
    marks = (
        Polyline(held, criterion, Stroke(BLUE, 1.4), "The criterion where β is held, all else at its best"),
        Polyline(found, least, dot, "The fit, proven best", 1),
    )
    x = replace(time_axis(held, "β (1/s)"), opposite=())
    panel = Panel(x, even_axis(0.0, float(criterion.max()), "Criterion (thousands)", margin=0.03, at_most=5), marks)
    path = folder / "valleys.svg"
    draw(Figure(((panel,),), height=70.0), path=path)
    return [path]
