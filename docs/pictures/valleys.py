"""An objective with two minima: one Gauss-Markov process fitted to the data of two, along its β."""

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
    """The smallest objective for each fixed β, over all other parameters, and the result of `fit`."""
    signal = gmwm.simulate_signal(TRUTH, rate=RATE, samples=SAMPLES, rng=SEED).signal
    wv = gmwm.wavelet_variance(signal)
    best = gmwm.fit("GM + WN", wv)
    held = np.geomspace(2e-3, 100, 120)
    models = [gmwm.GM(beta=gmwm.fixed(float(beta))) + gmwm.WN() for beta in held]
    objective = np.array([gmwm.fit(model, wv, weighting=best.weighting_matrix).objective for model in models]) / 1000
    found = np.array([best.parameters["GM.beta"]])
    least, dot = np.array([best.objective / 1000]), Stroke(VERMILLION, 0.0, symbol="circle")
    marks = (
        Polyline(held, objective, Stroke(BLUE, 1.4), "Smallest objective with this β"),
        Polyline(found, least, dot, "Global minimum, which the fit finds", 1),
    )
    x = replace(time_axis(held, "β of the Gauss-Markov process (1/s)"), opposite=())
    y = even_axis(0.0, float(objective.max()), "Objective / 1000 (no unit)", margin=0.03, at_most=5)
    panel = Panel(x, y, marks)
    path = folder / "valleys.svg"
    draw(Figure(((panel,),), height=70.0), path=path)
    return [path]
