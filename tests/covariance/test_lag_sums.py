"""Sums over lags in closed form against sums lag by lag, and geometric sums, in many digits."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from gmwm import AR, ARMA, GM, MA, MAT, PL, QN, RW, SARMA, WN
from gmwm.base import _core
from gmwm.measuring.covariance import Design, covariance, variances
from gmwm.theory.processes import self_similar
from gmwm.theory.processes.exponential_sum import ExponentialSum, lag_sums, lag_table
from gmwm.theory.processes.model import as_model
from tests.helpers import each
from tests.oracles import lag_sums as oracle

RATE = 10.0


def damped(lost, angle):
    """The decay of a pole with the modulus 1 − `lost`."""
    return complex(-np.log1p(-lost), angle)


CASES = {
    "white": {"white": 1.0},
    "walk": {"walk": 1.0},
    "spikes": {"spikes": [1.0, -0.5, 0.3, 0.2, 0.1], "white": 2.0},
    "fast": {"amplitudes": [1.0], "decays": [1.3]},
    "both sides of a series": {"amplitudes": [1.0, 1.0], "decays": [0.124, 0.0626]},
    "slow": {"amplitudes": [1.0], "decays": [1e-3]},
    "nearly a walk": {"amplitudes": [1.0], "decays": [1e-9]},
    "alternating": {"amplitudes": [1.0], "decays": [complex(0.05, np.pi)]},
    "nearly alternating": {"amplitudes": [1.0], "decays": [complex(1e-9, np.pi)]},
    "period of four": {"amplitudes": [1.0 + 0.3j], "decays": [damped(1e-6, np.pi / 2)]},
    "both sides of a period": {"amplitudes": [1.0, 0.5], "decays": [damped(0.0124, np.pi / 2), damped(0.012, np.pi)]},
    "resonance": {"amplitudes": [1 - 0.2j], "decays": [damped(1e-3, 1.2)]},
    "lasting resonance": {"amplitudes": [1 - 0.2j], "decays": [damped(1e-9, 1.2)]},
    "slow resonance": {"amplitudes": [1.0], "decays": [complex(1e-5, 1e-3)]},
    "slowest resonance": {"amplitudes": [1.0], "decays": [complex(1e-9, 1e-7)]},
    "all": {
        "amplitudes": [1.0, 1.0, 0.5 + 0.1j, 2.0, 0.3, 0.4 - 0.1j],
        "decays": [0.3, 0.02, damped(1e-3, 0.7), damped(1e-6, 0.3), complex(0.2, np.pi), complex(1e-4, 0.003)],
        "white": 0.1, "walk": 1e-4, "spikes": [0.3, 0.2, -0.1],
    },
    "poles close together": {"amplitudes": [1.0, -0.9], "decays": [0.3, 0.301], "white": 0.1},
}  # fmt: skip
LARGE = {
    "nearly alternating": {"amplitudes": [1.0], "decays": [complex(1e-6, np.pi)]},
    "period of four": {"amplitudes": [1.0], "decays": [damped(1e-6, np.pi / 2)]},
    "lasting resonance": {"amplitudes": [1 - 0.2j], "decays": [damped(1e-9, 1.2)]},
    "nearly a walk": {"amplitudes": [1.0], "decays": [1e-9]},
    "slow": {"amplitudes": [1.0], "decays": [1e-5]},
    "slow resonance": {"amplitudes": [1.0], "decays": [complex(1e-7, 1e-4)]},
    "resonance beside Gauss-Markov": {
        "amplitudes": [1 - 0.2j, 1.0, 1.0], "decays": [damped(1e-6, 0.3), 0.02, 1e-4], "white": 1.0, "walk": 1e-9
    },
}  # fmt: skip


def exponentials(white=0.0, walk=0.0, spikes=(), amplitudes=(), decays=()):
    """The sum for which the oracle has `Terms` of the same arguments."""
    return ExponentialSum(
        white=white,
        walk=walk,
        spikes=np.array(spikes, dtype=np.float64),
        amplitudes=np.array(amplitudes, dtype=np.complex128),
        decays=np.array(decays, dtype=np.complex128),
        bare=np.zeros(len(decays), dtype=np.bool_),
    )


def error(found, expected, levels, other=None):
    """The largest difference of sums of products, in units of the diagonal."""
    coarser, finer = np.tril_indices(levels)
    expected = np.array(expected, dtype=np.float64)
    own = expected[coarser == finer] if other is None else other
    scale = np.sqrt(own)
    return np.max(np.abs(found - expected) / (scale[coarser] * scale[finer]))


@pytest.mark.slow
@each("name", CASES)
def test_against_sums_lag_by_lag(name):
    levels, samples = np.arange(1, 7), 77
    terms = oracle.Terms(**CASES[name])
    first, second = oracle.lag_sums(levels.tolist(), samples, terms, terms)
    found = lag_sums(levels, samples, exponentials(**CASES[name]), diagonal=False)
    assert error(found[1], second, levels.size) < 1e-11
    size = np.sqrt(samples * np.array(second, dtype=np.float64))
    np.testing.assert_array_less(np.abs(found[0] - np.array(first, dtype=np.float64)), 1e-12 * size + 1e-13)
    diagonal = lag_sums(levels, samples, exponentials(**CASES[name]), diagonal=True)
    coarser, finer = np.tril_indices(levels.size)
    np.testing.assert_array_equal(diagonal[1], found[1][coarser == finer])


def with_table(levels, samples, one, other):
    """Σ n C D of two processes, from a table of the second one."""
    table = lag_table(levels, samples, other, diagonal=False)
    own = lag_sums(levels, samples, one, diagonal=False)
    first, second = lag_sums(levels, samples, one, [(table, 3.0)], diagonal=False)
    np.testing.assert_array_equal(first, own[0])
    return (second - own[1]) / 6


SMOOTH = {
    "white": {"white": 1.0},
    "walk": {"walk": 1.0, "white": 0.5},
    "fast": {"amplitudes": [1.0, 0.5], "decays": [1.3, 20.0]},
    "both sides of a series": {"amplitudes": [1.0, 1.0], "decays": [0.0626, 0.124]},
    "many": {"amplitudes": np.geomspace(1, 40, 30)[::-1].tolist(), "decays": np.geomspace(1e-7, 4.0, 30).tolist()},
    "as the other": {"amplitudes": [1.0, 1.0, 0.3], "decays": [0.02, 0.3, 0.301], "white": 0.1},
}  # fmt: skip


@pytest.mark.slow
@each("other", SMOOTH)
@each("name", ["walk", "spikes", "period of four", "lasting resonance", "all"])
def test_products_with_a_table(name, other):
    levels, samples = np.array([1, 4, 6]), 130
    expected = oracle.lag_sums(levels.tolist(), samples, oracle.Terms(**CASES[name]), oracle.Terms(**SMOOTH[other]))[1]
    one, two = exponentials(**CASES[name]), exponentials(**SMOOTH[other])
    own = [lag_sums(levels, samples, each, diagonal=True)[1] for each in (one, two)]
    assert error(with_table(levels, samples, one, two), expected, levels.size, np.sqrt(own[0] * own[1])) < 1e-11


def test_levels_are_the_first_ones_of_a_table():
    one, other = exponentials(**CASES["all"]), exponentials(**SMOOTH["many"])
    table = lag_table(np.arange(1, 8), 200, other, diagonal=False)
    found = lag_sums(np.arange(1, 6), 200, one, [(table, 1.0)], diagonal=False)[1]
    assert np.array_equal(found, lag_sums(np.arange(1, 8), 200, one, [(table, 1.0)], diagonal=False)[1][: found.size])
    diagonal = lag_table(np.arange(1, 8), 200, other, diagonal=True)
    coarser, finer = np.tril_indices(5)
    each = lag_sums(np.arange(1, 6), 200, one, [(diagonal, 1.0)], diagonal=True)[1]
    np.testing.assert_array_equal(each, found[coarser == finer])
    for levels, samples, all_pairs in (
        (np.arange(2, 6), 200, True),
        (np.arange(1, 6), 201, True),
        (np.arange(1, 6), 200, False),
    ):
        with pytest.raises(ValueError, match="table"):
            lag_sums(levels, samples, one, [(table, 1.0)], diagonal=not all_pairs)
    for process in (CASES["resonance"], CASES["spikes"]):
        with pytest.raises(ValueError, match="real decays"):
            lag_table(np.arange(1, 6), 200, exponentials(**process), diagonal=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", LARGE)
def test_a_million_samples_against_geometric_sums(name):
    levels = np.array([1, 9, 19])
    expected = oracle.closed_sums(levels.tolist(), 10**6, oracle.Terms(**LARGE[name]))
    found = lag_sums(levels, 10**6, exponentials(**LARGE[name]), diagonal=False)[1]
    assert error(found, expected, levels.size) < 1e-10


@pytest.mark.slow
def test_the_two_oracles_agree():
    terms = oracle.Terms(white=0.1, walk=1e-3, amplitudes=[1.0, 0.5], decays=[0.02, 0.01 + 0.7j])
    one, two = oracle.lag_sums([1, 3, 5], 60, terms, terms)[1], oracle.closed_sums([1, 3, 5], 60, terms)
    assert max(abs(a / b - 1) for a, b in zip(one, two, strict=True)) < 1e-40


def poles_of(phi, theta, sigma2):
    """Amplitudes and decays of an ARMA process with p > q in many digits; the amplitude of a pair is doubled."""
    with mpmath.workdps(80):
        roots = mpmath.polyroots(
            [*(-mpmath.mpf(value) for value in phi[::-1]), 1], maxsteps=500, extraprec=400, asc=True
        )
        amplitudes, decays = [], []
        for k, z in enumerate(roots):
            if mpmath.im(z) < -(mpmath.mpf(10) ** -60):
                continue
            theta_at = sum(mpmath.mpf(t) * z ** (i + 1) for i, t in enumerate(theta)) + 1
            theta_over = sum(mpmath.mpf(t) * z ** -(i + 1) for i, t in enumerate(theta)) + 1
            below = mpmath.mpf(1)
            for i, other in enumerate(roots):
                below *= (1 - other * z) * (1 if i == k else 1 - other / z)
            double = mpmath.im(z) > mpmath.mpf(10) ** -60
            amplitudes.append(mpmath.conj(theta_at * theta_over / below) * sigma2 * (2 if double else 1))
            decays.append(-mpmath.log(mpmath.conj(z)))
        return amplitudes, decays


@pytest.mark.slow
@pytest.mark.parametrize("lost", [1e-9, 1e-3])
def test_arma_near_the_unit_circle(lost):
    z = [(1 - lost) * np.exp(0.3j), 0.999 * np.exp(0.9j), 0.99 * np.exp(1.7j), 0.9 * np.exp(2.5j)]
    phi = -np.poly([*z, *np.conj(z), 0.5]).real[1:]
    theta = np.poly([0.9 * np.exp(0.4j), 0.9 * np.exp(-0.4j), 0.5, -0.5, 0.3]).real[1:]
    process = ARMA(phi=phi.tolist(), theta=theta.tolist(), sigma2=2.0)
    amplitudes, decays = poles_of(phi, theta, 2.0)
    levels = np.array([1, 19])
    expected = oracle.closed_sums(levels.tolist(), 10**6, oracle.Terms(amplitudes=amplitudes, decays=decays))
    found = lag_sums(levels, 10**6, process.exponential_sum(RATE), diagonal=False)[1]
    assert error(found, expected, levels.size) < 1e-9


@pytest.mark.slow
def test_an_autoregression_that_nearly_alternates():
    phi = -np.poly([-0.75, -1 + 1e-8]).real[1:]
    amplitudes, decays = poles_of(phi, [], 1.0)
    expected = oracle.closed_sums([1, 2, 4], 100, oracle.Terms(amplitudes=amplitudes, decays=decays))
    terms = AR(phi=phi.tolist(), sigma2=1.0).exponential_sum(RATE)
    assert error(lag_sums(np.array([1, 2, 4]), 100, terms, diagonal=False)[1], expected, 3) < 1e-11


def running_sum(terms, m):
    """K(m) of a sum of exponentials."""
    total = -0.5 * terms.white * m + terms.walk * (m**3 - m) / 12
    for a, decay, bare in zip(terms.amplitudes, terms.decays, terms.bare, strict=True):
        line = 0.0 if bare else -0.5 * m / np.tanh(decay / 2)
        total = total + (a * (line - np.exp(-decay * m) / (4 * np.sinh(decay / 2) ** 2))).real
    total[: terms.spikes.size] += terms.spikes[: total.size]
    return total


PROCESSES = [
    AR(phi=[1.2, -0.5], sigma2=2.0),
    AR(phi=[0.25], sigma2=1.0),
    MA(theta=[0.5, 0.2], sigma2=1.0),
    ARMA(phi=[1.9, -0.9985], theta=[0.5, 0.3, 0.2], sigma2=1.0),
    ARMA(phi=[0.5, 0.3, -0.2, 0.1], theta=[0.4], sigma2=1.0),
    ARMA(phi=[0.7], theta=[0.1] * 12, sigma2=1.0),
    SARMA(phi=[0.5], sphi=[0.6], period=12, sigma2=1.0),
    SARMA(theta=[0.5], stheta=[0.6], sphi=[0.7], period=4, sigma2=1.0),
    GM(3.0, 1.0), GM(1e-6, 1.0), WN(2.0), RW(0.3), QN(0.7), MAT(beta=2.0, nu=1.5, sigma2=1.0),
]  # fmt: skip


@pytest.mark.parametrize("process", PROCESSES, ids=str)
def test_the_sum_of_a_process_is_its_running_sum(process):
    m = np.arange(200)
    expected, found = process.running_sum_covariance(m, RATE), running_sum(process.exponential_sum(RATE), m * 1.0)
    scale = np.abs(expected).max()
    # A slow process has terms that cancel here, but not in the kernel.
    tolerance = 1e-4 if process == GM(1e-6, 1.0) else 1e-12
    np.testing.assert_allclose((found - found[100]) / scale, (expected - expected[100]) / scale, atol=tolerance)


@each("stride", [2, 5, 16])
@each("name", CASES)
def test_strides_take_every_lag_of_a_multiple(name, stride):
    terms = exponentials(**CASES[name])
    if np.any(np.abs(terms.decays) < 1e-4):
        terms = exponentials(amplitudes=[1.0], decays=[1e-2])
    m = np.arange(40.0)
    expected = running_sum(terms, np.arange(40 * stride) * 1.0)[::stride]
    found = running_sum(terms.strided(stride), m)
    scale = np.abs(expected).max() + 1.0 / max(np.abs(terms.decays).min(initial=1.0), 1e-2) ** 2
    np.testing.assert_allclose((found - found[20]) / scale, (expected - expected[20]) / scale, atol=1e-12)


class PowerLaw:
    """The exact running sum of power-law noise, for the oracle."""

    def __init__(self, epsilon):
        self.epsilon = epsilon

    def running_sum(self, last):
        e = mpmath.mpf(self.epsilon)
        factor = 1 / mpmath.log(2) if e == 0 else e / (2**e - 1)
        power = (lambda m: mpmath.log(m)) if e == 0 else (lambda m: (m**e - 1) / e)
        return [mpmath.mpf(0)] + [factor * m**2 * power(mpmath.mpf(m)) / 2 for m in range(1, last + 1)]


@pytest.mark.slow
@pytest.mark.parametrize("epsilon", [-1.9, -1.0, -0.5, 0.0, 0.5, 1.0, self_similar.STEEPEST])
def test_power_laws_are_mixtures(epsilon):
    levels, samples, law = np.arange(1, 7), 70, PowerLaw(epsilon)
    other = {"amplitudes": [1.0, 0.2], "decays": [0.01 + 0.7j, 0.02], "white": 0.1, "walk": 1e-3}
    mixture = self_similar.mixture(epsilon, samples)
    own = oracle.lag_sums(levels.tolist(), samples, law, law)[1]
    assert error(lag_sums(levels, samples, mixture, diagonal=False)[1], own, levels.size) < 1e-10
    expected = oracle.lag_sums(levels.tolist(), samples, law, oracle.Terms(**other))[1]
    coarser, finer = np.tril_indices(levels.size)
    scale = np.sqrt(
        np.array(own, dtype=np.float64)[coarser == finer]
        * lag_sums(levels, samples, exponentials(**other), diagonal=True)[1]
    )
    found = with_table(levels, samples, exponentials(**other), mixture)
    assert error(found, expected, levels.size, scale) < 1e-10


@pytest.mark.parametrize("law", [PL(alpha=1.0, nu2=0.4), PL(alpha=0.5, nu2=0.3)])
def test_a_power_law_beside_a_resonance(law):
    # Without the resonance, a Gauss rule gives the sums of a free shape; the resonance is nearly nothing.
    design, others = Design(np.arange(1, 15), 40_000, RATE), WN(1.0) + GM(0.3, 1.0) + RW(1e-6)
    rule = covariance(as_model(others + law), design)
    found = covariance(as_model(others + law + AR(phi=[1.2, -0.9], sigma2=1e-18)), design)
    scale = np.sqrt(np.outer(np.diag(rule), np.diag(rule)))
    np.testing.assert_allclose(found / scale, rule / scale, atol=1e-7)


def test_roots_that_nearly_coincide_are_tabulated():
    process = AR(phi=[1.8, -0.81], sigma2=1.0)
    assert process.exponential_sum(RATE) is None
    near = AR(phi=[1.8 + 1e-5, -0.81 - 0.9e-5], sigma2=1.0)
    assert near.exponential_sum(RATE) is not None
    design = Design(np.arange(1, 11), 1500, RATE)
    np.testing.assert_allclose(variances(as_model(near), design), variances(as_model(process), design), rtol=1e-3)


@pytest.mark.parametrize(
    ("levels", "rows", "text"),
    [
        ([0, 1], [[1.0], [0.0], [1.0], [0.0]], "levels"),
        ([1, 9], [[1.0], [0.0], [1.0], [0.0]], "levels"),
        ([1, 2], [[1.0], [0.0], [-1.0], [0.0]], "decays"),
        ([1, 2], [[1.0], [0.0], [1.0], [4.0]], "decays"),
        ([1, 2], [[1.0], [0.0], [1.0]], "exponentials"),
    ],
)
def test_the_kernel_refuses(levels, rows, text):
    process = (0.0, 0.0, np.empty(0), np.array(rows), np.zeros(1, np.uint8))
    with pytest.raises(ValueError, match=text):
        _core.lag_sums(np.array(levels, np.int64), 100, False, process, [])
