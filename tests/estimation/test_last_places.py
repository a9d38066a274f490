"""No decision depends on the last place of a number: a processor may sum in another order."""

import numpy as np
import pytest

import gmwm
from gmwm import GM, MA, RW, Model, WaveletVariance
from gmwm.fitting.estimation.reweighting import nearly_settled
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


@each("seed", [2, 5])
def test_a_comparison_of_models_does_not_depend_on_the_last_place(seed):
    """A descent from the optimum under weights of the data moved the objective by up to 2e-5."""
    truth = Model.parse("FN(b2=2.5e-8) + RW(gamma2=1e-12) + MA(1, theta1=0.2, sigma2=4e-5)")
    scatter = gmwm.covariance.wavelet_covariance(truth, 10**6, RATE)[:18, :18]
    noise = np.linalg.cholesky(scatter) @ np.random.default_rng(seed).standard_normal(18)
    curve, rng = truth.wavelet_variance(18, RATE) + noise, np.random.default_rng(1)
    model = Model((*Model.parse("4*GM + FN + RW + DR").processes, MA(1, theta1=gmwm.fixed(0.2))))
    fits = []
    for _ in range(4):
        settled, _ = nearly_settled(model, WaveletVariance.from_values(rounded(curve, rng), 10**6, RATE), "optimal")
        fits.append(settled.solution.objective)
    np.testing.assert_allclose(fits, fits[0], rtol=1e-7)
