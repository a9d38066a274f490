"""The covariance under processes with short memory against sums over all lags and against the definition."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from gmwm import AR, AR1, ARMA, DR, GM, MA, MAT, OSC, PL, RW, SARMA, WN
from gmwm.measuring.covariance import Design, covariance, filtered, gaussian, variances, wavelet_covariance
from gmwm.measuring.covariance.robust import hermite_weights
from gmwm.theory.processes import Process
from gmwm.theory.processes.matern import LONGEST_LAGS
from gmwm.theory.processes.model import as_model
from gmwm.theory.processes.parameter import Parameter, Value
from tests.covariance.test_sums import double_sum
from tests.helpers import each
from tests.oracles import covariance as oracle

RATE = 10.0
PROCESSES = {
    "resonance": AR(phi=[1.4, -0.6], sigma2=1.0),
    "narrow resonance": AR(phi=[2 * 0.97 * np.cos(0.4), -(0.97**2)], sigma2=1.0),
    "two real roots": AR(phi=[1.3, -0.4], sigma2=1.0),
    "slow real root": AR(phi=[1.498, -0.499], sigma2=1.0),
    "slow negative root": AR(phi=[-0.49, 0.495], sigma2=1.0),
    "double root": AR(phi=[1.8, -0.81], sigma2=1.0),
    "moving average": MA(theta=[0.5, 0.3, -0.2], sigma2=2.0),
    "nearly a difference": MA(theta=[-0.999], sigma2=1.0),
    "low-pass": ARMA(phi=[1.2, -0.5], theta=[0.4], sigma2=1.0),
    "more averages than roots": ARMA(phi=[0.7], theta=[0.4, 0.2], sigma2=1.0),
    "slow and averaged": ARMA(phi=[0.95], theta=[0.4, 0.2], sigma2=1.0),
    "season": SARMA(phi=[0.5], sphi=[0.6], period=12, sigma2=1.0),
    "smooth": MAT(beta=2.0, nu=1.5, sigma2=1.0),
    "rough": MAT(beta=2.0, nu=0.3, sigma2=1.0),
    "oscillator": OSC(frequency=0.7, quality=5.0, sigma2=1.0),
}
BESIDE = {
    "alone": (None, None, 0.0),
    "walk and drift": (RW(1e-4) + DR(1e-3), ("walk", 1e-4, 0.0), 1e-3),
    "Gauss-Markov": (GM(0.3, 1.0), ("markov", 1.0, 0.03), 0.0),
    "slow Gauss-Markov": (GM(0.01, 10.0), ("markov", 10.0, 0.001), 0.0),
    "alternating": (AR1(-0.9, 1 - 0.81), ("alternating", 1.0, -np.log(0.9)), 0.0),
}


def design(samples, **options):
    return Design(np.arange(1, samples.bit_length()), samples, RATE, **options)


@pytest.mark.slow
@each("beside", BESIDE)
@each("name", PROCESSES)
def test_against_the_double_sum(name, beside):
    samples, process, (others, theory, slope) = 1500, PROCESSES[name], BESIDE[beside]
    model = as_model(process if others is None else process + others)
    known = process.autocovariance(np.abs(np.arange(1 - samples, samples)), RATE)
    if theory is not None:
        known = known + oracle.autocovariances(*theory, samples)
    at = design(samples)
    assert gaussian.knows(model, at)
    expected = double_sum(known, at.levels.size, samples, slope, [2.0])
    np.testing.assert_allclose(covariance(model, at), expected, rtol=1e-9)
    np.testing.assert_allclose(variances(model, at), np.diag(expected), rtol=1e-9)
    robust = double_sum(known, at.levels.size, samples, slope, hermite_weights(0.6))
    np.testing.assert_allclose(covariance(model, replace(at, efficiency=0.6)), robust, rtol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("phi", "theta"), [([1.4, -0.6], []), ([], [0.5, 0.3]), ([1.2, -0.5], [0.4]), ([0.9], [0.3, 0.2, 0.4])]
)
def test_against_the_definition(phi, theta):
    given = {key: value for key, value in (("phi", phi), ("theta", theta)) if value}
    kind = {"phi": AR, "theta": MA, "phitheta": ARMA}["".join(given)]
    running = oracle.running(oracle.recursion(phi, theta, 100))
    expected = oracle.wavelet_covariance([running], 6, 90)
    np.testing.assert_allclose(wavelet_covariance(kind(**given, sigma2=1.0), 90, RATE), expected, rtol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["resonance", "slow real root", "moving average", "season"])
def test_against_the_sum_over_all_lags_of_a_long_recording(name):
    model = as_model(PROCESSES[name] + GM(0.02, 3.0) + RW(1e-6))
    at = design(2**16)
    slow = filtered.covariance(model, at)
    size = np.sqrt(np.outer(np.diag(slow), np.diag(slow)))
    # That one takes lags apart, to 2e-5 of the diagonal.
    np.testing.assert_array_less(np.abs(covariance(model, at) - slow) / size, 2e-5)


@pytest.mark.parametrize("name", ["resonance", "slow negative root", "moving average", "smooth"])
def test_strides_against_the_definition(name):
    # Var of the mean square of every s-th coefficient, 2/n² Σ Cov(W_t, W_t')², and its covariance with coarser levels.
    samples, model = 256, as_model(PROCESSES[name] + GM(0.3, 1.0) + WN(0.5))
    at = design(samples, strides=(1, 1, 2, 4, 8, 16, 16, 16))
    known = sum(
        p.autocovariance(np.abs(np.subtract.outer(range(samples), range(samples))), RATE) for p in model.processes
    )
    rows = []
    for level, stride in zip(at.levels, at.strides, strict=True):
        taps = oracle.haar(int(level))
        places = range(samples - taps.size + 1)
        every = np.zeros((len(places), samples))
        for row, place in zip(every, places, strict=True):
            row[place : place + taps.size] = taps[::-1]
        rows.append((every, stride))
    found = covariance(model, at)
    for j, (every, stride) in enumerate(rows):
        # The strided coefficients of all offsets: V_jj is the mean over the offsets, weighted by what each holds.
        c = every @ known @ every.T
        n = len(every)
        used = [np.arange(offset, n, stride) for offset in range(min(stride, n))]
        own = [2 * np.sum(c[np.ix_(u, u)] ** 2) / u.size**2 for u in used]
        assert min(own) * (1 - 1e-9) <= found[j, j] <= max(own) * (1 + 1e-9)
        assert stride > 1 or found[j, j] == pytest.approx(own[0], rel=1e-9)


def test_segments_and_the_ratio_of_two_estimates():
    model = as_model(PROCESSES["resonance"] + GM(0.3, 1.0) + RW(1e-5))
    at = design(6000, segments=(1000, 5000))
    slow = sum(
        np.pad(
            filtered.covariance(model, part) * np.outer(part.counts, part.counts),
            (0, at.levels.size - part.levels.size),
        )
        for part in (at.segment(1000, at.counts), at.segment(5000, at.counts))
    ) / np.outer(at.counts, at.counts)
    np.testing.assert_allclose(covariance(model, at), slow, rtol=1e-6)
    one = design(3000, efficiency=0.6)
    np.testing.assert_allclose(gaussian.ratio_variances(model, one), filtered.ratio_variances(model, one), rtol=1e-6)


def test_flicker_noise_beside():
    model = as_model(PROCESSES["resonance"] + PL(alpha=1.0, nu2=1.0))
    at = design(2000)
    np.testing.assert_allclose(covariance(model, at), filtered.covariance(model, at), rtol=1e-6)


def test_roots_at_the_unit_circle():
    # The rest without the slow root keeps its digits, however slow that is.
    white = AR(phi=[0.5], sigma2=1.0)
    for slowness in (1e-3, 1e-6, 1e-9):
        both = AR(phi=[1.5 - slowness, -0.5 * (1 - slowness)], sigma2=1.0)
        assert both.memory(RATE) == pytest.approx(white.memory(RATE), abs=2)
        assert both.decays(RATE) == pytest.approx([-np.log1p(-slowness)], rel=1e-6)
        found = wavelet_covariance(both, 2**14, RATE)
        expected = filtered.covariance(as_model(both), design(2**14))
        np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_a_resonance_that_lasts_too_long_for_a_table():
    lasting = AR(phi=[2 * 0.999 * np.cos(0.3), -(0.999**2)], sigma2=1.0)
    assert lasting.memory(RATE) is None
    at = design(500)
    assert gaussian.knows(as_model(lasting), at)
    expected = filtered.covariance(as_model(lasting), at)
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        covariance(as_model(lasting), at) / np.outer(size, size), expected / np.outer(size, size), atol=1e-9
    )
    assert MAT(beta=1e-3, nu=1.0, sigma2=1.0).memory(RATE) is None
    assert OSC(frequency=0.7, quality=1e3, sigma2=1.0).memory(RATE) is None
    assert MA(theta=[0.1] * 9, sigma2=1.0).memory(RATE) == 9 <= LONGEST_LAGS


@dataclass(frozen=True, repr=False)
class Triangle(Process, register=False):
    """The mean of eight samples of white noise, by its autocovariance and where that ends."""

    name, title = "Triangle", "Mean of eight samples"
    parameters = (Parameter("sigma2", "σ²", "variance", signal_power=2, scale_power=1),)
    sigma2: Value = None

    def autocovariance(self, lags, rate):
        return self.scale * np.maximum(8.0 - np.abs(np.asarray(lags)), 0.0) / 64

    def memory(self, rate):
        return 7


def test_a_process_of_ones_own():
    assert Triangle.has("coefficient_covariance")
    # An average of eight is a moving average of order 7 with weights 1/8.
    own = wavelet_covariance(Triangle(sigma2=2.0) + RW(1e-3), 1000, RATE)
    known = Triangle(sigma2=2.0).autocovariance(np.arange(-999, 1000), RATE)
    expected = double_sum(known + oracle.autocovariances("walk", 1e-3, 0, 1000), 9, 1000, 0.0, [2.0])
    np.testing.assert_allclose(own, expected, rtol=1e-9)
