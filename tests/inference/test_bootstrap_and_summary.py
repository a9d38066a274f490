"""The parametric bootstrap of a fit, and a fit in words."""

import json

import numpy as np
import pytest

import gmwm
from gmwm import GM, RW, WN
from gmwm.fitting.estimation.summary import IntervalMethod, inference, short_values
from gmwm.theory.filters import HAAR
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.parameter import Parameter
from tests.helpers import code_of, codes, only, raises

RATE = 100.0
pytestmark = pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")


@pytest.fixture(scope="module")
def fit():
    x = (GM(beta=0.5, sigma2=0.2) + WN(sigma2=4.0)).simulate(60_000, RATE, 2)
    return gmwm.fit("GM + WN", x, RATE)


@pytest.mark.slow
def test_standard_errors_of_the_bootstrap_are_those_of_theory(fit):
    again = fit.bootstrap(draws=300, rng=1)
    for name, error in fit.standard_errors.items():
        assert again.errors[name] == pytest.approx(error, rel=0.2)
    assert again.estimates.shape == (300, 3)
    np.testing.assert_allclose(again.variances.mean(axis=0)[:8], fit.implied[:8], rtol=0.02)


@pytest.mark.slow
def test_intervals_of_both_kinds_agree(fit):
    one, other = fit.confidence_intervals(), fit.confidence_intervals(method="bootstrap", draws=300, rng=1)
    for name, (low, high) in one.items():
        assert np.log(other[name][1] / other[name][0]) == pytest.approx(np.log(high / low), rel=0.25)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bootstrap(fit):
    first = fit.bootstrap(draws=20, rng=3)
    x = gmwm.fit("GM + WN", fit.wavelet_variance).bootstrap(draws=20, rng=3)
    np.testing.assert_array_equal(first.estimates, x.estimates)
    assert not np.array_equal(first.estimates, fit.bootstrap(draws=20, rng=4).estimates)


@pytest.mark.slow
def test_a_generator_draws_a_seed_that_the_result_records(fit):
    one, other = (fit.bootstrap(draws=20, rng=np.random.default_rng(5)) for _ in range(2))
    assert one.seed == other.seed
    assert np.array_equal(one.estimates, other.estimates)
    assert np.array_equal(fit.bootstrap(draws=20, rng=one.seed).estimates, one.estimates)
    generator = np.random.default_rng(5)
    first, second = (fit.bootstrap(draws=20, rng=generator) for _ in range(2))
    assert first.seed == one.seed != second.seed
    bootstrapped = {"method": "bootstrap", "draws": 40}
    intervals = fit.confidence_intervals(**bootstrapped, rng=np.random.default_rng(5))
    assert intervals == fit.confidence_intervals(**bootstrapped, rng=one.seed)
    assert fit.summary(**bootstrapped, rng=np.random.default_rng(5)) == fit.summary(**bootstrapped, rng=one.seed)
    for method in (fit.goodness_of_fit, fit.wic):
        drawn, given = (method(**bootstrapped, rng=rng) for rng in (np.random.default_rng(5), one.seed))
        assert drawn.to_dict() == given.to_dict()


def test_options_are_checked(fit):
    with raises(gmwm.errors.OptionError, "level", 95):
        fit.confidence_intervals(95)
    with raises(gmwm.errors.OptionError, "'asymptotic' or 'bootstrap'", argument="method", got="exact"):
        fit.confidence_intervals(method="exact")
    for draws in (0, 1, 2.5, True):
        with raises(gmwm.errors.OptionError, "at least 2,", argument="draws", got=draws):
            fit.bootstrap(draws=draws)
    with raises(gmwm.errors.OptionError, argument="covariance", advises=["method='asymptotic'"]):
        fit.confidence_intervals(method="bootstrap", covariance=fit.sandwich.wavelet)


