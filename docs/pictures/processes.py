"""What each process looks like: over time, in its wavelet variance and in its Allan deviation, a picture each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

import gmwm
from gmwm.showing.plots.figure import Figure, Panel
from gmwm.showing.plots.fit import fit_panel
from gmwm.showing.plots.labels import ViewName
from gmwm.showing.plots.matplotlib import draw
from gmwm.showing.plots.series import signal_panel

RATE = 100.0
SAMPLES = 60_000
WIDTH, HEIGHT = 52.0, 50.0
"""Of a picture (mm): three stand side by side in a column of text."""


@dataclass(frozen=True)
class Shown:
    """A process, and how many seconds of it tell the most."""

    model: str
    seconds: float
    seed: int


PROCESSES = {
    "wn": Shown("WN(sigma2=4e-6)", 2, 1),
    "qn": Shown("QN(q2=1e-6)", 2, 2),
    "rw": Shown("RW(gamma2=1e-10)", 600, 3),
    "dr": Shown("DR(omega=2e-9)", 600, 4),
    "gm": Shown("GM(beta=1.0, sigma2=1e-6)", 30, 5),
    "fn": Shown("FN(b2=1e-7)", 600, 6),
    "pl": Shown("PL(alpha=1.5, nu2=1e-8)", 600, 7),
    "mat": Shown("MAT(beta=1.0, nu=2.5, sigma2=1e-6)", 30, 8),
    "osc": Shown("OSC(frequency=0.5, quality=10.0, sigma2=2e-6)", 30, 11),
    "ar": Shown("AR(2, phi1=1.8, phi2=-0.9, sigma2=1e-7)", 2, 9),
    "sin": Shown("SIN(frequency=0.5, power=2e-6)", 10, 10),
}
"""By the name of its pictures."""


@dataclass(frozen=True)
class Truth:
    """A model that nobody had to fit, to be drawn as a fit is."""

    model: gmwm.Model
    wavelet_variance: gmwm.WaveletVariance
    decomposition: Mapping[str, np.ndarray] = field(default_factory=dict)
    diagnostics: None = None

    @property
    def implied(self) -> np.ndarray:
        """Its curve (J,)."""
        return self.model.wavelet_variance(self.wavelet_variance.levels, RATE)


def panels(shown: Shown) -> Iterator[tuple[str, Panel]]:
    """The three panels of a process, by the ends of their names."""
    model = gmwm.Model.parse(shown.model)
    signal = gmwm.simulate_signal(model, rate=RATE, samples=SAMPLES, rng=shown.seed, unit="rad/s").signal
    stretch = gmwm.Signal(signal.values[: round(shown.seconds * RATE)], RATE, "rad/s")
    panel = signal_panel(stretch, width=WIDTH)
    unit = panel.x.label[panel.x.label.rindex("(") :]
    yield "time", replace(panel, x=replace(panel.x, label=f"Time {unit}"), title="Over time")
    truth = Truth(model, gmwm.wavelet_variance(signal))
    titles: dict[ViewName, str] = {"wavelet": "Wavelet variance", "allan": "Allan deviation"}
    for view, title in titles.items():
        panel = fit_panel(truth, view=view, decomposition=False)
        # What is what stands in the text: a legend would take a third of the picture.
        marks = tuple(replace(mark, label="") for mark in panel.marks)
        yield view, replace(panel, x=replace(panel.x, opposite=()), title=title, marks=marks)


def write(folder: Path) -> list[Path]:
    """All of them."""
    written = []
    for name, shown in PROCESSES.items():
        for end, panel in panels(shown):
            written.append(folder / f"process-{name}-{end}.svg")
            draw(Figure(((panel,),), width=WIDTH, height=HEIGHT), path=written[-1])
    return written
