"""Laws that every fit obeys, over random models and data."""

import copy
import itertools
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gmwm
from gmwm import AR1, DR, GM, QN, RW, WN, Model, WaveletVariance
from gmwm.base.remarks import texts
from tests.helpers import code_of

RATE = 100.0
CHAIN = ("WN", "GM + WN", "GM + WN + RW", "2*GM + WN + RW", "2*GM + WN + RW + QN", "3*GM + WN + RW + QN + DR")

pytestmark = pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")

seeds = st.integers(0, 2**32 - 1)
WEIGHTINGS = st.sampled_from(["diagonal", "optimal", "identity"])


def observed(seed: int, samples: int = 50_000) -> WaveletVariance:
    """The wavelet variance of a random mixture, with the scatter of a real record."""
    rng = np.random.default_rng(seed)
    beta = 10 ** rng.uniform(-1.5, 1.5, size=2)
    truth = (
        GM(beta[0], 10 ** rng.uniform(-2, 1)) + GM(beta[1], 10 ** rng.uniform(-2, 1)) + WN(1.0)
        + QN(10 ** rng.uniform(-2, 1)) + RW(10 ** rng.uniform(-8, -5))
    )  # fmt: skip
    return gmwm.wavelet_variance(truth.simulate(samples, RATE, rng), RATE)


@pytest.mark.slow
@settings(max_examples=15, derandomize=True, deadline=None)
@given(seeds)
def test_a_model_that_contains_another_never_fits_worse(seed: int) -> None:
    wv = observed(seed)
    # With one and the same Ω: that of the largest model.
    omega = gmwm.fit(CHAIN[-1], wv).weighting_matrix
    fits = [gmwm.fit(text, wv, weighting=omega) for text in CHAIN]
    for smaller, larger in itertools.pairwise(fits):
        assert larger.objective <= smaller.objective * (1 + 1e-9)
        assert larger.relaxed_bound <= larger.lower_bound * (1 + 1e-9)
        assert larger.lower_bound <= larger.objective
        assert larger.gap <= 1e-3


@pytest.mark.slow
@settings(max_examples=8, derandomize=True, deadline=None)
@given(seeds)
def test_the_order_of_terms_changes_nothing(seed: int) -> None:
    wv = observed(seed)
    terms = [GM(), GM(), WN(), QN(), RW()]
    first = gmwm.fit(Model(tuple(terms)), wv)
    for order in np.random.default_rng(seed).permuted(np.tile(np.arange(5), (3, 1)), axis=1):
        again = gmwm.fit(Model(tuple(terms[k] for k in order)), wv)
        assert again.objective == pytest.approx(first.objective, rel=1e-8)
        for name, value in first.parameters.items():
            assert again.parameters[name] == pytest.approx(value, rel=1e-6)


@pytest.mark.slow
@settings(max_examples=8, derandomize=True, deadline=None)
@given(seeds, st.sampled_from([1e-12, 1e-5, 0.3, 17.0, 1e6, 1e12]), WEIGHTINGS)
def test_scaling_the_data_scales_the_estimates(seed: int, factor: float, weighting: str) -> None:
    wv = observed(seed)
    scaled = WaveletVariance.from_values(wv.variance * factor**2, samples=wv.samples, rate=RATE)
    one, other = (gmwm.fit("2*GM + WN + QN + RW", data, weighting=weighting) for data in (wv, scaled))
    for name, value in one.parameters.items():
        expected = value if name.endswith("beta") else value * factor**2
        assert other.parameters[name] == pytest.approx(expected, rel=1e-9 if name.endswith("beta") else 1e-8)
    power = 4 if weighting == "identity" else 0
    assert other.objective == pytest.approx(one.objective * factor**power, rel=1e-9)


@pytest.mark.slow
@settings(max_examples=5, derandomize=True, deadline=None)
@given(seeds)
def test_the_same_input_gives_the_same_output(seed: int) -> None:
    wv = observed(seed)
    assert gmwm.fit("3*GM + WN + RW", wv).to_dict() == gmwm.fit("3*GM + WN + RW", wv).to_dict()


@pytest.mark.slow
@settings(max_examples=8, derandomize=True, deadline=None)
@given(seeds)
def test_a_full_matrix_that_is_diagonal_is_the_diagonal(seed: int) -> None:
    wv = observed(seed)
    plain = gmwm.fit("2*GM + WN + RW", wv)
    again = gmwm.fit("2*GM + WN + RW", wv, weighting=plain.weighting_matrix)
    assert again.objective == pytest.approx(plain.objective, rel=1e-12)