def test_too_few_records_are_refused(fit):
    for level, least in ((0.8, 9), (0.95, 39), (0.99, 199)):
        with raises(gmwm.errors.OptionError, f"at least {least}, for an interval", argument="draws", got=least - 1):
            fit.confidence_intervals(level, method="bootstrap", draws=least - 1)
    assert set(fit.confidence_intervals(0.8, method="bootstrap", draws=9)) == set(fit.parameters)
    with raises(gmwm.errors.OptionError, "at least 39,", argument="draws", got=38):
        fit.summary(method="bootstrap", draws=38)
    # A test of so wide an interval needs more than the interval.
    with raises(gmwm.errors.OptionError, "at least 19,", argument="draws", got=18):
        fit.summary(0.5, method="bootstrap", draws=18)


def test_results_are_shown_short(fit):
    assert repr(fit.bootstrap(draws=20, rng=3)) == "Bootstrap(20 draws of GM.beta, GM.sigma2, WN.sigma2, seed 3)"
    assert repr(fit.sandwich) == "Sandwich(GM.beta, GM.sigma2, WN.sigma2, 15 levels)"


def test_a_covariance_must_be_one(fit):
    good = fit.sandwich.wavelet
    for matrix, facts in (
        (np.eye(3), ("15 x 15 matrix", "(3, 3)")),
        (np.diag(good), ("15 x 15 matrix", "(15,)")),
        (np.full((15, 15), np.nan), ("finite", "225 NaN")),
        ([["a"] * 15] * 15, ("15 x 15 matrix of numbers",)),
        (-good, ("variances on its diagonal",)),
        (good + np.triu(good, 1), ("symmetric",)),
        (2 * good * (np.ones((15, 15)) - np.eye(15)) + np.diag(np.diag(good)), ("positive semidefinite",)),
    ):
        with raises(gmwm.errors.OptionError, *facts, argument="covariance", advises=["empirical_covariance(x, rate)"]):
            fit.confidence_intervals(covariance=matrix)


def test_a_covariance_may_be_of_fewer_directions_and_in_any_unit(fit):
    # Of rank one, so that its least eigenvalues are rounding errors of either sign.
    size = np.sqrt(np.diag(fit.sandwich.wavelet))
    assert set(fit.confidence_intervals(covariance=np.outer(size, size))) == set(fit.parameters)
    x = 1e-9 * WN(sigma2=4.0).simulate(5000, RATE, 1)
    tiny = gmwm.fit("WN", x, RATE)
    low, high = tiny.confidence_intervals(covariance=gmwm.covariance.empirical_covariance(x, RATE))["WN.sigma2"]
    assert low < 4e-18 < high


def test_a_fit_without_noise_has_no_intervals():
    fit = gmwm.fit("DR", 1e-3 * np.arange(1000.0), RATE)
    assert fit.parameters["DR.omega"] == pytest.approx(1e-3)
    for ask in (
        lambda: fit.covariance,
        lambda: fit.standard_errors,
        fit.confidence_intervals,
        lambda: fit.confidence_intervals(method="bootstrap", draws=39),
    ):
        with raises(gmwm.errors.ModelError, "DR as estimated", "no noise at some level"):
            ask()
    for text in (fit.summary(), fit.summary(method="bootstrap", draws=39), fit._repr_html_()):
        assert "DR as estimated has no noise at some level" in text
    assert "not tested" in fit.summary()
    assert inference(fit, IntervalMethod())["confidence_intervals"] == {}


def test_a_term_that_acts_as_another_says_what_it_amounts_to():
    truth = WN(sigma2=4e-6) + RW(gamma2=1e-9)
    x = truth.simulate(20_000, RATE, 1)
    fit, plain = gmwm.fit("GM + WN", x, RATE), gmwm.fit("RW + WN", x, RATE)
    assert fit.diagnostics.acts_as == {"GM": "RW"}
    facts = only(fit.remarks, "correlation-time-unknown:fit").facts
    assert (facts["term"], facts["process"], facts["parameter"]) == ("GM", "RW", "RW.gamma2")
    assert facts["amount"].unit.endswith("per sample")
    assert facts["amount"].value == pytest.approx(plain.parameters["RW.gamma2"], rel=1e-3)
    assert facts["amount"].value == pytest.approx(
        2 * fit.parameters["GM.beta"] * fit.parameters["GM.sigma2"] / RATE, rel=1e-3
    )
    assert only(fit.remarks, "correlation-time-unknown:fit").text() in fit.summary()
    short = short_values(fit, IntervalMethod())
    assert short["GM.beta"] == short["GM.sigma2"] == "as RW"
    assert "±" in short["WN.sigma2"]
    white = gmwm.fit("GM + RW", x, RATE)
    facts = only(white.remarks, "correlation-time-unknown:fit").facts
    assert facts["parameter"] == "WN.sigma2"
    assert facts["amount"].value == pytest.approx(plain.parameters["WN.sigma2"], rel=1e-3)


