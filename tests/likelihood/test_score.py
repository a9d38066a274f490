"""Slopes of the log-likelihood against its own differences; the information against what the slopes scatter by."""

import numpy as np
import pytest

from gmwm import Model
from gmwm.fitting.likelihood.problem import LikelihoodProblem, as_record
from gmwm.fitting.likelihood.system import DIFFERENCE_STEP, assemble, slopes
from tests.helpers import each
from tests.oracles import gaussian as oracle
from validation.likelihood import fisher_errors

RATE = 100.0
MODELS = (
    "WN(sigma2=2.0)",
    "QN(q2=3.0) + WN(sigma2=0.1)",
    "GM(beta=3.0, sigma2=2.0)",
    "GM(beta=1e-5, sigma2=2.0) + WN(sigma2=1.0)",
    "AR1(phi=0.95, sigma2=1.0) + WN(sigma2=0.5)",
    "AR1(phi=-0.7, sigma2=1.0) + WN(sigma2=0.5)",
    "AR(2, phi1=1.4, phi2=-0.6, sigma2=1.0) + WN(sigma2=3.0)",
    "MA(2, theta1=0.6, theta2=0.3, sigma2=1.0)",
    "ARMA(2, 1, phi1=0.9, phi2=-0.3, theta1=0.5, sigma2=1.0)",
    "SARMA(1, 1, 1, 0, 4, phi1=0.5, theta1=0.2, sphi1=0.6, sigma2=1.0)",
    "SIN(frequency=7.0, power=3.0) + WN(sigma2=1.0)",
    "GM(beta=0.5, sigma2=0.5) + WN(sigma2=1.0) + RW(gamma2=1e-3)",
    "GM(beta=0.5, sigma2=2.0) + GM(beta=20.0, sigma2=0.5) + WN(sigma2=1.0) + QN(q2=0.5) + RW(gamma2=1e-3)",
    "DR(omega=0.01) + GM(beta=0.5, sigma2=0.5) + WN(sigma2=1.0) + RW(gamma2=1e-3)",
    "GM(beta=0.5, sigma2=fixed(2.0)) + WN(sigma2=1.0)",
    "GM(beta=fixed(0.5), sigma2=2.0) + WN(sigma2=1.0)",
)


def problem(text, samples=700, gaps=True, mean=None, seed=1):
    model = Model.parse(text)
    x = 9.81 + model.simulate(samples, RATE, rng=seed)
    if gaps:
        x[[0, 1, 50, 51, *range(300, 340), samples - 1]] = np.nan
    return LikelihoodProblem(model, as_record(x, RATE), None if mean is None else 9.81)


@pytest.mark.slow
@each("mean", [None, 9.81])
@each("gaps", [False, True])
@each("text", MODELS)
def test_slopes_are_those_of_the_value(text, gaps, mean):
    at = problem(text, gaps=gaps, mean=mean)
    # Not at the truth, where some might vanish by chance.
    z = at.start() + 0.1 * np.cos(np.arange(at.start().size))
    everything = list(range(z.size))
    found = at.evaluate(z, everything)
    assert found.value == at.value(at.at_point(z))[0]
    for k in everything:
        # Small beside its standard error: over more than that the likelihood of a frequency is no parabola.
        size = min(1e-3, 0.02 / np.sqrt(found.information[k, k]))
        step = size * np.eye(z.size)[k]
        values = [at.value(at.at_point(z + j * step))[0] for j in (-2, -1, 1, 2)]
        slope = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * size)
        # A slope is the sum of as many terms of order one as there are samples, of which most cancel.
        assert abs(found.gradient[k] - slope) < 1e-6 * np.sqrt(found.information[k, k]) + 1e-7


@each("text", MODELS)
def test_slopes_by_some_coordinates_are_those_by_all(text):
    at = problem(text)
    z = at.start()
    whole = at.evaluate(z, list(range(z.size)))
    for k in range(z.size):
        one = at.evaluate(z, [k])
        assert one.gradient[0] == pytest.approx(whole.gradient[k], rel=1e-9, abs=1e-9)
        assert one.information[0, 0] == pytest.approx(whole.information[k, k], rel=1e-9)


