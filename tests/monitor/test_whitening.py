"""The whitening filter against dense matrices, and its independence of cuts."""

from __future__ import annotations

import json
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from gmwm import Model
from gmwm.applications.monitor.whitening import FRAME_SAMPLES, Finite, Gain, Whitener
from gmwm.base.errors import ModelError

RATE = 100.0
N = 400
LEVEL = 1e9
"""Variance of the unknown level in the dense matrices; all other variances are of order 1."""

Array = NDArray[np.float64]


def dense(model: Model, observed: NDArray[np.int64]) -> Array:
    """The covariance of a model with an unknown level, from autocovariances; a walk is γ² min(i, j)."""
    lag = np.abs(np.subtract.outer(observed, observed))
    total = np.full(lag.shape, LEVEL)
    for process in model.processes:
        if process.name == "RW":
            total += process.scale * (1 + np.minimum.outer(observed, observed))
        else:
            total += process.autocovariance(lag.ravel(), RATE).reshape(lag.shape)
    return total


MODELS = (
    "WN(sigma2=1)",
    "WN(sigma2=1) + RW(gamma2=0.01)",
    "GM(beta=3, sigma2=2) + GM(beta=0.2, sigma2=4) + WN(sigma2=1) + RW(gamma2=1e-4)",
    "AR(2, phi1=1.4, phi2=-0.6, sigma2=1) + WN(sigma2=0.5)",
    "MA(1, theta1=0.5, sigma2=1) + GM(beta=1, sigma2=1)",
)


def whitener(text: str) -> Whitener:
    return Whitener(Gain.of(Finite.of(Model.parse(text), RATE)))


@pytest.mark.parametrize("text", MODELS)
def test_the_start_is_exact(text: str) -> None:
    model = Model.parse(text)
    x = model.simulate(N, RATE, rng=1) + 20.0
    found = whitener(text).update(x)
    wanted = solve_triangular(cholesky(dense(model, np.arange(N)), lower=True), x, lower=True)
    np.testing.assert_allclose(found[1:], wanted[1:], atol=1e-4)
    assert found[0] == 0.0


@pytest.mark.slow
def test_a_settled_filter_predicts_across_a_gap() -> None:
    # A walk that is learnt in some samples, so that the dense matrices can be small.
    model = Model.parse("WN(sigma2=1) + RW(gamma2=4)")
    made = Whitener(Gain.of(Finite.of(model, RATE)))
    x = model.simulate(2 * FRAME_SAMPLES + 100, RATE, rng=2)
    at = np.concatenate([np.arange(2 * FRAME_SAMPLES), np.arange(2 * FRAME_SAMPLES + 7, x.size)])
    first = made.update(x[: 2 * FRAME_SAMPLES])
    assert made.columns == 0
    made.gap(7)
    found = np.concatenate([first, made.update(x[2 * FRAME_SAMPLES + 7 :])])
    wanted = solve_triangular(cholesky(dense(model, at), lower=True), x[at], lower=True)
    np.testing.assert_allclose(found[1:], wanted[1:], atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("text", [*MODELS, "FN(b2=0.1) + WN(sigma2=1)", "SIN(frequency=7, power=2) + WN(sigma2=1)"])
def test_cuts_and_json_do_not_change_a_bit(text: str) -> None:
    rng = np.random.default_rng(3)
    x = Model.parse(text).simulate(3 * FRAME_SAMPLES, RATE, rng=4)
    whole = whitener(text).update(x)
    cuts = np.unique([0, *rng.integers(0, x.size, 40), *range(100, 130), x.size])
    made, parts = whitener(text), []
    for a, b in pairwise(cuts.tolist()):
        parts.append(made.update(x[a:b]))
        state: dict[str, Any] = {k: np.asarray(v).tolist() for k, v in made.save().items()}
        made = whitener(text)
        made.load(json.loads(json.dumps(state)))
    assert np.array_equal(np.concatenate(parts), whole)


@pytest.mark.parametrize(
    "text",
    ["FN(b2=0.1)", "FN(b2=0.01) + WN(sigma2=1)", "PL(alpha=0.7, nu2=0.1) + WN(sigma2=1)"],
)
def test_power_law_noise_becomes_a_sum_of_markov_processes(text: str) -> None:
    model = Model.parse(text)
    finite = Finite.of(model, RATE)
    assert [remark.code for remark in finite.remarks] == ["approximated"]
    x = model.simulate(1 << 17, RATE, rng=5)
    e = Whitener(Gain.of(finite)).update(x)
    sums = e.copy()
    for level in range(10):
        # Mean squares of block sums of white noise: 1, with a standard error of √(2/blocks).
        assert abs(np.mean(sums**2) / (1 << level) - 1) < 0.05 + 5 * np.sqrt(2 / sums.size)
        sums = sums[::2] + sums[1::2]


@pytest.mark.slow
def test_a_constant_level_is_never_forgotten() -> None:
    x = 5.0 + np.random.default_rng(6).standard_normal(2_000_000)
    e = whitener("WN(sigma2=1)").update(x)
    assert abs(np.mean(e[1_500_000:])) < 5 / np.sqrt(500_000)


def test_models_without_values_or_noise_are_refused() -> None:
    with pytest.raises(ModelError):
        Finite.of(Model.parse("WN + RW"), RATE)
    with pytest.raises(ModelError):
        Finite.of(Model.parse("WN(sigma2=0)"), RATE)


@pytest.mark.parametrize("name", ["power", "information"])
def test_a_state_whose_matrices_would_overflow_is_refused(name):
    made = whitener(MODELS[0])
    made.update(np.random.default_rng(1).normal(size=10))
    state = made.save()
    with pytest.raises(ValueError, match="expected a number"):
        made.load({**state, name: np.full_like(state[name], 1e308)})
