"""A term that is estimated as zero is not known to be absent: its neighbours' errors must leave room for it."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from gmwm import Model, fit
from gmwm.base.errors import FitWarning
from gmwm.fitting.estimation.asymptotic import sandwich_of
from gmwm.measuring.covariance import Design, wavelet_covariance

TRUTH = Model.parse("GM(beta=180.0, sigma2=3e-5) + WN(sigma2=5e-6)")


def test_errors_are_those_of_a_term_that_is_free() -> None:
    design = Design(np.arange(1, 15), samples=20_000, rate=100.0)
    zero = Model.parse("GM(beta=180.0, sigma2=3e-5) + WN(sigma2=0.0)")
    tiny = Model.parse("GM(beta=180.0, sigma2=3e-5) + WN(sigma2=1e-20)")
    wavelet = wavelet_covariance(zero, 20_000, 100.0)
    matrix = np.diag(1 / np.diag(wavelet))
    at_zero = sandwich_of(zero, design, matrix, wavelet)
    near_zero = sandwich_of(tiny, design, matrix, wavelet)
    absent = sandwich_of(Model.parse("GM(beta=180.0, sigma2=3e-5)"), design, matrix, wavelet)
    assert at_zero.names == absent.names == ("GM.beta", "GM.sigma2")
    np.testing.assert_allclose(at_zero.relative, near_zero.relative[:2, :2], rtol=1e-9)
    assert np.all(np.diag(at_zero.relative) > 4 * np.diag(absent.relative))


@pytest.mark.slow
def test_intervals_hold_the_truth_beside_a_term_that_came_out_as_zero() -> None:
    held, zeros = 0, 0
    for seed in range(60):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FitWarning)
            found = fit("GM + WN", TRUTH.simulate(20_000, 100.0, seed), 100.0, certify=False)
        if "WN" not in found.diagnostics.not_supported:
            continue
        zeros += 1
        low, high = found.confidence_intervals()["GM.sigma2"]
        held += low <= 3e-5 <= high
    # It was none of them, when the errors were those of a model without the term.
    assert zeros >= 10
    assert held >= 0.9 * zeros
