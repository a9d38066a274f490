"""The wavelet information criterion: laws of the optimism, and the derivatives that it is made of."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gmwm
from gmwm import DR, GM, RW, WN, WaveletVariance
from gmwm.fitting.estimation.criterion import covariance_trace, implied_by_refits, optimism, problem_of
from gmwm.fitting.estimation.weighting import precision
from gmwm.measuring.covariance import Design, covariance
from tests.helpers import raises

RATE = 100.0
TRUTHS = (
    "WN(sigma2=4.0) + RW(gamma2=1e-4)",
    "GM(beta=0.5, sigma2=0.2) + WN(sigma2=4.0)",
    "GM(beta=8.0, sigma2=1.0) + WN(sigma2=4.0) + RW(gamma2=4e-4)",
    "GM(beta=8.0, sigma2=0.6) + GM(beta=0.15, sigma2=0.2) + WN(sigma2=2.0) + QN(q2=1.0)",
    "DR(omega=2e-4) + WN(sigma2=4.0) + RW(gamma2=5e-5)",
)
WEIGHTINGS = ("diagonal", "optimal")

pytestmark = pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")

truths = st.sampled_from(TRUTHS)
seeds = st.integers(0, 2**32 - 1)


def recorded(truth: str, seed: int, samples: int = 50_000, **options) -> WaveletVariance:
    return gmwm.wavelet_variance(gmwm.Model.parse(truth).simulate(samples, RATE, seed), RATE, **options)


def curve(truth: str, samples: int, rate: float = RATE) -> tuple[WaveletVariance, np.ndarray]:
    """The wavelet variance of a model without any error, and V."""
    model = gmwm.Model.parse(truth).sorted(rate)
    design = Design(np.arange(1, samples.bit_length()), samples=samples, rate=rate)
    variance = model.wavelet_variance(design.levels, rate, design.filter)
    return WaveletVariance.from_values(variance, samples=samples, rate=rate), covariance(model, design)


def without_residuals(fit: gmwm.Fit) -> gmwm.Fit:
    """The same fit to data that it meets exactly: second derivatives have nothing to multiply."""
    return replace(fit, wavelet_variance=replace(fit.wavelet_variance, variance=fit.implied.copy()))


def weights(weighting: str, wavelet: np.ndarray) -> np.ndarray:
    return precision(wavelet) if weighting == "optimal" else np.diag(1 / np.diag(wavelet))


# What it counts


@pytest.mark.parametrize("truth", TRUTHS)
def test_optimal_weights_cost_two_for_each_parameter(truth: str) -> None:
    wv, wavelet = curve(truth, 50_000)
    fit = gmwm.fit(gmwm.Model.parse(truth).structure, wv, weighting=precision(wavelet), certify=False)
    assert optimism(fit, wavelet) == pytest.approx(2 * len(fit.parameters), rel=1e-6)
    other = np.diag(1 / np.diag(wavelet))
    # Any other weights count the scatter in their own unit: all of it is tr ΩV.
    assert 0 < optimism(gmwm.fit(fit.model, wv, weighting=other, certify=False), wavelet) < 2 * len(wv)


@pytest.mark.slow
@pytest.mark.parametrize("options", [{"robust": True}, {"filter": "d4"}, {"transform": "dwt"}])
def test_so_they_do_however_the_recording_was_measured(options: dict) -> None:
    fit = gmwm.fit("GM + WN", recorded(TRUTHS[1], 4, **options), weighting="optimal", certify=False)
    wavelet = covariance(fit.model, Design.of(fit.wavelet_variance))
    own = replace(without_residuals(fit), weighting_matrix=precision(wavelet))
    assert optimism(own, wavelet) == pytest.approx(6, rel=1e-6)
    assert fit.wic().optimism == pytest.approx(6, rel=0.1)
    assert "np." not in repr(fit.wic())


def test_what_is_held_or_zero_does_not_count() -> None:
    wv, wavelet = curve(TRUTHS[2], 50_000)
    omega = precision(wavelet)
    held = GM(beta=gmwm.fixed(8.0)) + WN() + RW(gamma2=gmwm.fixed(4e-4))
    assert optimism(gmwm.fit(held, wv, weighting=omega, certify=False), wavelet) == pytest.approx(4, rel=1e-6)
    white, scatter = curve("WN(sigma2=4.0)", 50_000)
    low = WaveletVariance.from_values(white.variance * np.linspace(1, 0.9, len(white)), samples=50_000, rate=RATE)
    for weighting in WEIGHTINGS:
        omega = weights(weighting, scatter)
        one = gmwm.fit("WN", low, weighting=omega).wic()
        more = gmwm.fit("GM + WN + RW", low, weighting=omega)
        assert {"GM", "RW"} <= {*more.diagnostics.not_supported}
        assert more.wic().optimism == pytest.approx(one.optimism, rel=1e-9)
        assert more.wic().loss == pytest.approx(one.loss, rel=1e-9)


def test_a_term_that_acts_as_another_counts_as_that_one() -> None:
    wv, wavelet = curve(TRUTHS[0], 50_000)
    for weighting in WEIGHTINGS:
        omega = weights(weighting, wavelet)
        walk, markov = (gmwm.fit(model, wv, weighting=omega, certify=False) for model in ("WN + RW", "GM + WN"))
        assert markov.diagnostics.acts_as == {"GM": "RW"}
        assert optimism(markov, wavelet) == pytest.approx(optimism(walk, wavelet), rel=1e-3)


def test_published_case() -> None:
    # AR1 + WN, N = 4000, weights from the limits of the true curve: 0.332, and 0.337 ± 0.005 by simulation.
    wv, wavelet = curve("AR1(phi=0.95, sigma2=0.1) + WN(sigma2=1)", 4000, 1.0)
    fit = gmwm.fit("AR1 + WN", wv, weighting=(wv.upper - wv.lower) ** -2.0)
    assert optimism(fit, wavelet) == pytest.approx(0.332, abs=5e-4)


# What it does not hang on


@pytest.mark.slow
@settings(max_examples=8, derandomize=True, deadline=None)
@given(seeds, st.sampled_from(WEIGHTINGS))
def test_the_same_process_in_other_parameters_has_the_same_criterion(seed: int, weighting: str) -> None:
    wv = recorded(TRUTHS[1], seed, 8192)
    omega = gmwm.fit("GM + WN", wv, weighting=weighting, certify=False).weighting_matrix
    one, other = (gmwm.fit(model, wv, weighting=omega, certify=False).wic() for model in ("GM + WN", "AR1 + WN"))
    assert other.loss == pytest.approx(one.loss, rel=1e-9)
    assert other.optimism == pytest.approx(one.optimism, rel=1e-4)


@pytest.mark.slow
@settings(max_examples=8, derandomize=True, deadline=None)
@given(truths, seeds, st.sampled_from([1e-12, 1e-3, 7.0, 1e12]), st.sampled_from(WEIGHTINGS))
def test_scaling_the_data_changes_nothing(truth: str, seed: int, factor: float, weighting: str) -> None:
    wv = recorded(truth, seed)
    one, other = (
        gmwm.fit(
            gmwm.Model.parse(truth).structure,
            WaveletVariance.from_values(wv.variance * scale**2, samples=wv.samples, rate=RATE),
            weighting=weighting,
            certify=False,
        ).wic()
        for scale in (1.0, factor)
    )
    assert other.loss == pytest.approx(one.loss, rel=1e-7)
    assert other.optimism == pytest.approx(one.optimism, rel=1e-6)


# The derivatives


TWO = "GM(beta=8.0, sigma2=1e-6) + GM(beta=1.0, sigma2=5e-7) + WN(sigma2=4e-6)"
THREE = "GM(beta=20.0, sigma2=1e-6) + GM(beta=1.0, sigma2=1e-6) + GM(beta=0.1, sigma2=1e-6) + WN(sigma2=1e-6)"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("truth", "structure"), [(TWO, "GM + WN"), (TWO, "AR1 + WN"), (TWO, "GM + WN + RW"), (THREE, "2*GM + WN")]
)
@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_the_optimism_is_how_the_fit_follows_the_data(truth: str, structure: str, weighting: str) -> None:
    # With V = Ω⁻¹ half of it is tr ∂ν(θ̂)/∂ν̂; second derivatives make it more than the number of parameters.
    wv, wavelet = curve(truth, 100_000)
    omega = weights(weighting, wavelet)
    fit = gmwm.fit(structure, wv, weighting=omega, certify=False)
    problem, known = problem_of(fit)
    steps = 1e-5 * np.sqrt(np.diag(wavelet))
    moved = [implied_by_refits(problem, known, wv.variance + sign * np.diag(steps)) for sign in (1, -1)]
    followed = np.trace((moved[0] - moved[1]) / (2 * steps[:, None]))
    parameters = len(fit.parameters)
    assert optimism(fit, np.linalg.inv(omega)) / 2 == pytest.approx(followed, rel=1e-3)
    assert optimism(without_residuals(fit), np.linalg.inv(omega)) / 2 == pytest.approx(parameters, rel=1e-6)
    assert abs(followed - parameters) > 0.05


def test_where_second_derivatives_find_no_minimum_they_are_left_out() -> None:
    wv, wavelet = curve(TWO, 100_000)
    fit = gmwm.fit("GM + WN", wv, weighting=weights("diagonal", wavelet), certify=False)
    # Residuals a thousand times as large, of either sign: one of them bends the criterion downwards.
    off = [
        replace(fit, wavelet_variance=replace(wv, variance=fit.implied + times * (wv.variance - fit.implied)))
        for times in (-1000.0, 1000.0)
    ]
    plain = optimism(without_residuals(fit), wavelet)
    found = [optimism(other, wavelet) for other in off]
    assert min(found) > 0
    assert any(value == pytest.approx(plain, rel=1e-9) for value in found)


# On average


@pytest.mark.slow
def test_larger_models_have_larger_penalties_on_average() -> None:
    nested = ("WN", "GM + WN", "GM + WN + RW", "2*GM + WN + RW")
    truth = "GM(beta=8.0, sigma2=2.0) + GM(beta=0.3, sigma2=0.5) + WN(sigma2=4.0) + RW(gamma2=4e-5)"
    _, wavelet = curve(truth, 50_000)
    for weighting in WEIGHTINGS:
        omega = weights(weighting, wavelet)
        found = np.array([
            [optimism(gmwm.fit(model, wv, weighting=omega, certify=False), wavelet) for model in nested]
            for wv in (recorded(truth, seed) for seed in range(10))
        ])  # fmt: skip
        assert np.all(np.diff(found.mean(axis=0)) > 0), (weighting, found.mean(axis=0))


@pytest.fixture(scope="module")
def fit() -> gmwm.Fit:
    return gmwm.fit("GM + WN", recorded(TRUTHS[1], 2), certify=False)


@pytest.mark.slow
def test_bootstrap_and_theory_agree(fit: gmwm.Fit) -> None:
    one, other = fit.wic(), fit.wic("bootstrap", draws=200, rng=1)
    drawn = fit.bootstrap(draws=200, rng=1)
    deviation = drawn.variances - drawn.variances.mean(axis=0)
    each = 2 * np.sum((drawn.implied @ fit.weighting_matrix) * deviation, axis=1)
    assert other.loss == one.loss == fit.objective
    assert abs(other.optimism - one.optimism) < 4 * each.std() / 200**0.5 + 0.05 * one.optimism
    assert (one.method, other.method) == ("asymptotic", "bootstrap")
    assert other == fit.wic("bootstrap", draws=200, rng=1)
    assert other.optimism != fit.wic("bootstrap", draws=200, rng=2).optimism


def test_value_is_loss_and_optimism(fit: gmwm.Fit) -> None:
    found = fit.wic()
    assert found.value == found.loss + found.optimism
    assert found.to_dict() == {
        "value": found.value, "loss": found.loss, "optimism": found.optimism, "method": "asymptotic"
    }  # fmt: skip


def test_trace_is_that_of_the_covariance() -> None:
    rng = np.random.default_rng(5)
    variances = rng.normal(size=(40, 6))
    implied = variances + rng.normal(size=(40, 6))
    omega = np.diag(rng.uniform(1, 2, 6)) + 0.1
    both = np.cov(variances.T, implied.T)[:6, 6:]
    assert covariance_trace(variances, implied, omega) == pytest.approx(2 * np.trace(both @ omega), rel=1e-12)


@pytest.mark.slow
def test_refits_are_those_of_the_bootstrap_and_of_fit() -> None:
    wv = recorded(TRUTHS[2], 6)
    held = gmwm.fit(GM() + WN() + RW(gamma2=gmwm.fixed(4e-4)), wv, certify=False)
    drawn = held.bootstrap(draws=12, rng=3)
    done: list[int] = []
    implied = implied_by_refits(*problem_of(held), drawn.variances, done.append)
    np.testing.assert_allclose(implied, drawn.implied, rtol=1e-9)
    assert done == list(range(1, 13))
    own = implied_by_refits(*problem_of(held), wv.variance[np.newaxis])
    np.testing.assert_allclose(own[0], held.implied, rtol=1e-6)


# What it refuses


def test_options_are_checked(fit: gmwm.Fit) -> None:
    with raises(gmwm.errors.OptionError, "'asymptotic' or 'bootstrap'", argument="method", got="exact"):
        fit.wic("exact")
    for draws in (1, 2.5, True):
        with raises(gmwm.errors.OptionError, "at least 2,", argument="draws", got=draws):
            fit.wic("bootstrap", draws=draws)
    with raises(gmwm.errors.OptionError, argument="rng", got=-1):
        fit.wic("bootstrap", rng=-1)


def test_a_model_without_noise_has_no_criterion() -> None:
    wv = gmwm.wavelet_variance((DR(omega=1.0) + WN(sigma2=1e-6)).simulate(5000, RATE, 1), RATE)
    with raises(gmwm.errors.ModelError, "no noise at some level"):
        gmwm.fit("DR", wv, weighting="identity", certify=False).wic()