@each("text", MODELS)
def test_matrices_have_the_slopes_that_their_differences_have(text):
    at = problem(text)
    z, system = at.start(), assemble(at.model, RATE)
    found = slopes(at.model, system, at.coordinates, RATE)
    for k in range(z.size):
        step = 0.1 * DIFFERENCE_STEP * np.eye(z.size)[k]
        high, low = (assemble(at.at_point(z + s * step), RATE) for s in (1, -1))
        for name, got in (("F", found.F[k]), ("Q", found.Q[k]), ("H", found.H[k]), ("P0", found.P0[k])):
            expected = (getattr(high, name) - getattr(low, name)) / (0.2 * DIFFERENCE_STEP)
            size = np.max(np.abs(expected), initial=0.0)
            assert np.max(np.abs(got - expected), initial=0.0) <= 1e-4 * size + 1e-12, (k, name)


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        "GM(beta=10.0, sigma2=0.5) + WN(sigma2=1.0)",
        "AR(2, phi1=1.4, phi2=-0.6, sigma2=1.0) + WN(sigma2=1.0)",
        "GM(beta=10.0, sigma2=0.5) + WN(sigma2=1.0) + RW(gamma2=1e-2)",
    ],
)
def test_the_information_is_what_slopes_at_the_truth_scatter_by(text):
    draws = 300
    model = Model.parse(text)
    paths = model.simulate(400, RATE, np.random.default_rng(2), draws)
    gradients, informations = [], []
    for x in paths:
        at = LikelihoodProblem(model, as_record(x, RATE))
        found = at.evaluate(at.start(), list(range(at.start().size)))
        gradients.append(found.gradient)
        informations.append(found.information)
    g, information = np.array(gradients), np.mean(informations, axis=0)
    root = np.linalg.cholesky(np.linalg.inv(information))
    whitened = g @ root
    q = whitened.shape[1]
    # Means of n numbers of variance 1, and of products of them, which scatter by 1/√n, squares by √2/√n.
    assert np.all(np.abs(whitened.mean(axis=0)) < 4 / np.sqrt(draws)), whitened.mean(axis=0)
    outer = whitened.T @ whitened / draws
    assert np.all(np.abs(outer - np.eye(q)) < 4 * np.sqrt(1 + np.eye(q)) / np.sqrt(draws)), outer


@pytest.mark.slow
@pytest.mark.parametrize("mean", [None, 9.81])
@pytest.mark.parametrize("beta", [0.01, 0.5, 20.0])
def test_the_information_is_that_of_the_contrasts(beta, mean):
    """½ tr(P V_a P V_b), P = V⁻¹ − V⁻¹X (XᵀV⁻¹X)⁻¹ XᵀV⁻¹ where the level is unknown, P = V⁻¹ where it is known."""
    samples, draws = 80, 150
    model = Model.parse(f"GM(beta={beta}, sigma2=2.0) + WN(sigma2=0.5)")
    paths = 9.81 + model.simulate(samples, RATE, np.random.default_rng(3), draws)
    problems = [LikelihoodProblem(model, as_record(x, RATE), mean) for x in paths]
    z = problems[0].start()
    got = np.array([p.evaluate(z, [0, 1, 2]).information for p in problems])

    def whole(at):
        return sum(oracle.covariance(p, samples, RATE) for p in problems[0].at_point(at).processes)

    inverse = np.linalg.inv(whole(z))
    if mean is None:
        one = inverse.sum(axis=1)
        inverse = inverse - np.outer(one, one) / one.sum()
    turned = [inverse @ (whole(z + h) - whole(z - h)) / 2e-4 for h in 1e-4 * np.eye(3)]
    expected = np.array([[0.5 * np.trace(a @ b) for b in turned] for a in turned])
    error = got.std(axis=0, ddof=1) / np.sqrt(draws)
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.all(np.abs(got.mean(axis=0) - expected) <= 4 * error + 1e-6 * size), (got.mean(axis=0), expected)
    # It is the level that makes the difference: of a slow process next to nothing is left.
    if beta == 0.01 and mean is None:
        assert expected[1, 1] < 0.1


def test_the_information_is_that_of_the_spectrum_for_a_long_record():
    decay = 0.1
    at = problem(f"GM(beta={decay * RATE}, sigma2=2.0) + WN(sigma2=1.0)", samples=60_000, gaps=False)
    model = at.model
    z = at.start()
    found = at.evaluate(z, [0, 1, 2])
    # Coordinates are the logarithm of the scale σ² = s²(…) and of β: a constant turn of (log β, log s², log σ²).
    values = [model.parameters[n] for n in ("GM.beta", "GM.sigma2", "WN.sigma2")]
    turn = np.empty((3, 3))
    for k in range(3):
        high, low = (at.at_point(z + s * 1e-5 * np.eye(3)[k]).parameters for s in (1, -1))
        turn[:, k] = [np.log(high[n] / low[n]) / 2e-5 for n in ("GM.beta", "GM.sigma2", "WN.sigma2")]
    covariance = turn @ np.linalg.inv(found.information) @ turn.T
    expected = fisher_errors(decay, *values[1:], 60_000)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), expected, rtol=0.03)
