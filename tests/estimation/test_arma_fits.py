"""Autoregressive moving averages, alone and in sums: the optimum, its invariances, and what is held or given."""

from itertools import pairwise

import numpy as np
import pytest

import gmwm
from gmwm import AR, AR1, ARMA, GM, MA, RW, WN, fixed
from gmwm.base.errors import FitWarning
from gmwm.fitting.estimation import Sampled
from gmwm.fitting.estimation.problem import pose
from gmwm.fitting.estimation.solver import DESCENT_STARTS, solve
from gmwm.fitting.estimation.starts import scanned_points, scans_alone
from gmwm.fitting.estimation.variable_projection import Surface
from tests.helpers import codes, only, raises

pytestmark = pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")

TRUTHS = [
    "AR(2, phi1=1.4, phi2=-0.6, sigma2=1.0)",
    "ARMA(2, 1, phi1=0.9, phi2=-0.3, theta1=0.5, sigma2=1.0)",
    "MA(2, theta1=0.6, theta2=0.3, sigma2=1.0)",
    "SARMA(1, 0, 1, 0, 12, phi1=0.5, sphi1=0.6, sigma2=1.0)",
    "AR(2, phi1=1.4, phi2=-0.6, sigma2=1.0) + WN(sigma2=3.0) + RW(gamma2=1e-3)",
]


def measured(text, seed, n=10_000):
    return gmwm.wavelet_variance(gmwm.Model.parse(text).simulate(n, 1.0, rng=seed), 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("text", TRUTHS)
def test_the_truth_is_found_and_no_random_start_beats_the_fit(text):
    wv, truth = measured(text, 8), gmwm.Model.parse(text)
    found = gmwm.fit(truth.structure, wv)
    for name, value in truth.parameters.items():
        assert abs(found.parameters[name] - value) < 4 * found.standard_errors[name]
    omega = found.weighting_matrix
    residual = wv.variance - truth.wavelet_variance(wv.levels, 1.0)
    assert found.objective <= residual @ omega @ residual
    for seed in range(3):
        drawn = gmwm.fit(truth.structure, wv, weighting=omega, start=Sampled(200, seed))
        assert found.objective <= drawn.objective * (1 + 1e-9)
    assert found.goodness_of_fit().pvalue > 1e-3


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "truth", [AR1(phi=-0.7, sigma2=1.0) + WN(sigma2=1.0), AR1(phi=0.98, sigma2=0.1) + WN(sigma2=2.0)]
)
def test_a_scan_finds_what_the_search_has_proven(truth, seed):
    wv = gmwm.wavelet_variance(truth.simulate(10_000, 1.0, rng=seed), 1.0)
    proven = gmwm.fit(AR1() + WN(), wv, weighting="optimal")
    found = gmwm.fit(AR(1) + WN(), wv, weighting=proven.weighting_matrix)
    assert found.objective == pytest.approx(proven.objective, rel=1e-9)
    assert found.parameters["AR(1).phi1"] == pytest.approx(proven.parameters["AR1.phi"], rel=1e-5)


@pytest.mark.slow
def test_a_larger_order_never_fits_worse():
    wv = measured(TRUTHS[1], 3)
    omega = gmwm.fit("ARMA(2,1)", wv).weighting_matrix

    chain = [AR(1), AR(2), AR(3), ARMA(3, 1), ARMA(3, 2)]
    values = [gmwm.fit(model, wv, weighting=omega).objective for model in chain]
    assert all(larger <= smaller * (1 + 1e-9) for smaller, larger in pairwise(values))


@pytest.mark.slow
@pytest.mark.parametrize("model", ["AR(2) + 2*GM + RW", "ARMA(2,1) + GM + RW", "MA(2) + GM + RW", "AR(2) + MA(1) + GM"])
@pytest.mark.parametrize("seed", [1])
def test_descents_that_are_not_followed_lead_nowhere(model, seed):
    rng = np.random.default_rng(seed)
    r, w = rng.uniform(0.5, 0.97), rng.uniform(0.05, 2.8)
    truth = AR(phi=[2 * r * np.cos(w), -(r**2)], sigma2=1.0) + GM(10 ** rng.uniform(-3, 0), 10.0) + RW(1e-5)
    wv = gmwm.wavelet_variance(truth.simulate(2**14, 1.0, rng), 1.0)
    problem = pose(gmwm.Model.parse(model), wv, np.diag(wv.degrees_of_freedom / wv.variance**2))
    surface = Surface(problem)
    points, _ = scanned_points(problem, surface, scans_alone(problem, surface), DESCENT_STARTS)
    every = [surface.downhill(point).objective for _, point in points]
    assert solve(problem, certify=False).objective <= min(every) * problem.unit**2 * (1 + 1e-6)


@pytest.mark.slow
def test_the_order_of_terms_changes_nothing():
    wv = measured(TRUTHS[4], 5)
    models = [AR(2) + WN() + RW(), RW() + AR(2) + WN(), WN() + RW() + AR(2)]
    first, *others = [gmwm.fit(model, wv) for model in models]
    for other in others:
        assert other.objective == pytest.approx(first.objective, rel=1e-9)
        for name, value in first.parameters.items():
            assert other.parameters[name] == pytest.approx(value, rel=1e-6)


