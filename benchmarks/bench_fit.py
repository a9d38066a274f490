"""Fitting 3·GM + WN + QN + RW and models with a resonance, against `numpy.cumsum` of 10^6 numbers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import partial

import numpy as np

import gmwm
from benchmarks.harness import Case

RATE = 100.0
TRUTH = gmwm.Model.parse(
    "GM(beta=10.0, sigma2=2e-7) + GM(beta=0.5, sigma2=3e-8) + GM(beta=0.02, sigma2=3e-8) + WN(sigma2=1e-6)"
    " + QN(q2=2e-6) + RW(gamma2=1e-13)"
)
OPTIMAL = "fit with optimal weights, certified"
INTERVALS = "confidence intervals of the fit"
GOODNESS = "goodness of fit of the fit"
WHOLE = "fit of AR(2) + 2*GM + RW with intervals and test"
RESONANT = (
    "AR(2, phi1=1.2, phi2=-0.5, sigma2=1e-6) + GM(beta=0.5, sigma2=2e-6) + GM(beta=0.01, sigma2=1e-6)"
    " + RW(gamma2=1e-13)"
)


def cases() -> Iterable[Case]:
    """One recording of 10^6 samples, 19 levels."""
    x = TRUTH.simulate(10**6, RATE, np.random.default_rng(1))
    buffer = np.empty_like(x)
    wv = gmwm.wavelet_variance(x, RATE)
    cumsum = partial(np.cumsum, x, out=buffer)
    model = TRUTH.structure
    for name, target, run in (
        ("fit from a wavelet variance, no certificate", 25.0, partial(gmwm.fit, model, wv, certify=False)),
        ("fit from a wavelet variance, certified", 30.0, partial(gmwm.fit, model, wv)),
        ("from 10^6 samples to a certified fit", 30.0, partial(gmwm.fit, model, x, RATE)),
    ):
        yield Case(name, run, "np.cumsum of 10^6", cumsum, 31, target)
    optimal = partial(gmwm.fit, model, wv, weighting="optimal")
    yield Case(OPTIMAL, optimal, "np.cumsum of 10^6", cumsum, 7)
    fit = gmwm.fit(model, wv)
    yield Case(INTERVALS, partial(_intervals, fit), "np.cumsum of 10^6", cumsum, 21)
    yield Case(GOODNESS, partial(_goodness_of_fit, fit), "np.cumsum of 10^6", cumsum, 21)
    resonant = gmwm.Model.parse(RESONANT)
    curve = gmwm.wavelet_variance(resonant.simulate(10**6, RATE, np.random.default_rng(2)), RATE)
    for text, target in (("AR(2) + 2*GM + RW", 45.0), ("ARMA(2,1) + 2*GM + RW", 90.0)):
        yield Case(f"fit of {text}", partial(gmwm.fit, text, curve), "np.cumsum of 10^6", cumsum, 11, target)
    yield Case(WHOLE, partial(_fit_and_test, "AR(2) + 2*GM + RW", curve), "np.cumsum of 10^6", cumsum, 11)
    found = gmwm.fit("AR(2) + 2*GM + RW", curve)
    run = partial(_goodness_of_fit, found)
    yield Case("goodness of fit of AR(2) + 2*GM + RW", run, "np.cumsum of 10^6", cumsum, 11, 30.0)
    given = (wv.upper - wv.lower) ** -2.0
    run = partial(gmwm.fit, model, wv, weighting=given)
    yield Case("fit with weights given, certified", run, "np.cumsum of 10^6", cumsum, 31)


def _fit_and_test(model: str, curve: gmwm.WaveletVariance) -> None:
    fit = gmwm.fit(model, curve)
    fit.confidence_intervals()
    fit.goodness_of_fit()


def _intervals(fit: gmwm.Fit) -> None:
    replace(fit).confidence_intervals()


def _goodness_of_fit(fit: gmwm.Fit) -> None:
    # A fit keeps its test; this is a copy without it.
    replace(fit).goodness_of_fit()