def test_a_covariance_of_ones_own(fit):
    same = fit.confidence_intervals(covariance=fit.sandwich.wavelet)
    assert same == fit.confidence_intervals()
    wider = fit.confidence_intervals(covariance=4 * fit.sandwich.wavelet)
    for name, (low, high) in same.items():
        assert np.log(wider[name][1] / wider[name][0]) == pytest.approx(2 * np.log(high / low), rel=1e-9)


def test_summary_says_the_lot(fit):
    text = fit.summary()
    for words in ("60000 samples at 100 Hz", "15 levels", "weighting diagonal", "objective", "goodness of fit",
                  "levels 1 to 13", "95 % interval", "GM.beta", "1/s", "with any number of terms"):  # fmt: skip
        assert words in text
    assert "90 % interval" in fit.summary(0.9)


def test_summary_of_what_is_not_there():
    fit = gmwm.fit("2*GM + WN + RW", WN(sigma2=4.0).simulate(30_000, RATE, 6), RATE)
    text = fit.summary()
    assert all(remark.about("").text() in text for remark in fit.remarks if code_of(remark) == "term-zero:fit")
    assert len(fit.diagnostics.not_supported) == codes(fit.remarks).count("term-zero:fit") > 0
    assert "undetermined" in text
    assert "at most" in text


def test_html_has_every_parameter_and_is_escaped(fit):
    html = fit._repr_html_()
    assert html.count("<tr>") == 4
    assert "GM.beta" in html
    assert "&lt;" in gmwm.fit("WN", (WN(1.0) + RW(1.0)).simulate(1000, RATE, 1), RATE)._repr_html_()


def test_as_plain_numbers(fit):
    found = json.loads(json.dumps(inference(fit, IntervalMethod()), allow_nan=False))
    assert set(found["confidence_intervals"]) == set(fit.parameters)
    assert found["goodness_of_fit"]["left_out"] == [14, 15]
    undetermined = gmwm.fit("GM + WN + RW", WN(sigma2=4.0).simulate(30_000, RATE, 6), RATE)
    json.dumps(inference(undetermined, IntervalMethod()), allow_nan=False)


def test_a_process_without_covariance_is_fitted_with_weights_of_the_data():
    class Pure(Process, register=False):
        name = "P"
        title = "Only a shape"
        parameters = (Parameter("q", "q", "scale", signal_power=2, scale_power=1),)
        q: float | None = None

        def __init__(self, q=None):
            object.__setattr__(self, "q", q)

        @classmethod
        def shape(cls, nonlinear, levels, rate, filter=HAAR):
            return np.tile(2.0 ** -np.asarray(levels, dtype=float), (len(nonlinear), 1))

        def with_values(self, **values):
            return Pure(values["q"])

    fit = gmwm.fit(gmwm.Model((Pure(),)), WN(sigma2=4.0).simulate(30_000, RATE, 6), RATE)
    assert fit.parameters["P.q"] == pytest.approx(4.0, rel=0.05)
    assert "weights-from-data:no-autocovariance" in codes(fit.remarks)
    assert inference(fit, IntervalMethod())["confidence_intervals"] == {}
    with pytest.raises(gmwm.errors.MissingTheoryError):
        gmwm.fit(gmwm.Model((Pure(),)), WN(sigma2=4.0).simulate(30_000, RATE, 6), RATE, weighting="optimal")