@pytest.mark.slow
def test_coefficients_may_be_held_or_given():
    wv = measured(TRUTHS[0], 2)
    free = gmwm.fit(AR(2), wv)
    held = gmwm.fit(AR(2, phi2=fixed(-0.6)), wv, weighting=free.weighting_matrix)
    assert held.parameters["AR(2).phi2"] == -0.6
    assert held.objective >= free.objective * (1 - 1e-9)
    assert "AR(2).phi2" not in held.confidence_intervals()
    known = gmwm.fit(AR(phi=[fixed(1.4), fixed(-0.6)]) + WN(), wv)
    assert known.lower_bound is not None  # nothing but scales is left
    given = gmwm.fit(AR(phi=[1.3, -0.5]), wv)
    assert given.objective == pytest.approx(free.objective, rel=1e-8)
    assert given.diagnostics.start.tried == free.diagnostics.start.tried + 1


@pytest.mark.slow
def test_with_gauss_markov_terms_each_is_found():
    truth = gmwm.Model.parse("AR(2, phi1=1.4, phi2=-0.6, sigma2=1.0) + GM(beta=0.001, sigma2=30.0)")
    wv = gmwm.wavelet_variance(truth.simulate(50_000, 1.0, rng=1), 1.0)
    found = gmwm.fit(GM() + AR(2), wv)
    for name, value in truth.parameters.items():
        assert abs(found.parameters[name] - value) < 4 * found.standard_errors[name]


@pytest.mark.slow
def test_the_unit_of_the_data_changes_nothing():
    plain = measured(TRUTHS[0], 4)
    one = gmwm.fit(AR(2) + WN(), plain)
    scaled = gmwm.WaveletVariance.from_values(plain.variance * 1e-12, samples=10_000, rate=1.0)
    other = gmwm.fit(AR(2) + WN(), scaled)
    for name, value in one.parameters.items():
        factor = 1e-12 if name.endswith("sigma2") else 1.0
        assert other.parameters[name] == pytest.approx(value * factor, rel=1e-6)


@pytest.mark.slow
def test_a_fit_survives_its_dictionary():
    fit = gmwm.fit(MA(1) + RW(), measured("MA(1, theta1=0.5, sigma2=1.0) + RW(gamma2=1e-4)", 1))
    again = gmwm.Fit.from_dict(fit.to_dict())
    assert again.parameters == fit.parameters
    assert again.diagnostics == fit.diagnostics
    assert "no proof" in fit.summary()


@pytest.mark.slow
def test_orders_are_chosen():
    wv = measured(TRUTHS[0], 6)
    ranking = gmwm.rank(["AR(1)", "AR(2)", "AR(3)", "MA(1)"], wv)
    assert ranking.recommended.structure == "AR(2)"
    within = gmwm.select(ARMA(2, 1), wv)
    assert {c.structure for c in within} == {"ARMA(2,1)", "ARMA(1,1)", "AR(2)", "AR(1)", "MA(1)"}
    assert within.recommended.structure == "AR(2)"


@pytest.mark.slow
def test_bootstrap_intervals_lie_about_negative_estimates():
    fit = gmwm.fit(AR(2), measured(TRUTHS[0], 7, n=2000))
    for name, (low, high) in fit.confidence_intervals(method="bootstrap", draws=60).items():
        assert low < fit.parameters[name] < high
    errors, standard = fit.bootstrap(60).errors, fit.standard_errors
    assert all(0.6 < errors[name] / standard[name] < 1.7 for name in standard)


@pytest.mark.slow
def test_roots_that_cancel_are_told():
    white = np.random.default_rng(0).standard_normal(5000)
    with pytest.warns(FitWarning):
        fit = gmwm.fit(ARMA(1, 1), white, rate=1.0)
    assert only(fit.remarks, "roots:cancel").about("").text() in fit.summary()
    assert gmwm.Fit.from_dict(fit.to_dict()).diagnostics.remarks == fit.diagnostics.remarks
    walk = np.cumsum(np.random.default_rng(1).standard_normal(3000))
    with pytest.warns(FitWarning):
        assert "roots:ar" in codes(gmwm.fit(AR(2), walk, rate=1.0).remarks)
    assert gmwm.fit(ARMA(2, 1), measured(TRUTHS[1], 8)).diagnostics.remarks == ()


@pytest.mark.slow
def test_levels_are_weighed_with_what_they_have_in_common_where_a_shape_has_several_parameters():
    wv = measured(TRUTHS[0], 1)
    assert gmwm.fit(AR(2), wv).weighting == "optimal"
    assert gmwm.fit(AR(1) + WN(), wv).weighting == "diagonal"
    assert gmwm.fit(AR(2), wv, weighting="diagonal").weighting == "diagonal"


def test_a_thin_set_of_processes_beside_a_held_coefficient_is_found():
    wv = measured("AR(2, phi1=1.99, phi2=-0.995, sigma2=1)", 1)
    held = gmwm.fit("AR(2, phi1=fixed(1.99))", wv)
    assert held.parameters["AR(2).phi2"] == pytest.approx(-0.995, abs=2e-3)
    with raises(gmwm.errors.ModelError, "phi1", -2, 2):
        AR(2, phi1=fixed(5.0))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_two_lines_are_both_found(seed):
    rng = np.random.default_rng(seed)
    (f1, f2), (p1, p2) = np.exp(rng.uniform(np.log(0.02), np.log(40), 2)), 10 ** rng.uniform(-8, -6, 2)
    truth = gmwm.SIN(f1, p1) + gmwm.SIN(f2, p2) + WN(1e-6)
    wv = gmwm.wavelet_variance(truth.simulate(200_000, 100.0, rng=seed), 100.0)
    found = gmwm.fit("2*SIN + WN", wv)
    given = gmwm.fit(truth, wv, weighting=found.weighting_matrix)
    # Optima beside each other differ by 1e-5 of the objective, and their frequencies by a fiftieth of a standard error.
    assert found.objective <= given.objective * (1 + 1e-4)