@pytest.mark.slow
@settings(max_examples=8, derandomize=True, deadline=None)
@given(seeds)
def test_bounds_hold_under_a_full_weighting(seed: int) -> None:
    wv = observed(seed)
    rng = np.random.default_rng(seed)
    size = len(wv)
    noise = np.diag(np.sqrt(2 / wv.degrees_of_freedom) * wv.variance)
    mixing = np.eye(size) + 0.3 * rng.uniform(size=(size, size))
    omega = np.linalg.inv(noise @ mixing @ mixing.T @ noise)
    fit = gmwm.fit("2*GM + WN + RW", wv, weighting=omega)
    assert 0 <= fit.relaxed_bound <= fit.lower_bound * (1 + 1e-9) <= fit.objective * (1 + 1e-9)
    assert fit.gap <= 1e-3
    # No set of parameters from a random cloud lies below the bound.
    branch = GM.search(wv.samples, RATE)[0]
    for _ in range(200):
        u = rng.uniform(branch.low, branch.high, size=2)
        beta = branch.values(u)[:, 0]
        held = gmwm.fit(GM(gmwm.fixed(beta[0])) + GM(gmwm.fixed(beta[1])) + WN() + RW(), wv, weighting=omega)
        assert held.objective >= fit.lower_bound


EXACT = (
    "GM(beta=0.5, sigma2=1.0) + GM(beta=0.01, sigma2=2.0) + WN(sigma2=4.0) + RW(gamma2=1e-07)",
    "GM(beta=5.0, sigma2=1.0) + GM(beta=0.05, sigma2=1.0) + GM(beta=0.5, sigma2=1.0) + WN(sigma2=4.0) + QN(q2=2.0)",
    "AR1(phi=-0.6, sigma2=1.0) + WN(sigma2=0.3)",
    "AR1(phi=0.999, sigma2=0.01) + AR1(phi=0.5, sigma2=1.0) + QN(q2=0.3)",
    "DR(omega=0.0001) + WN(sigma2=1.0)",
)


@pytest.mark.parametrize("text", EXACT)
@pytest.mark.parametrize("factor", [1e-12, 1.0, 1e12])
def test_the_wavelet_variance_of_a_model_gives_the_model_back(text: str, factor: float) -> None:
    truth = gmwm.Model.parse(text).sorted(RATE)
    wv = WaveletVariance.from_values(truth.wavelet_variance(19, RATE) * factor**2, samples=10**6, rate=RATE)
    fit = gmwm.fit(truth.structure, wv)
    for name, value in truth.parameters.items():
        parameter = next(p for q in truth.processes for p in q.parameters if name.endswith("." + p.name))
        assert fit.parameters[name] == pytest.approx(value * factor**parameter.signal_power, rel=1e-6)
    assert fit.gap == 0


@pytest.mark.slow
def test_array_signal_and_wavelet_variance_give_one_fit() -> None:
    x = (GM(0.5, 1.0) + WN(4.0)).simulate(20_000, RATE, np.random.default_rng(5))
    signal = gmwm.Signal(x, RATE, "rad/s", "gyro_x")
    fits = [
        gmwm.fit("GM + WN", x, RATE),
        gmwm.fit("GM + WN", signal),
        gmwm.fit("GM + WN", gmwm.wavelet_variance(signal)),
    ]
    assert len({tuple(f.parameters.values()) for f in fits}) == 1
    assert fits[1].units() == {"GM.beta": "1/s", "GM.sigma2": "(rad/s)²", "WN.sigma2": "(rad/s)²"}


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_drift_has_the_sign_of_the_data(sign: float) -> None:
    x = (DR(sign * 1e-3) + WN(1.0)).simulate(20_000, RATE, np.random.default_rng(5))
    assert gmwm.fit("DR + WN", x, RATE).parameters["DR.omega"] == pytest.approx(sign * 1e-3, rel=0.05)
    unsigned = WaveletVariance.from_values(gmwm.wavelet_variance(x, RATE).variance, samples=20_000, rate=RATE)
    assert gmwm.fit("DR + WN", unsigned).parameters["DR.omega"] == pytest.approx(1e-3, rel=0.05)


