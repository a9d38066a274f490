"""The simulated recordings of the test of equivalence."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtri, ndtr

from gmwm.choosing.selection.equivalence import QUANTILE_DEGREE, drawn_errors, factor_of


def test_errors_are_chi_square_quantiles_of_correlated_normal_scores():
    # Degrees of freedom from 0.7 to a million, as at the coarsest and the finest level of a long recording.
    freedom = np.array([1e6, 3e4, 1e3, 60.0, 12.0, 3.0, 1.0, 0.7])
    curve = np.geomspace(1e-8, 1e-3, freedom.size)
    deviation = curve * np.sqrt(2 / freedom)
    apart = np.subtract.outer(np.arange(freedom.size), np.arange(freedom.size))
    wavelet = np.outer(deviation, deviation) * 0.6 ** np.abs(apart)
    for draws in (QUANTILE_DEGREE // 2, 1000, 5000):
        normal = np.random.default_rng(3).standard_normal((draws, curve.size))
        scores = normal @ factor_of(wavelet).T / deviation
        errors = drawn_errors(curve, wavelet, draws, seed=3)
        expected = curve * (chdtri(freedom, ndtr(-scores)) / freedom - 1)
        np.testing.assert_allclose(errors / curve, expected / curve, rtol=0, atol=1e-12)
        assert np.all(errors >= -curve * (1 + 1e-12))
