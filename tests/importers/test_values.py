"""Numbers of a datasheet as noise models, against the Allan variances of IEEE Std 952."""

import math

import numpy as np
import pytest

from gmwm.base.errors import ModelError
from gmwm.files.importers import Values
from gmwm.files.importers.values import FLOOR, GAUSS_MARKOV_PEAK
from gmwm.theory.processes import GM

RATE = 50.0


def allan(values, seconds):
    return values.model(RATE).allan_variance(np.array([round(RATE * t) for t in seconds]), RATE)


def test_each_number_has_its_allan_variance():
    tau = np.array([10.0, 100.0, 1000.0])
    assert allan(Values(N=2e-4), tau) == pytest.approx(4e-8 / tau)
    assert allan(Values(K=2e-6), tau) == pytest.approx(4e-12 * tau / 3, rel=1e-5)
    assert allan(Values(B=3e-5), tau) == pytest.approx(2 * math.log(2) / math.pi * 9e-10)
    assert allan(Values(Q=2e-6), tau) == pytest.approx(3 * 4e-12 / tau**2, rel=1e-6)
    assert allan(Values(R=2e-7), tau) == pytest.approx(4e-14 * tau**2 / 2, rel=1e-6)


def test_bias_instability_over_a_time_has_its_allan_deviation_as_maximum():
    model = Values(B=3e-5, time=100.0).model(RATE)
    n = np.unique(np.round(np.geomspace(1, 1e6, 4000)).astype(int))
    sigma = np.sqrt(model.allan_variance(n, RATE))
    assert sigma.max() == pytest.approx(FLOOR * 3e-5, rel=1e-5)
    assert n[np.argmax(sigma)] / RATE == pytest.approx(1.8926 * 100.0, rel=0.01)
    one = GM(beta=1.0, sigma2=1.0)
    assert np.sqrt(one.allan_variance(np.arange(1500, 2500, 5), 1000.0)).max() == pytest.approx(
        GAUSS_MARKOV_PEAK, rel=1e-6
    )


def test_a_markov_process_with_its_standard_deviation():
    assert Values(sigma=2e-4, time=50.0).model(RATE).parameters == {"GM.beta": 0.02, "GM.sigma2": pytest.approx(4e-8)}


def test_all_zero_is_refused():
    with pytest.raises(ModelError):
        Values(N=0.0, K=0.0).model(RATE)
