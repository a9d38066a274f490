"""First-order Markov processes: what is said where a record holds few of their correlation times."""

import warnings

import pytest

from gmwm import AR1, GM, Model, fit
from gmwm.errors import FitWarning
from gmwm.processes.markov import FEW_TIMES

RATE = 100.0


def test_few_correlation_times_are_told():
    (said,) = GM(beta=2.0, sigma2=1.0).remarks(500, RATE)
    assert "the recording holds 10 of its correlation times" in said
    assert f"fewer than {FEW_TIMES}" in said
    assert 'confidence_intervals(method="profile")' in said
    at_limit = FEW_TIMES * 50
    assert GM(beta=2.0, sigma2=1.0).remarks(at_limit - 1, RATE)
    assert GM(beta=2.0, sigma2=1.0).remarks(at_limit + 1, RATE) == ()
    assert GM(beta=0.2, sigma2=1e-8).remarks(720_000, RATE) == ()


def test_an_autoregression_is_told_the_same():
    assert AR1(phi=0.98, sigma2=1.0).remarks(500, RATE)[0].startswith("the recording holds 10 of its correlation times")
    for phi in (0.5, 0.0, -0.999):
        assert AR1(phi=phi, sigma2=1.0).remarks(500, RATE) == ()


def test_a_fit_says_it_once_and_not_of_a_term_that_acts_as_another():
    truth = Model.parse("GM(beta=2.0, sigma2=1.0) + WN(sigma2=1.0)")
    with pytest.warns(FitWarning, match="GM: the recording holds .* of its correlation times"):
        short = fit("GM + WN", truth.simulate(1000, RATE, 1), RATE)
    assert len(short.diagnostics.remarks) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fit("GM + WN", truth.simulate(20_000, RATE, 1), RATE)
    walk = Model.parse("RW(gamma2=1e-2) + WN(sigma2=1.0)").simulate(20_000, RATE, 1)
    with pytest.warns(FitWarning, match="acts as RW"):
        wandering = fit("GM + WN", walk, RATE)
    assert wandering.diagnostics.acts_as == {"GM": "RW"}
    assert wandering.diagnostics.remarks == ()
