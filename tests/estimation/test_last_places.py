"""No decision depends on the last place of a number: a processor may sum in another order."""

import numpy as np
import pytest

import gmwm
from gmwm import GM, RW, Model, WaveletVariance
from tests.helpers import each

pytestmark = pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
RATE = 100.0
EPS = np.finfo(float).eps
TRUTHS = {
    "GM": ("WN(sigma2=1e-6)", {"GM": "WN"}),
    "GM + RW": ("WN(sigma2=1e-6) + RW(gamma2=1e-12)", {"GM": "WN"}),
    "GM + WN": ("WN(sigma2=1e-6) + RW(gamma2=1e-12)", {"GM": "RW"}),
    "GM + QN + RW": ("WN(sigma2=1e-6) + QN(q2=1e-6) + RW(gamma2=1e-12)", {"GM": "WN"}),
}


def rounded(curve, rng):
    """The curve with another last place at every level."""
    return curve * (1 + EPS * rng.integers(-2, 3, curve.size))


@each("weighting", ["diagonal", "optimal"])
@each(("samples", "levels"), [(2**18, 16), (2**24, 22)])
@each("model", TRUTHS)
def test_what_a_term_acts_as_does_not_depend_on_the_last_place(model, samples, levels, weighting):
    truth, acts_as = TRUTHS[model]
    curve, rng = Model.parse(truth).wavelet_variance(levels, RATE), np.random.default_rng(1)
    for _ in range(4):
        wv = WaveletVariance.from_values(rounded(curve, rng), samples=samples, rate=RATE)
        fit = gmwm.fit(model, wv, weighting=weighting)
        assert fit.diagnostics.acts_as == acts_as
        assert fit.diagnostics.not_supported == ()


def test_a_term_that_differs_from_the_end_of_its_domain_does_not_act_as_it():
    truth = GM(beta=500.0, sigma2=1e-6) + RW(gamma2=1e-12)
    wv = WaveletVariance.from_values(truth.wavelet_variance(16, RATE), samples=2**18, rate=RATE)
    for weighting in ("diagonal", "optimal"):
        fit = gmwm.fit("GM + RW", wv, weighting=weighting)
        assert fit.diagnostics.acts_as == {}
        assert fit.parameters["GM.beta"] == pytest.approx(500.0, rel=1e-6)
