"""The damped oscillator: its two ends, and the search that finds it in recordings of other simulators."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lfilter

import gmwm
from gmwm.choosing.selection import search
from gmwm.choosing.selection.ranking import RankingOptions
from gmwm.measuring.covariance import Design, covariance
from gmwm.theory.processes import GM, OSC, SIN
from gmwm.theory.processes.exponential_sum import lag_sums
from gmwm.theory.processes.oscillator import PERIODIC_QUALITY
from gmwm.theory.statespace import haar_variances
from tests.helpers import codes, each

RATE = 100.0


def path(n: int, frequency: float, quality: float, rms: float, rng: np.random.Generator) -> np.ndarray:
    """Solve x″ + (ω/Q) x′ + ω² x = w exactly at the sampling times, without the package."""
    omega = 2 * math.pi * frequency
    step = expm(np.array([[0, 1], [-(omega**2), -omega / quality]]) / RATE)
    scatter = np.diag([rms**2, (omega * rms) ** 2])
    values, vectors = np.linalg.eigh(scatter - step @ scatter @ step.T)
    draws = rng.standard_normal((n, 2)) @ (vectors * np.sqrt(np.maximum(values, 0))).T
    inputs = draws[:, 0].copy()
    inputs[1:] += step[0, 1] * draws[:-1, 1] - step[1, 1] * draws[:-1, 0]
    return np.asarray(lfilter([1.0], [1.0, -np.trace(step), np.linalg.det(step)], inputs))


def test_the_variance_of_a_path_of_another_simulator_is_that_of_the_process():
    process = OSC(frequency=3.0, quality=6.0, sigma2=4.0)
    rng = np.random.default_rng(3)
    curves = np.array([
        gmwm.wavelet_variance(path(20_000, 3.0, 6.0, 2.0, rng)[1000:], RATE, levels=9).variance for _ in range(40)
    ])  # fmt: skip
    error = curves.std(axis=0, ddof=1) / math.sqrt(len(curves))
    assert np.all(np.abs(curves.mean(axis=0) - process.wavelet_variance(9, RATE)) < 4 * error)


def test_a_sharp_oscillator_is_nearly_a_sinusoid_and_a_critical_one_smooth_noise():
    sharp, line = OSC(frequency=1.0, quality=1e8, sigma2=2.0), SIN(frequency=1.0, power=2.0)
    # The sinusoid has zeros, at which the relative difference means nothing.
    np.testing.assert_allclose(sharp.wavelet_variance(6, RATE), line.wavelet_variance(6, RATE), rtol=1e-5)
    critical, k = OSC(frequency=1.0, quality=0.5 + 1e-13, sigma2=2.0), np.arange(200)
    t = 2 * math.pi * k / RATE
    np.testing.assert_allclose(critical.autocovariance(k, RATE), 2.0 * (1 + t) * np.exp(-t), rtol=1e-6)


def test_the_covariance_holds_near_the_critical_quality():
    levels = np.arange(1, 9)
    near, at = (OSC(frequency=2.0, quality=0.5 + gap, sigma2=1.0).exponential_sum(RATE) for gap in (1e-6, 1e-13))
    one, other = (lag_sums(levels, 4096, total, diagonal=True)[1] for total in (near, at))
    np.testing.assert_allclose(one, other, rtol=1e-5)


@pytest.mark.parametrize("quality", [0.6, 5.0, 1e4])
@pytest.mark.parametrize("frequency", [0.3, 49.0, 97.0, 260.0])
def test_the_exponentials_are_the_autocovariance_also_above_half_the_rate(frequency, quality):
    process, k = OSC(frequency=frequency, quality=quality, sigma2=3.0), np.arange(60)
    total = process.exponential_sum(RATE)
    assert np.all((total.decays.imag >= 0) & (total.decays.imag <= math.pi))
    sums = (total.amplitudes * np.exp(-np.outer(k, total.decays))).sum(axis=1).real
    np.testing.assert_allclose(sums, process.autocovariance(k, RATE), rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize(("quality", "frequency"), [(PERIODIC_QUALITY * 0.99, None), (PERIODIC_QUALITY * 1.01, 0.2)])
def test_from_a_quality_of_two_on_it_is_an_oscillation(quality, frequency):
    assert OSC(frequency=0.2, quality=quality, sigma2=1.0).oscillation() == frequency


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
def test_n_and_k_leave_out_an_oscillation_slower_than_the_horizon():
    noise = "WN(sigma2=1e-6) + RW(gamma2=1e-14)"
    for frequency, added in ((0.2, 0.0), (20.0, 2e-6 / (20.0 * 2 * math.pi * 20.0))):
        model = f"{noise} + OSC(frequency=fixed({frequency}), quality=fixed(20.0), sigma2=1e-6)"
        signal = gmwm.Signal(gmwm.Model.parse(model).simulate(2**17, RATE, rng=1), RATE, "rad/s")
        n = gmwm.datasheets.effective_noise(gmwm.fit(model, gmwm.wavelet_variance(signal)))["N"].value
        assert n**2 == pytest.approx(1e-6 / RATE + added, rel=0.04)


@each("quality", [0.5001, 0.7, 20.0, 1e6])
@each("frequency", [1e-7, 0.3, 49.0, 101.0, 260.0])
def test_the_wavelet_variance_is_exact_at_every_frequency_and_quality(frequency, quality):
    exact = []
    with mpmath.workdps(60):
        natural, ratio = 2 * mpmath.pi * mpmath.mpf(frequency) / 100, 1 / (2 * mpmath.mpf(quality))
        damping, turn = natural * ratio, natural * mpmath.sqrt(1 - ratio**2)
        decay = mpmath.mpc(damping, turn)

        def sums(m: int) -> mpmath.mpc:
            """Generalised covariance K(m) of the running sum; see `exponential_sum`."""
            return -m * mpmath.coth(decay / 2) / 2 - mpmath.exp(-decay * m) / (4 * mpmath.sinh(decay / 2) ** 2)

        for half in (2**level for level in range(22)):
            both = mpmath.mpc(1, damping / turn) * (6 * sums(0) - 8 * sums(half) + 2 * sums(2 * half))
            exact.append(float(both.real / (2 * half) ** 2))
    curve = OSC(frequency=frequency, quality=quality, sigma2=1.0).wavelet_variance(22, RATE)
    np.testing.assert_allclose(curve, exact, rtol=2e-10)


@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
@pytest.mark.parametrize("quality", [1.0, 4.0, 40.0])
@pytest.mark.parametrize("frequency", [1 / 900, 0.02, 0.5])
def test_the_search_looks_for_an_oscillator_where_the_curve_has_room_for_one(frequency, quality):
    smooth = gmwm.Model.parse("WN(sigma2=1) + RW(gamma2=1e-9)")
    model = smooth + OSC(frequency=frequency, quality=quality, sigma2=0.05)
    design = Design(np.arange(1, 20), 2**19, RATE)
    rng = np.random.default_rng(5)
    curve = model.wavelet_variance(19, RATE)
    drawn = np.maximum(rng.multivariate_normal(curve, covariance(model, design)), 0.1 * curve)
    for curve, expected in (
        (drawn, True), (smooth.wavelet_variance(19, RATE) * (1 + 0.1 * (-1.0) ** np.arange(19)), False),
    ):  # fmt: skip
        wv = gmwm.WaveletVariance.from_values(curve, samples=2**19, rate=RATE)
        fit = gmwm.fit("4*GM + WN + RW", wv, certify=False)
        assert (search._oscillator_of_grid(wv, fit, (), fastest=0.8) is not None) is expected


@pytest.mark.slow
@pytest.mark.parametrize(
    ("samples", "frequency", "quality", "rms"), [(2**18, 0.17, 20.0, 2e-3), (2**20, 1 / 900, 5.0, 2e-4)]
)
def test_the_search_finds_an_oscillation_and_n_without_it(samples, frequency, quality, rms):
    rng = np.random.default_rng(7)
    values = path(samples, frequency, quality, rms, rng) + 5e-3 * rng.standard_normal(samples)
    calibration = gmwm.calibrate(gmwm.Signal(values, RATE, "rad/s", "gyro_x"))
    (axis,) = calibration.axes.values()
    (found,) = (process for process in axis.fit.model.processes if isinstance(process, OSC))
    assert found.value("frequency") == pytest.approx(frequency, rel=0.15)
    assert found.scale == pytest.approx(rms**2, rel=0.6)
    n = axis.datasheet["N"]
    assert n.low is not None
    assert n.low <= 5e-4 <= n.high
    assert "lines:oscillation" in codes(axis.remarks)


@pytest.mark.parametrize("seed", [2, 3])
def test_a_search_for_other_optima_does_not_lose_an_oscillation(seed):
    """With the weights of the oscillation, a line at another frequency fits better."""
    model = gmwm.Model.parse("WN(sigma2=1e-6) + DR(omega=1.2e-10)")
    model += OSC(frequency=0.0293, quality=13.4, sigma2=3.45e-9)
    design = Design(np.arange(1, 18), 303_102, 1000.0)
    curve = model.wavelet_variance(17, 1000.0)
    drawn = np.random.default_rng(seed).multivariate_normal(curve, covariance(model, design))
    wv = gmwm.WaveletVariance.from_values(np.maximum(drawn, 0.1 * curve), samples=303_102, rate=1000.0)
    choice = search.search(wv, None, RankingOptions())
    (found,) = (process for process in choice.ranking.recommended.fit.model.processes if isinstance(process, OSC))
    assert found.value("frequency") == pytest.approx(0.0293, rel=0.05)
    assert choice.error == 0.0


def test_gauss_markov_noise_is_no_oscillation():
    assert GM(beta=1.0, sigma2=1.0).oscillation() is None


@each("frequency", [1e-3, 0.17, 2.0, 30.0])
@each("quality", [0.5001, 0.52, 2.0, 60.0, 3000.0])
def test_the_closed_form_of_the_wavelet_variance_agrees_with_the_state_space(frequency, quality):
    levels = np.arange(1, 21)
    expected = haar_variances([OSC(frequency=frequency, quality=quality, sigma2=1.0).state_space(100.0)], levels)
    for rows in (1, 2):
        shape = OSC.shape(np.tile([[frequency, quality]], (rows, 1)), levels, 100.0)
        assert np.allclose(shape / expected, 1.0, atol=1e-9)
