"""Two Gauss-Markov states in the place of a model: their Allan deviation, by formulas of this file."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import gmwm
from gmwm.showing.exporters.two_states import Curve, apart, two_states

from .conftest import RATE, calibrated, exact_curve
from .test_state_space import loaded

HORIZON, DURATION = 1.0, 1000.0
TIMES = np.geomspace(HORIZON, DURATION, 400)
LADDER = " + ".join(f"GM(beta={beta}, sigma2={sigma2})" for beta, sigma2 in ((0.7, 2e-7), (0.05, 2e-7), (0.003, 6e-7)))
TRUTHS = {
    "gyro_x": f"{LADDER} + WN(sigma2=6e-7)",
    "gyro_y": "FN(b2=2e-9) + WN(sigma2=6e-7)",
    "gyro_z": "GM(beta=0.1, sigma2=2e-8) + WN(sigma2=6e-7)",
}


def gauss_markov(sigma, time, tau):
    """Allan variance of a continuous Gauss-Markov process (Gelb and Sargent 1982, as in IEEE Std 952)."""
    x = tau / time
    return 2 * sigma**2 / x * (1 - (3 - 4 * np.exp(-x) + np.exp(-2 * x)) / (2 * x))


def reduced_variance(found, tau):
    return found["N"] ** 2 / tau + sum(
        gauss_markov(sigma, time, tau) for sigma, time in zip(found["sigma"], found["time"], strict=True)
    )


TABLE = {
    "flicker noise": ("FN(b2=1e-9)", "FN"),
    "flicker noise and a random walk": ("FN(b2=1e-9) + RW(gamma2=1e-13)", "FN + RW"),
    "three Gauss-Markov terms (2 s, 50 s, 1000 s)": (
        "GM(beta=0.5, sigma2=1e-9) + GM(beta=0.02, sigma2=1e-9) + GM(beta=0.001, sigma2=2e-9)", "3*GM",
    ),
    "a Gauss-Markov term (10 s) and a random walk": ("GM(beta=0.1, sigma2=1e-8) + RW(gamma2=1e-14)", "GM + RW"),
}  # fmt: skip
"""The slow noise of the table in docs/exporters.md, and its model."""
PAGE = Path(__file__).parents[2] / "docs" / "exporters.md"


@pytest.mark.parametrize("name", TABLE)
def test_the_table_of_the_page_has_these_errors(name):
    slow, model = TABLE[name]
    levels = np.arange(1, 21)
    variance = gmwm.Model.parse(f"{slow} + WN(sigma2=1e-6)").wavelet_variance(levels, 100.0)
    found = two_states(gmwm.fit(f"{model} + WN", gmwm.WaveletVariance.from_values(variance, 4_000_000, 100.0)), 1.0)
    errors = (found.error_of_walk, found.error_of_one, found.error)
    shown = [re.sub("within | of|up to ", "", apart(error)) for error in errors]
    shown = [re.sub(r"(\S+) times", r"a factor of \1", text) for text in shown]
    assert f"| {name} | {' | '.join(shown)} |" in PAGE.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def unit():
    models = {"gyro_x": "3*GM + WN", "gyro_y": "WN + FN", "gyro_z": "GM + WN"}
    return gmwm.calibrate({axis: exact_curve(axis, truth) for axis, truth in TRUTHS.items()}, models=models)


def test_the_stated_error_is_that_of_the_allan_deviation(unit):
    axes = json.loads(unit.export(format="state-space-json", duration=DURATION))["axes"]
    for axis in ("gyro_x", "gyro_y"):
        found, samples = axes[axis]["two_states"], np.unique(np.round(TIMES * RATE).astype(int))
        whole = gmwm.Model.parse(TRUTHS[axis]).allan_variance(samples, RATE)
        ratio = np.sqrt(reduced_variance(found, samples / RATE) / whole) - 1
        assert np.abs(ratio).max() == pytest.approx(found["error"], rel=0.05)
        assert found["error"] < 0.1
        assert found["error"] < found["error_of_one"] / 3
        assert found["error"] < found["error_of_walk"] / 10


def test_the_matrices_are_those_of_the_two_states(unit):
    names = loaded(unit.export(format="state-space", duration=DURATION))
    small, whole = (names["matrices"]("gyro_x", two_states=one) for one in (True, False))
    assert (small["F"].shape, whole["F"].shape) == ((2, 2), (3, 3))
    states = names["AXES"]["gyro_x"]["two_states"]
    assert np.diag(small["F"]) == pytest.approx(np.exp(-1 / (RATE * np.array(states["time"]))), rel=1e-12)
    assert np.diag(small["P0"]) == pytest.approx(np.square(states["sigma"]), rel=1e-9)
    assert small["R"][0, 0] == pytest.approx(states["N"] ** 2 * RATE, rel=1e-12)
    # One state is enough for gyro_z.
    assert names["AXES"]["gyro_z"]["two_states"] is None
    assert np.array_equal(names["matrices"]("gyro_z", two_states=True)["F"], names["matrices"]("gyro_z")["F"])
    assert names["unit"](two_states=True)["F"].shape == (5, 5)


def test_a_random_walk_and_a_gauss_markov_term_are_their_own_states():
    truth = "GM(beta=0.1, sigma2=2e-8) + RW(gamma2=2e-12) + WN(sigma2=6e-7)"
    found = two_states(calibrated({"gyro_x": truth}, "GM + WN + RW")["gyro_x"], HORIZON, DURATION)
    assert found.error < 0.004
    assert found.time[0] == pytest.approx(10.0, rel=0.02)
    assert found.sigma[0] ** 2 == pytest.approx(2e-8, rel=0.02)
    # Far below its correlation time a state is the random walk.
    assert 2 * found.sigma[1] ** 2 / found.time[1] == pytest.approx(2e-12 * RATE, rel=0.02)


def test_the_slopes_of_the_allan_variance_are_its_derivatives():
    curve, times = Curve(np.array([1, 10, 1000]), RATE, np.ones(3)), np.array([0.02, 1.0, 500.0])
    moved = [curve.units(times * np.exp(step)) for step in (-1e-4, 1e-4)]
    assert curve.slopes(times) == pytest.approx((moved[1] - moved[0]) / 2e-4, rel=1e-6, abs=1e-12)


def test_white_noise_has_no_states():
    assert two_states(calibrated({"gyro_x": "WN(sigma2=6e-7)"}, "WN")["gyro_x"], HORIZON) is None


def test_the_head_states_the_states_and_their_error(unit):
    head = " ".join(json.loads(unit.export(format="state-space-json"))["gmwm"])
    for axis in ("gyro_x", "gyro_y"):
        found = two_states(unit[axis], 1.0)
        assert f"two_states of {axis}: sigma {found.sigma[0]:.3g} rad/s, T {found.time[0]:.4g} s; sigma" in head
    assert "two_states of gyro_z" not in head
