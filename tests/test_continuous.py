"""Continuous systems have the steps of the discrete ones, at the rate of the recording and at others."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

import gmwm
from gmwm.base.errors import MissingTheoryError, ModelError, OptionError
from gmwm.theory.continuous_statespace import ContinuousStateSpace
from gmwm.theory.processes import Model
from gmwm.theory.statespace import StateSpace
from tests.helpers import raises

MODELS = (
    "WN(sigma2=4e-7)",
    "GM(beta=0.1, sigma2=2e-8) + RW(gamma2=1e-11) + WN(sigma2=6e-7)",
    "GM(beta=1e-3, sigma2=1e-8) + GM(beta=3.0, sigma2=1e-8) + DR(omega=-1e-9)",
    "AR1(phi=0.9, sigma2=1e-8) + WN(sigma2=6e-7)",
    "SIN(frequency=0.7, power=2e-8) + SIN(frequency=2.1, power=1e-8) + GM(beta=1e-6, sigma2=1e-8)",
    "QN(q2=3e-7) + WN(sigma2=6e-7) + GM(beta=50.0, sigma2=0.0)",
)
# A walk of a walk: both states wander, and the noise of one reaches the other within a step.
SLOPE, STEP = 3.0, 0.02
WALKS = StateSpace(
    F=[[1.0, STEP], [0.0, 1.0]],
    Q=SLOPE * np.array([[STEP**3 / 3, STEP**2 / 2], [STEP**2 / 2, STEP]]),
    H=[1.0, 0.0],
    diffuse=[True, True],
)


def the_same(found, expected, rtol=1e-12):
    for name in ("F", "Q", "H", "R", "m0", "P0", "diffuse"):
        wanted = getattr(expected, name)
        # Entries that are sums of others of the same matrix, as a sine near its zero, have the digits of the largest.
        np.testing.assert_allclose(
            getattr(found, name), wanted, rtol=rtol, atol=1e-15 * np.max(np.abs(wanted), initial=0.0)
        )


@pytest.mark.parametrize("text", MODELS)
@pytest.mark.parametrize("rate", [10.0, 400.0])
def test_steps_agree_with_van_loan_s_exponential_of_the_whole(text, rate):
    model = Model.parse(text)
    space, found = model.state_space(rate), model.continuous(rate)
    kept = [k for k, term in enumerate(model.state_terms(rate)) if term not in found.left_out]
    p = len(kept)
    assert found.states == p
    assert found.terms == tuple(model.state_terms(rate)[k] for k in kept)
    # The exponential of [[−A, Qc], [0, Aᵀ]] Δt has F⁻¹Q and Fᵀ in its right half.
    whole = expm(np.block([[-found.A, found.Qc], [np.zeros((p, p)), found.A.T]]) / rate)
    step = whole[p:, p:].T
    scale = np.sqrt(np.maximum(np.diag(space.Q)[kept], 1e-30))
    assert step == pytest.approx(space.F[np.ix_(kept, kept)], rel=1e-9, abs=1e-12)
    assert (step @ whole[:p, p:]) / np.outer(scale, scale) == pytest.approx(
        space.Q[np.ix_(kept, kept)] / np.outer(scale, scale), rel=1e-6, abs=1e-9
    )
    assert found.Rc[0, 0] * rate == pytest.approx(space.R[0, 0], rel=1e-12)
    assert np.array_equal(found.H[0], space.H[0, kept])


@pytest.mark.parametrize("text", MODELS[:-1])
def test_there_and_back(text):
    model = Model.parse(text)
    the_same(model.continuous(250.0).discrete(250.0), model.state_space(250.0))


@pytest.mark.parametrize("rate", [1.0, 37.0, 1e4])
def test_at_another_rate_it_is_the_process_sampled_there(rate):
    # β and the variance of a Gauss-Markov process hang on no rate; γ² is per sample, σ² that of a mean over a step.
    found = Model.parse("GM(beta=2.0, sigma2=3.0) + RW(gamma2=0.5) + WN(sigma2=8.0)").continuous(100.0).discrete(rate)
    there = Model.parse(f"GM(beta=2.0, sigma2=3.0) + RW(gamma2={50 / rate!r}) + WN(sigma2={0.08 * rate!r})")
    for name in ("F", "Q", "H", "R"):
        np.testing.assert_allclose(getattr(found, name), getattr(there.state_space(rate), name), rtol=1e-12)


@pytest.mark.parametrize("decay", [1e-14, 1e-8, 1e-3, 30.0])
def test_a_process_next_to_a_walk_or_to_white_noise_loses_no_digits(decay):
    rate = 100.0
    model = Model.parse(f"GM(beta={decay * rate!r}, sigma2=4.0) + GM(beta=70.0, sigma2=1.0)")
    found = model.continuous(rate)
    assert found.A[0, 0] == pytest.approx(-decay * rate, rel=1e-15)
    assert found.Qc[0, 0] == pytest.approx(8.0 * decay * rate, rel=1e-15)
    assert found.discrete(rate).Q[0, 0] == pytest.approx(-4.0 * math.expm1(-2.0 * decay), rel=1e-14)


def test_states_that_drive_one_another():
    found = ContinuousStateSpace.of(WALKS, 1 / STEP)
    np.testing.assert_allclose(found.A, [[0.0, 1.0], [0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(found.Qc, [[0.0, 0.0], [0.0, SLOPE]], atol=1e-9 * SLOPE)
    the_same(found.discrete(1 / STEP), WALKS, rtol=1e-9)
    # Over a step of 5 s, by the closed form.
    long = found.discrete(0.2)
    np.testing.assert_allclose(long.F, [[1.0, 5.0], [0.0, 1.0]], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(long.Q, SLOPE * np.array([[125 / 3, 12.5], [12.5, 5.0]]), rtol=1e-7)


def test_steps_of_a_fast_oscillator_do_not_overflow():
    damped = ContinuousStateSpace(A=[[-400.0, 900.0], [-900.0, -400.0]], Qc=1e-9 * np.eye(2), H=[1.0, 0.0])
    once = damped.discrete(1.0)
    assert np.max(np.abs(once.F)) < 1e-150
    # In the long run its variance is Qc/(2·400).
    np.testing.assert_allclose(once.Q, 1e-9 / 800 * np.eye(2), rtol=1e-12, atol=1e-24)


@pytest.mark.parametrize(
    "text",
    ["QN(q2=1e-7)", "AR1(phi=-0.5, sigma2=1e-7)", "AR(2, phi1=1.4, phi2=-0.6, sigma2=1)", "MA(1, theta1=0.3, sigma2=1)",
     "SARMA(1, 0, 1, 0, period=24, phi1=0.5, sphi1=0.5, sigma2=1)"],
)  # fmt: skip
def test_steps_without_a_continuous_form_are_left_out_and_named(text):
    model = Model.parse(text) + gmwm.RW(gamma2=2.0)
    found = model.continuous(100.0)
    assert found.left_out == model.terms[:1]
    assert found.terms == ("RW",)
    np.testing.assert_array_equal(found.Qc, [[200.0]])


def test_steps_whose_noise_no_covariance_can_drive_have_no_continuous_form():
    # The noise of the second state reaches the first within a step, with at least q Δt³/12.
    for share, there in ((1.001, True), (0.999, False)):
        noise = SLOPE * np.diag([share * STEP**3 / 12, STEP])
        assert (ContinuousStateSpace.of(StateSpace(WALKS.F, noise, WALKS.H), 1 / STEP) is not None) == there


def test_matrices_are_read_only_and_checked():
    found = Model.parse("RW(gamma2=1.0)").continuous(10.0)
    with pytest.raises(ValueError, match="read-only"):
        found.A[0, 0] = 1.0
    with raises(ModelError, "(2, 2)", "H has 2 states", argument="Qc", got=1.0):
        ContinuousStateSpace(A=np.eye(2), Qc=1.0, H=[1.0, 0.0])
    with raises(OptionError, "rate", 0):
        found.discrete(0.0)
    with raises(MissingTheoryError, "PL", "state space"):
        Model.parse("PL(alpha=-0.5, nu2=1.0) + WN(sigma2=1.0)").continuous(10.0)
    with raises(ModelError, "GM.beta"):
        Model.parse("GM + WN").state_terms(10.0)
