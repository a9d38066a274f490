"""The test of a likelihood fit by the wavelet variance. All noise is simulated with NumPy."""

import numpy as np
import pytest
from scipy.signal import lfilter

import gmwm
from gmwm.base.errors import FitWarning
from tests.helpers import codes, only

pytestmark = pytest.mark.slow

RATE, N = 100.0, 40_000
WALK = 3e-3


def flicker(rng):
    f = np.fft.rfftfreq(2 * N)
    shape = np.concatenate([[0.0], f[1:] ** -0.5])
    return 0.05 * np.fft.irfft(np.fft.rfft(rng.normal(size=2 * N)) * shape)[:N]


def markov(rng):
    pulls = np.sqrt(0.05) * rng.normal(size=N)
    pulls[0] = rng.normal() / np.sqrt(2)
    return lfilter([1.0], [1.0, -np.sqrt(1 - 0.1)], pulls)


def walk(rng, size=WALK):
    return np.cumsum(size * rng.normal(size=N))


def losses(x, rng, share=0.03):
    return np.where(rng.random(N) < share, np.nan, x)


@pytest.mark.parametrize("share", [0.0, 0.03])
def test_flicker_noise_that_is_not_in_the_model_has_a_remark(share):
    """The random walk is several times too large, and the residuals are white."""
    above = 0
    for seed in range(4):
        rng = np.random.default_rng([1, seed])
        x = losses(rng.normal(size=N) + flicker(rng) + walk(rng, WALK / 3), rng, share)
        with pytest.warns(FitWarning):
            found = gmwm.fit_ml("WN + RW", x, RATE)
        remark = only(found.remarks, "likelihood-misfit")
        assert remark.facts["pvalue"] < 1e-3
        above += (remark.facts["side"], remark.facts["tau"].value > 10) == ("above", True)
        assert found.parameters["RW.gamma2"] > 4 * (WALK / 3) ** 2
    assert above >= 3


def test_with_flicker_noise_in_the_model_the_walk_is_right():
    walks = []
    for seed in range(4):
        rng = np.random.default_rng([2, seed])
        x = losses(rng.normal(size=N) + flicker(rng) + walk(rng), rng)
        with pytest.warns(FitWarning):  # the state space of flicker noise is approximate
            found = gmwm.fit_ml("FN + WN + RW", x, RATE)
        assert "likelihood-misfit" not in codes(found.remarks)
        walks.append(found.parameters["RW.gamma2"] / WALK**2)
    assert 0.5 < np.median(walks) < 2


def test_right_models_have_none():
    """At most 0.1 % of the fits of a right model have the remark; the test is conservative."""
    found = []
    for seed in range(24):
        rng = np.random.default_rng([3, seed])
        white = rng.normal(size=N)
        for model, x in (("WN + RW", white + walk(rng)), ("GM + WN", white + markov(rng))):
            found += codes(gmwm.fit_ml(model, losses(x, rng, 0.01 * (seed % 2)), RATE, start=STARTS[model]).remarks)
    assert found.count("likelihood-misfit") <= 1


STARTS = {"WN + RW": "WN(sigma2=1.0) + RW(gamma2=1e-6)", "GM + WN": "GM(beta=5.0, sigma2=0.5) + WN(sigma2=1.0)"}
