"""Processes without a search: local optima from a scan, and from the paper's draws."""

import warnings
from dataclasses import dataclass

import numpy as np
import pytest

import gmwm
from gmwm import GM, RW, WN, fixed
from gmwm.base.errors import FitWarning
from gmwm.fitting.estimation import Sampled
from gmwm.theory.processes import Parameter
from tests.helpers import raises

SIGMA2 = Parameter("sigma2", "σ²", "variance", signal_power=2, scale_power=1)


@dataclass(frozen=True, repr=False)
class Disguised(GM, register=False):
    """A Gauss-Markov process of another class: of two classes with a search, one is found without it."""

    name = "Disguised"
    parametrises = None

    @classmethod
    def search(cls, samples, rate):
        return ()


@dataclass(frozen=True, repr=False)
class Fractional(gmwm.processes.Process, register=False):
    """A newcomer's process: one piece of theory, and a parameter that nobody has said where to look for."""

    name = "Fractional"
    title = "Fractional noise"
    parameters = (Parameter("hurst", "H", "Hurst exponent", domain="between", limits=(0.0, 1.0)), SIGMA2)
    hurst: float | None = None
    sigma2: float | None = None

    def running_sum_covariance(self, lags, rate):
        return -0.5 * self.scale * np.abs(np.asarray(lags, dtype=np.float64)) ** (2 * self.value("hurst"))


TRUTH = GM(beta=0.5, sigma2=2.0) + GM(beta=20.0, sigma2=5.0) + WN(sigma2=1.0)
WV = gmwm.wavelet_variance(TRUTH.simulate(50_000, 100.0, rng=3), 100.0)


@pytest.mark.slow
@pytest.mark.parametrize("weighting", ["diagonal", "optimal", "identity"])
def test_without_the_search_the_same_optimum_is_found(weighting):
    certified = gmwm.fit(2 * GM() + WN(), WV, weighting=weighting)
    found = gmwm.fit(GM() + Disguised() + WN(), WV, weighting=weighting)
    assert found.objective == pytest.approx(certified.objective, rel=1e-9)
    assert found.lower_bound is None
    assert found.relaxed_bound == 0
    assert found.diagnostics.start.how == "scan"
    assert found.diagnostics.start.objective >= found.objective
    betas = sorted([found.parameters["GM.beta"], found.parameters["Disguised.beta"]])
    np.testing.assert_allclose(
        betas, sorted(v for k, v in certified.parameters.items() if k.endswith("beta")), rtol=1e-5
    )
    assert certified.diagnostics.start.how == "convex"