def test_held_values_stay_and_the_rest_is_the_best_given_them() -> None:
    x = (GM(0.5, 1.0) + WN(4.0) + RW(1e-5)).simulate(50_000, RATE, np.random.default_rng(6))
    wv = gmwm.wavelet_variance(x, RATE)
    free = gmwm.fit("GM + WN + RW", wv)
    held = gmwm.fit(GM(beta=gmwm.fixed(0.4)) + WN() + RW(gamma2=gmwm.fixed(1e-5)), wv)
    assert held.parameters["GM.beta"] == 0.4
    assert held.parameters["RW.gamma2"] == 1e-5
    assert held.objective >= free.objective
    started = gmwm.fit(GM(beta=0.4) + WN() + RW(), wv)
    assert started.objective == pytest.approx(free.objective, rel=1e-9)


def acting(caught: pytest.WarningsRecorder) -> list[tuple[object, object]]:
    """Each term that acts as another process, and that process."""
    remarks = [warning.message.remark for warning in caught]
    return [
        (one.facts["term"], one.facts["process"]) for one in remarks if code_of(one) == "correlation-time-unknown:fit"
    ]


def test_a_term_at_the_edge_says_what_it_acts_as() -> None:
    # Quantization falls faster than white noise and a drift rises faster than a random walk: both push β to an edge.
    steep = (WN(1.0) + QN(0.1)).simulate(50_000, RATE, np.random.default_rng(7))
    with pytest.warns(gmwm.errors.FitWarning) as caught:
        fit = gmwm.fit(GM() + DR(), steep, RATE)
    assert acting(caught) == [("GM", "WN")]
    assert fit.diagnostics.acts_as == {"GM": "WN"}
    wandering = (RW(1e-2) + DR(1e-1)).simulate(50_000, RATE, np.random.default_rng(8))
    with pytest.warns(gmwm.errors.FitWarning) as caught:
        gmwm.fit(GM() + QN(), wandering, RATE)
    assert acting(caught) == [("GM", "RW")]


def test_an_unsupported_term_is_zero_and_has_a_remark() -> None:
    white = WN(1.0).simulate(50_000, RATE, np.random.default_rng(9))
    with pytest.warns(gmwm.errors.FitWarning):
        fit = gmwm.fit(WN() + DR() + QN() + RW(), white, RATE)
    zero = [remark for remark in fit.remarks if code_of(remark) == "term-zero:fit"]
    assert tuple(remark.facts["term"] for remark in zero) == fit.diagnostics.not_supported != ()
    for term in fit.diagnostics.not_supported:
        assert not fit.decomposition[term].any()
    assert all(text in fit.summary() for text in texts(zero))


def test_uncertified_fits_are_as_good_and_say_so() -> None:
    wv = observed(3)
    quick, sure = gmwm.fit("3*GM + WN + RW", wv, certify=False), gmwm.fit("3*GM + WN + RW", wv)
    assert quick.lower_bound is None
    assert quick.gap is None
    assert "not certified" in quick.summary()
    assert quick.objective == pytest.approx(sure.objective, rel=1e-9)


def test_negative_phi_is_found() -> None:
    x = (AR1(-0.7, 1.0) + WN(0.5)).simulate(100_000, RATE, np.random.default_rng(10))
    assert gmwm.fit("AR1 + WN", x, RATE).parameters["AR1.phi"] == pytest.approx(-0.7, abs=0.06)


@pytest.mark.parametrize("weighting", ["diagonal", "identity"])
@pytest.mark.parametrize("seed", range(6))
def test_no_correlation_time_however_long_beats_the_bound(seed: int, weighting: str) -> None:
    x = (RW(1e-9) + WN(1e-8)).simulate(10_000, RATE, seed)
    fit = gmwm.fit("GM + WN", x, RATE, weighting=weighting)
    for beta in (1e-15, 1e-12, 1e-9, 1e-6, 1e4, 1e6):
        held = gmwm.fit(GM(beta=gmwm.fixed(beta)) + WN(), x, RATE, weighting=fit.weighting_matrix)
        assert held.objective >= fit.lower_bound * (1 - 1e-7)


def test_fits_pickle_and_copy() -> None:
    fit = gmwm.fit("GM + WN", observed(1))
    for again in (pickle.loads(pickle.dumps(fit)), copy.deepcopy(fit)):
        assert again.to_dict() == fit.to_dict()
