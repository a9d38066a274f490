"""The paper's Appendix A: a fit of 3·GM from data, by way of starting, against `numpy.cumsum` of 10^6 numbers.

What each start reaches is in docs/validation/starts.md.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from functools import partial

import numpy as np

import gmwm
from benchmarks.harness import Case

RATE = 100.0
TRUTH = gmwm.Model.parse("GM(beta=20.0, sigma2=1e-6) + GM(beta=1.0, sigma2=1e-6) + GM(beta=0.05, sigma2=1e-6)")
LENGTHS = (100, 1_000, 10_000, 100_000, 1_000_000)
DRAWS = (1_000, 10_000, 20_000)


def cases() -> Iterable[Case]:
    """Measuring and fitting, with the paper's weights (upper − lower)⁻² held; the convex route with its proof."""
    buffer = np.empty(10**6)
    cumsum = partial(np.cumsum, np.random.default_rng(2).standard_normal(10**6), out=buffer)
    for robust in (False, True):
        for n in LENGTHS[robust:]:
            x = TRUTH.simulate(n, RATE, np.random.default_rng(1))
            name = f"3*GM, {'robust' if robust else 'classical'}, N = {n}"
            yield Case(f"{name}: convex", partial(_fit, x, robust, None, False), "np.cumsum of 10^6", cumsum, 11)
            yield Case(f"{name}: exact values", partial(_fit, x, robust, None, True), "np.cumsum of 10^6", cumsum, 11)
            for draws in DRAWS:
                run = partial(_fit, x, robust, gmwm.estimation.Sampled(draws, rng=1), False)
                yield Case(f"{name}: {draws} draws", run, "np.cumsum of 10^6", cumsum, 11)


def _fit(x: gmwm.Signal, robust: bool, start: gmwm.estimation.Sampled | None, exact: bool) -> gmwm.Fit:
    wv = gmwm.wavelet_variance(x, RATE, robust=robust)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gmwm.errors.FitWarning)
        return gmwm.fit(
            TRUTH if exact else TRUTH.structure, wv, weighting=(wv.upper - wv.lower) ** -2.0,
            certify=start is None, start=start,
        )  # fmt: skip