@pytest.mark.slow
def test_the_order_of_terms_changes_nothing():
    one = gmwm.fit(Disguised() + WN() + GM(), WV)
    other = gmwm.fit(GM() + Disguised() + WN(), WV)
    assert one.objective == pytest.approx(other.objective, rel=1e-12)
    for name, value in one.parameters.items():
        assert other.parameters[name] == pytest.approx(value, rel=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("power", [-40, 40])
def test_the_scale_of_the_data_changes_nothing(power):
    scaled = gmwm.WaveletVariance.from_values(WV.variance * 4.0**power, samples=50_000, rate=100.0)
    plain = gmwm.WaveletVariance.from_values(WV.variance, samples=50_000, rate=100.0)
    one, other = (gmwm.fit(Disguised() + WN(), wv, weighting="diagonal") for wv in (plain, scaled))
    assert other.parameters["Disguised.beta"] == pytest.approx(one.parameters["Disguised.beta"], rel=1e-9)
    assert other.parameters["WN.sigma2"] == pytest.approx(one.parameters["WN.sigma2"] * 4.0**power, rel=1e-9)


def test_a_new_process_is_fitted_from_one_piece_of_theory():
    def variance(hurst):
        return 3.0 * (4 - 4**hurst) / 4 * (2.0 ** np.arange(12)) ** (2 * hurst - 2)

    wv = gmwm.WaveletVariance.from_values(variance(0.8), samples=2**13, rate=1.0)
    found = gmwm.fit(Fractional(), wv)
    assert found.parameters["Fractional.hurst"] == pytest.approx(0.8, rel=1e-9)
    assert found.parameters["Fractional.sigma2"] == pytest.approx(3.0, rel=1e-9)
    low, high = found.confidence_intervals()["Fractional.hurst"]
    assert 0 < low < 0.8 < high < 1


@pytest.mark.slow
def test_held_parameters_stay_and_given_ones_are_tried():
    wv = gmwm.wavelet_variance(TRUTH.simulate(20_000, 100.0, rng=4), 100.0)
    held = gmwm.fit(Disguised(beta=fixed(20.0)) + GM() + WN(), wv)
    assert held.parameters["Disguised.beta"] == 20.0
    given = gmwm.fit(Disguised(beta=20.0) + GM() + WN(), wv)
    assert given.diagnostics.start.tried == 65


# --- the paper's draws ------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
@pytest.mark.parametrize("model", ["WN", "WN + RW", "WN + QN + RW + FN"])
def test_draws_for_a_model_without_shapes_lead_to_its_only_optimum(model):
    drawn, found = gmwm.fit(model, WV, start=Sampled(100, rng=1)), gmwm.fit(model, WV)
    assert drawn.diagnostics.start.how == "sampled"
    assert drawn.objective == pytest.approx(found.objective, rel=1e-9)
    np.testing.assert_allclose(list(drawn.parameters.values()), list(found.parameters.values()), rtol=1e-6)


@pytest.mark.slow
def test_draws_lead_to_a_local_optimum_and_the_proof_says_what_they_missed():
    convex = gmwm.fit(2 * GM() + WN(), WV)
    drawn = gmwm.fit(2 * GM() + WN(), WV, start=Sampled(2000, rng=1))
    start = drawn.diagnostics.start
    assert (start.how, start.tried) == ("sampled", 2000)
    assert start.objective >= drawn.objective >= drawn.lower_bound
    assert start.default == pytest.approx(convex.objective, rel=1e-6)
    assert "from the best of 2000 draws" in drawn.summary()
    again = gmwm.fit(2 * GM() + WN(), WV, start=Sampled(2000, rng=1))
    assert again.parameters == drawn.parameters
    without = gmwm.fit(2 * GM() + WN(), WV, start=Sampled(2000, rng=1), certify=False)
    assert without.lower_bound is None
    assert without.diagnostics.start.default is None


@pytest.mark.slow
def test_a_descent_from_draws_says_what_a_term_acts_as():
    three = "GM(beta=20, sigma2=1) + GM(beta=1, sigma2=1) + GM(beta=0.05, sigma2=1)"
    curve = gmwm.wavelet_variance(gmwm.simulate_signal(three, rate=100.0, samples=10_000, rng=6).signal)
    weights = (curve.upper - curve.lower) ** -2.0
    best = gmwm.fit("3*GM", curve, weighting=weights).objective
    told = []
    for seed in range(1, 10):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            drawn = gmwm.fit("3*GM", curve, weighting=weights, start=Sampled(1000, rng=seed))
        astray = bool(drawn.objective > 1.5 * best)
        assert drawn.diagnostics.acts_as == ({"GM[3]": "RW"} if astray else {})
        # Of the one end it stands at, not of the other that would serve as well; and nothing of its correlation time.
        assert [w.message.remark.facts["process"] for w in said] == ["RW"] * astray
        told.append(astray)
    assert any(told)


def test_draws_serve_every_process_and_a_signal():
    x = (TRUTH + RW(gamma2=1e-6)).simulate(20_000, 100.0, rng=5)
    with pytest.warns(FitWarning):
        found = gmwm.fit("AR1 + WN + QN + RW + DR", x, rate=100.0, start=Sampled(500, rng=2))
    best = gmwm.fit("WN", x, rate=100.0).objective
    assert found.objective < best


def test_draws_follow_the_paper():
    from gmwm.theory.processes.parameter import Occasion

    rng, draws, levels = np.random.default_rng(1), 4000, np.arange(1, 11)

    def occasion(dominant, first):
        return Occasion(8.0, 0.1, dominant, np.full(draws, first), levels, 1000, 100.0)

    first = gmwm.AR1.drawn(occasion("markov", 1), rng, draws, ())
    phi = first[:, 1]
    assert phi.min() >= 0
    assert phi.max() <= 0.2
    share = first[:, 0] / (8.0 * (1 - phi) ** 2)
    assert 0.5 <= share.min() < 0.51
    assert 0.99 < share.max() <= 1.0
    second = gmwm.AR1.drawn(occasion("markov", 1), rng, draws, (first[:, 1:],))
    assert np.all((second[:, 1] >= 0.9) & (second[:, 1] <= 0.999995))
    third = gmwm.AR1.drawn(occasion("markov", 1), rng, draws, (first[:, 1:], second[:, 1:]))
    assert np.all(third[:, 1] >= second[:, 1])
    beta = GM.drawn(occasion("white", 2), rng, draws, ())[:, 1]
    assert np.all((np.exp(-beta / 100.0) >= 0.9 - 1e-12) & (beta > 0))
    for process, dominant, low, high in [
        (WN, "white", 4.0, 8.0), (WN, "markov", 8e-5, 0.8), (gmwm.QN, "quantization", 1.0, 8 / 3),
        (gmwm.QN, "white", 4e-5, 0.08), (RW, "markov", 8e-8, 8e-3),
    ]:  # fmt: skip
        scale = process.drawn(occasion(dominant, 1), rng, draws, ())[:, 0]
        assert low <= scale.min() < low + 0.01 * (high - low)
        assert high - 0.01 * (high - low) < scale.max() <= high
    slope = np.sqrt(gmwm.DR.drawn(occasion("markov", 1), rng, draws, ())[:, 0])
    assert slope.min() >= 0.001
    assert slope.max() <= 0.05


@pytest.mark.parametrize("wrong", [0, -1, 2.5, True, "many"])
def test_wrong_numbers_of_draws_are_named(wrong):
    with raises(gmwm.errors.OptionError, argument="draws", got=wrong):
        Sampled(wrong)


def test_a_wrong_start_is_named():
    with raises(gmwm.errors.OptionError, "Sampled", argument="start", got="random"):
        gmwm.fit(WN(), WV, start="random")
