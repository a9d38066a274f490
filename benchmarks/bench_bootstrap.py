"""Wavelet variances of simulated paths against the drawing of as many normals: no bootstrap can do with less.

Both on one thread; the normals come from NumPy's default generator into one array that the cache holds.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness import Case
from gmwm.fitting.estimation.simulated_curves import simulated_variances
from gmwm.measuring.covariance.design import Design
from gmwm.theory import filters
from gmwm.theory.processes import Model

SAMPLES, DRAWS = 10**5, 20
MODELS = (
    "WN(sigma2=1.0)",
    "QN(q2=1.0)",
    "RW(gamma2=0.01)",
    "GM(beta=1.0, sigma2=1.0)",
    "WN(sigma2=1.0) + GM(beta=1.0, sigma2=1.0)",
    "QN(q2=1.0) + WN(sigma2=1.0) + GM(beta=1.0, sigma2=1.0) + RW(gamma2=0.01)",
)


def design(samples: int, efficiency: float | None = None, filter: filters.WaveletFilter = filters.HAAR) -> Design:
    levels = np.arange(1, filter.deepest_level(samples) + 1)
    return Design(levels, samples, 100.0, filter, efficiency=efficiency)


def normals(rng: np.random.Generator, buffer: NDArray[np.float64], times: int) -> None:
    for _ in range(times):
        rng.standard_normal(out=buffer)


def cases() -> Iterable[Case]:
    """Each process at 10^5 samples, sums of them, other lengths, filters and estimators, and a second thread."""
    rng, buffer = np.random.default_rng(1), np.empty(SAMPLES)
    for text in MODELS:
        model = Model.parse(text)
        terms = len(model.processes)
        run = partial(simulated_variances, model, design(SAMPLES), DRAWS, 1, threads=1)
        draw = partial(normals, rng, buffer, DRAWS * terms)
        name = f"{DRAWS} paths of {model.structure}, 10^5 samples"
        yield Case(name, run, "as many normals", draw, 9, 1.5, items=DRAWS * SAMPLES * terms)

    model = Model.parse(MODELS[4])
    for samples, draws in ((1000, 2620), (10**6, 4)):
        run = partial(simulated_variances, model, design(samples), draws, 1, threads=1)
        draw = partial(normals, rng, buffer, 2 * draws * samples // SAMPLES)
        name = f"{draws} paths of {model.structure}, {samples} samples"
        yield Case(name, run, "as many normals", draw, 9, 1.5, items=2 * draws * samples)

    draw = partial(normals, rng, buffer, 2 * DRAWS)
    for name, kind in (
        ("efficiency 0.6", design(SAMPLES, 0.6)),
        ("filter la8", design(SAMPLES, filter=filters.find_filter("la8"))),
    ):
        run = partial(simulated_variances, model, kind, DRAWS, 1, threads=1)
        yield Case(f"the same of 10^5 samples, {name}", run, "as many normals", draw, 5, items=2 * DRAWS * SAMPLES)

    one, two = (partial(simulated_variances, model, design(SAMPLES), 40, 1, threads=threads) for threads in (1, 2))
    yield Case(f"40 paths of {model.structure}, two threads", two, "one thread", one, 9)
