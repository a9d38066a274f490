"""The parametric bootstrap of a fit, and a fit in words."""

import json

import numpy as np
import pytest

import gmwm
from gmwm import GM, RW, WN
from gmwm.filters import HAAR
from gmwm.inference.summary import Way, inference
from gmwm.processes.base import Process
from gmwm.processes.parameter import Parameter

RATE = 100.0
pytestmark = pytest.mark.filterwarnings("ignore::gmwm.FitWarning")


@pytest.fixture(scope="module")
def fit():
    x = (GM(beta=0.5, sigma2=0.2) + WN(sigma2=4.0)).simulate(60_000, RATE, 2)
    return gmwm.fit("GM + WN", x, RATE)


def test_standard_errors_of_the_bootstrap_are_those_of_theory(fit):
    again = fit.bootstrap(draws=300, seed=1)
    for name, error in fit.standard_errors.items():
        assert again.errors[name] == pytest.approx(error, rel=0.2)
    assert again.estimates.shape == (300, 3)
    np.testing.assert_allclose(again.variances.mean(axis=0)[:8], fit.implied[:8], rtol=0.02)


def test_intervals_of_both_kinds_agree(fit):
    one, other = fit.confidence_intervals(), fit.confidence_intervals(method="bootstrap", draws=300, seed=1)
    for name, (low, high) in one.items():
        assert np.log(other[name][1] / other[name][0]) == pytest.approx(np.log(high / low), rel=0.25)


def test_the_same_seed_gives_the_same_bootstrap(fit):
    first = fit.bootstrap(draws=20, seed=3)
    x = gmwm.fit("GM + WN", fit.wavelet_variance).bootstrap(draws=20, seed=3)
    np.testing.assert_array_equal(first.estimates, x.estimates)
    assert not np.array_equal(first.estimates, fit.bootstrap(draws=20, seed=4).estimates)


def test_options_are_checked(fit):
    with pytest.raises(gmwm.OptionError, match="between 0 and 1"):
        fit.confidence_intervals(95)
    with pytest.raises(gmwm.OptionError, match="'asymptotic'"):
        fit.confidence_intervals(method="exact")
    with pytest.raises(gmwm.OptionError, match="draws"):
        fit.bootstrap(draws=0)
    with pytest.raises(gmwm.OptionError, match="belongs to"):
        fit.confidence_intervals(method="bootstrap", covariance=fit.sandwich.wavelet)
    with pytest.raises(gmwm.OptionError, match="finite numbers"):
        fit.confidence_intervals(covariance=np.eye(3))


def test_a_covariance_of_ones_own(fit):
    same = fit.confidence_intervals(covariance=fit.sandwich.wavelet)
    assert same == fit.confidence_intervals()
    wider = fit.confidence_intervals(covariance=4 * fit.sandwich.wavelet)
    for name, (low, high) in same.items():
        assert np.log(wider[name][1] / wider[name][0]) == pytest.approx(2 * np.log(high / low), rel=1e-9)


def test_summary_says_the_lot(fit):
    text = fit.summary()
    for words in ("60000 samples at 100 Hz", "15 levels", "weighting diagonal", "objective", "goodness of fit",
                  "levels 1 to 13", "95 % interval", "GM.beta", "1/s", "any number of terms"):  # fmt: skip
        assert words in text
    assert "90 % interval" in fit.summary(0.9)


def test_summary_of_what_is_not_there():
    fit = gmwm.fit("2*GM + WN + RW", WN(sigma2=4.0).simulate(30_000, RATE, 6), RATE)
    text = fit.summary()
    assert "not supported by these data" in text
    assert "undetermined" in text
    assert "at most" in text


def test_html_has_every_parameter_and_is_escaped(fit):
    html = fit._repr_html_()
    assert html.count("<tr>") == 4
    assert "GM.beta" in html
    assert "&lt;" in gmwm.fit("WN", (WN(1.0) + RW(1.0)).simulate(1000, RATE, 1), RATE)._repr_html_()


def test_as_plain_numbers(fit):
    found = json.loads(json.dumps(inference(fit, Way()), allow_nan=False))
    assert set(found["confidence_intervals"]) == set(fit.parameters)
    assert found["goodness_of_fit"]["left_out"] == [14, 15]
    undetermined = gmwm.fit("GM + WN + RW", WN(sigma2=4.0).simulate(30_000, RATE, 6), RATE)
    json.dumps(inference(undetermined, Way()), allow_nan=False)


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
    assert any("weights are those that the data show" in note for note in fit.diagnostics.notes())
    assert "no intervals" in fit.summary()
    with pytest.raises(gmwm.MissingTheoryError):
        gmwm.fit(gmwm.Model((Pure(),)), WN(sigma2=4.0).simulate(30_000, RATE, 6), RATE, weighting="optimal")
