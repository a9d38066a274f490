"""Whether the noise depends on a condition: size and coverage with a simulator apart from the package."""

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import DataError, OptionError
from gmwm.fitting.inference import noise_against
from tests.helpers import raises

N = 1 << 14
T = np.arange(N) / N
TEMPERATURE = 25 + 10 * np.cos(3 * np.pi * T)


def drawn(rng, white=0.0, walk=0.0, condition=TEMPERATURE):
    """White noise and a random walk whose standard deviations have these slopes, on a mean that follows too."""
    away = condition - condition.mean()
    steps = 0.04 * np.exp(walk * away) * rng.normal(size=N)
    return np.exp(white * away) * rng.normal(size=N) + np.cumsum(steps) + 0.5 * condition


def examined(x, condition, model="WN + RW"):
    return noise_against(gmwm.Signal(x, 100.0, unit="rad/s", axis="gyro_x"), condition, model=model)


@pytest.mark.slow
def test_size_and_scatter_of_constant_noise():
    rng = np.random.default_rng(1)
    found = [examined(drawn(rng), {"temperature": TEMPERATURE}) for _ in range(30)]
    assert 0 <= sum(one.pvalue < 0.05 for one in found) <= 5  # probability 1 % at a size of 5 %
    scores = np.array([[slope.value / slope.error for slope in one.slopes[:7]] for one in found])
    assert np.all(np.abs(np.std(scores, axis=0) - 1) < 4 / np.sqrt(2 * 30))
    assert np.all(np.abs(np.mean(scores, axis=0)) < 4 / np.sqrt(30))


@pytest.mark.slow
def test_slopes_of_terms_are_found_and_covered():
    rng = np.random.default_rng(2)
    found = [examined(drawn(rng, 0.03, -0.02), {"temperature": TEMPERATURE}) for _ in range(24)]
    for term, truth in (("WN", 0.03), ("RW", -0.02)):
        values = np.array([one.terms[term].value for one in found])
        errors = np.array([one.terms[term].error for one in found])
        assert abs(np.mean(values) - truth) < 4 * np.mean(errors) / np.sqrt(24)
        assert np.mean(np.abs(values - truth) < 1.96 * errors) > 0.85
    assert all(one.pvalue < 1e-6 for one in found)


@pytest.mark.slow
def test_heavy_tails_and_knocks_are_no_slope():
    rng = np.random.default_rng(3)
    pvalues, errors = [], []
    for _ in range(16):
        x = rng.standard_t(4, size=N)
        x[rng.integers(N // 4, size=3)] += 1000.0
        one = examined(x, {"temperature": TEMPERATURE}, "WN")
        pvalues.append(one.pvalue)
        errors.append(one.terms["WN"].value / one.terms["WN"].error)
    assert sum(p < 0.05 for p in pvalues) <= 3
    assert np.std(errors) < 1.5


@pytest.mark.slow
def test_noise_that_changes_in_time_is_found_across_a_gap():
    rng = np.random.default_rng(4)
    x = drawn(rng) * np.exp(0.3 * T)
    missing = np.zeros(N, dtype=bool)
    missing[9000:9400] = True
    signal = gmwm.Signal.from_missing(np.where(missing, np.nan, x), 100.0)
    found = noise_against(signal, "time", model="WN + RW")
    hours = N / 100 / 3600
    assert found.terms["WN"].value == pytest.approx(0.3 / hours, abs=4 * found.terms["WN"].error)
    assert found.unit == "h"


def test_only_scales_over_which_the_condition_is_constant_are_used():
    fast = {"rate:exact": np.sin(2 * np.pi * np.arange(N) / 512)}
    found = examined(drawn(np.random.default_rng(5)), fast)
    assert found.levels[-1] == 7
    with raises(DataError, "too quickly", argument="condition"):
        examined(drawn(np.random.default_rng(5)), {"rate:exact": np.sin(2 * np.pi * np.arange(N) / 3.1)})


def test_set_points_are_exact():
    steps = np.repeat([0.0, 20.0, 40.0, 10.0], N // 4)
    x = np.random.default_rng(6).normal(size=N) * (1 + 0.01 * steps)
    found = examined(x, {"chamber:exact": steps}, "WN")
    assert found.terms["WN"].value == pytest.approx(0.01 / 1.175, rel=0.1)


def test_the_text_says_per_cent_and_the_document_is_complete():
    found = examined(drawn(np.random.default_rng(7), 0.05), {"temperature": TEMPERATURE})
    assert "changes with temperature from 15 to 35 °C" in found.summary()
    assert "%/°C" in found.summary()
    content = found.to_dict()
    assert content["terms"]["WN"]["value"] == found.terms["WN"].value
    assert len(content["slopes"]) == len(content["levels"]) == len(found.tau)


@pytest.mark.parametrize("condition", ["temperature", "warmup", None, {"a": TEMPERATURE, "b": T}])
def test_one_condition_is_needed(condition):
    with raises(OptionError, argument="condition"):
        examined(drawn(np.random.default_rng(8)), condition)
