"""Fits of processes beyond the inertial ones, from samples, against `numpy.cumsum` of 10^6 numbers."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import numpy as np

import gmwm
from benchmarks.harness import Case

MODELS = (
    ("WN(sigma2=4) + FN(b2=0.1) + RW(gamma2=1e-6)", 10**6, 15),
    ("AR(2, phi1=1.4, phi2=-0.6, sigma2=1)", 20_000, 5),
)


def cases() -> Iterable[Case]:
    """Flicker noise between white noise and a walk; an autoregression."""
    buffer = np.empty(10**6)
    cumsum = partial(np.cumsum, np.random.default_rng(2).standard_normal(10**6), out=buffer)
    for text, samples, repeats in MODELS:
        model = gmwm.Model.parse(text)
        x = model.simulate(samples, 100.0, np.random.default_rng(1))
        run = partial(gmwm.fit, model.structure, x, 100.0)
        yield Case(f"fit of {model.structure} to {samples} samples", run, "np.cumsum of 10^6", cumsum, repeats)
