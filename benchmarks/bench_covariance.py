"""The exact covariance of the wavelet variance, 19 levels of 10^6 samples, against `numpy.cumsum` of 10^6 numbers."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import numpy as np

import gmwm
from benchmarks.harness import Case
from gmwm.measuring.covariance import Design, variances

MODELS = (
    "WN(sigma2=1e-6) + QN(q2=2e-6) + RW(gamma2=1e-13)",
    "GM(beta=0.5, sigma2=3e-8) + WN(sigma2=1e-6) + QN(q2=2e-6) + RW(gamma2=1e-13)",
    "GM(beta=10.0, sigma2=2e-7) + GM(beta=0.5, sigma2=3e-8) + GM(beta=0.02, sigma2=3e-8) + WN(sigma2=1e-6)"
    " + QN(q2=2e-6) + RW(gamma2=1e-13)",
)
# A resonance: products of oscillating exponentials.
RESONANCE = (
    "AR(2, phi1=1.2, phi2=-0.5, sigma2=1e-6) + GM(beta=0.5, sigma2=2e-6) + GM(beta=0.01, sigma2=1e-6)"
    " + RW(gamma2=1e-13)"
)
# The resonance lasts for thousands of samples.
LASTING = "AR(2, phi1=1.9, phi2=-0.9985, sigma2=1) + WN(sigma2=1)"
SLOW = "GM(beta=10.0, sigma2=1) + GM(beta=0.5, sigma2=1) + GM(beta=0.02, sigma2=1) + RW(gamma2=1e-8)"


def resonances() -> gmwm.Model:
    """Return ARMA(10,10) + 3*GM + RW, with the modulus of a root as near to 1 as 1 − 1e-9."""
    roots = [(1 - lost) * np.exp(1j * angle) for lost, angle in ((1e-9, 0.3), (1e-6, 0.5), (1e-3, 0.9), (0.01, 1.5))]
    roots = [*roots, 0.9 * np.exp(2.5j)]
    zeros = [
        *(0.9 * np.exp(0.4j * np.array([1, -1]))),
        *(0.2 * np.exp(1j * np.array([1, -1]))),
        0.5,
        -0.5,
        0.3,
        0.8,
        -0.8,
        0.1,
    ]
    phi, theta = -np.poly([*roots, *np.conj(roots)]).real[1:], np.poly(zeros).real[1:]
    process = gmwm.processes.ARMA(phi=phi.tolist(), theta=theta.tolist(), sigma2=1.0)
    return gmwm.Model((process, *gmwm.Model.parse(SLOW).processes))


def cases() -> Iterable[Case]:
    """190 pairs of levels; then the diagonal alone, and the robust estimate, of the last model."""
    buffer = np.empty(10**6)
    cumsum = partial(np.cumsum, np.random.default_rng(1).standard_normal(10**6), out=buffer)
    for text in MODELS:
        model = gmwm.Model.parse(text)
        run = partial(gmwm.covariance.wavelet_covariance, model, 10**6, 100.0)
        yield Case(f"covariance of {model.structure}", run, "np.cumsum of 10^6", cumsum, 15, 15.0)
    design = Design(np.arange(1, 20), 10**6, 100.0)
    yield Case("its diagonal", partial(variances, model, design), "np.cumsum of 10^6", cumsum, 15, 1.5)
    run = partial(gmwm.covariance.wavelet_covariance, model, 10**6, 100.0, robust=True)
    yield Case("the same, robust", run, "np.cumsum of 10^6", cumsum, 15, 15.0)
    model = gmwm.Model.parse(RESONANCE)
    run = partial(gmwm.covariance.wavelet_covariance, model, 10**6, 100.0)
    yield Case(f"covariance of {model.structure}", run, "np.cumsum of 10^6", cumsum, 15, 6.0)
    model = gmwm.Model.parse(LASTING)
    run = partial(gmwm.covariance.wavelet_covariance, model, 10**6, 100.0)
    yield Case(f"covariance of {model.structure} that lasts long", run, "np.cumsum of 10^6", cumsum, 15, 6.0)
    model = resonances()
    run = partial(gmwm.covariance.wavelet_covariance, model, 10**6, 100.0)
    yield Case(f"covariance of {model.structure}", run, "np.cumsum of 10^6", cumsum, 15, 15.0)
    model = gmwm.Model((*model.processes, gmwm.FN(b2=0.1)))
    run = partial(gmwm.covariance.wavelet_covariance, model, 10**6, 100.0)
    yield Case(f"covariance of {model.structure}", run, "np.cumsum of 10^6", cumsum, 15)
