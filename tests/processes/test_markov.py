"""First-order Markov processes: what is said where a record holds few of their correlation times."""

import warnings

import pytest

from gmwm import AR1, GM, Model, fit
from gmwm.base.errors import FitWarning
from gmwm.theory.processes.markov import FEW_TIMES
from tests.helpers import codes

RATE = 100.0


def test_few_correlation_times_are_told():
    (remark,) = GM(beta=2.0, sigma2=1.0).remarks("GM", 500, RATE)
    assert remark.code == "few-correlation-times"
    assert remark.facts == {"term": "GM", "count": pytest.approx(10.0), "least": FEW_TIMES}
    at_limit = FEW_TIMES * 50
    assert GM(beta=2.0, sigma2=1.0).remarks("GM", at_limit - 1, RATE)
    assert GM(beta=2.0, sigma2=1.0).remarks("GM", at_limit + 1, RATE) == ()
    assert GM(beta=0.2, sigma2=1e-8).remarks("GM", 720_000, RATE) == ()


def test_an_autoregression_is_told_the_same():
    (remark,) = AR1(phi=0.98, sigma2=1.0).remarks("AR1", 500, RATE)
    assert remark.facts["count"] == pytest.approx(10.1, abs=0.05)
    for phi in (0.5, 0.0, -0.999):
        assert AR1(phi=phi, sigma2=1.0).remarks("AR1", 500, RATE) == ()


def test_a_fit_says_it_once_and_not_of_a_term_that_acts_as_another():
    truth = Model.parse("GM(beta=2.0, sigma2=1.0) + WN(sigma2=1.0)")
    with pytest.warns(FitWarning) as caught:
        short = fit("GM + WN", truth.simulate(1000, RATE, 1), RATE)
    assert [one.message.remark.code for one in caught] == codes(short.remarks) == ["few-correlation-times"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fit("GM + WN", truth.simulate(20_000, RATE, 1), RATE)
    walk = Model.parse("RW(gamma2=1e-2) + WN(sigma2=1.0)").simulate(20_000, RATE, 1)
    with pytest.warns(FitWarning):
        wandering = fit("GM + WN", walk, RATE)
    assert wandering.diagnostics.acts_as == {"GM": "RW"}
    assert codes(wandering.remarks) == ["correlation-time-unknown:fit"]
