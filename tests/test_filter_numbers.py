"""N and K of the filter that predicts best, from the spectrum alone."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import lfilter

import gmwm
from gmwm import AR1, DR, FN, GM, MAT, PL, QN, RW, SIN, WN, Model
from gmwm.choosing.datasheets.filter_numbers import CurveRatio, FilterGain, FilterPrediction, best_gain, filter_numbers
from gmwm.theory.processes import registry
from tests.helpers import each

RATE = 100.0
NOISES = {
    name: kind(**{p.name: {"phi": 0.95, "beta": 3.0, "alpha": 1.4, "hurst": 0.8, "nu": 0.4}.get(p.name, 2.0)
                  for p in kind.parameters})
    for name, kind in registry.items() if name not in ("SIN", "DR")
}  # fmt: skip


def numbers(model: Model | str, horizon: float = 1.0, rate: float = RATE) -> tuple[float, float]:
    found = filter_numbers(
        gmwm.Model.parse(model).processes if isinstance(model, str) else model.processes, rate, horizon
    )
    return found.N, found.K


def by_lags(process, gain: FilterGain, samples: int) -> float:
    """The error as a sum over lags of the generalised covariance, with the weights of future and past samples."""
    g, keep = gain.g, gain.keep
    past = g * keep ** np.arange(round(40 / g))
    weights = np.concatenate([np.full(samples, 1 / samples), -past])  # from the last future sample backwards
    size = weights.size
    spectrum = np.abs(np.fft.rfft(weights, 2 * size)) ** 2
    together = np.fft.irfft(spectrum)[:size]
    together[0] -= weights.sum() ** 2
    semivariance = process.generalised_covariance([0], RATE) - process.generalised_covariance(np.arange(size), RATE)
    return float(-2 * together[1:] @ semivariance[1:])


@each("name", NOISES)
@each(("bandwidth", "samples"), [(0.01, 1), (0.01, 100), (0.3, 20), (5.0, 700)])
def test_the_error_is_the_sum_over_lags_of_every_process(name, bandwidth, samples):
    process, gain = NOISES[name], FilterGain(bandwidth)
    tolerance = 0.01 if name == "MAT" else 1e-7  # the density of MAT comes from its approximate state space
    assert FilterPrediction.of([process], RATE, samples).error(gain)[0] == pytest.approx(
        by_lags(process, gain, samples), rel=tolerance
    )


@pytest.mark.parametrize("time", [1e-3, 0.3, 40.0, 1e5])
@pytest.mark.parametrize("samples", [1, 100, 60_000])
def test_the_error_of_a_markov_process_in_closed_form(time, samples):
    mpmath = pytest.importorskip("mpmath")
    mpmath.mp.dps = 40
    phi = mpmath.exp(-1 / mpmath.mpf(time * RATE))
    for bandwidth in (1e-6, 1e-3, 0.5):
        q = mpmath.mpf(bandwidth)
        g = q * (mpmath.sqrt(q**2 + 4) - q) / 2
        keep = 1 - g
        mean = (samples * (1 + phi) / (1 - phi) - 2 * phi * (1 - phi**samples) / (1 - phi) ** 2) / samples**2
        estimate = g / (2 - g) * (1 + keep * phi) / (1 - keep * phi)
        both = g / (1 - keep * phi) * phi * (1 - phi**samples) / (1 - phi) / samples
        error = FilterPrediction.of([GM(beta=1 / time, sigma2=1.0)], RATE, samples).error(FilterGain(bandwidth))[0]
        assert error == pytest.approx(float(mean + estimate - 2 * both), rel=1e-9)


def test_the_derivative_is_the_derivative():
    model = WN(sigma2=1.0) + FN(b2=0.01) + GM(beta=0.1, sigma2=0.05) + DR(omega=1e-5)
    prediction = FilterPrediction.of(model.processes, RATE, 300)
    for bandwidth in (1e-7, 1e-3, 0.1, 30.0):
        step = 1e-4
        low, high = (prediction.error(FilterGain(bandwidth * math.exp(s * step)))[0] for s in (-1, 1))
        error, slope = prediction.error(FilterGain(bandwidth))
        assert slope == pytest.approx((high - low) / (2 * step), rel=1e-6, abs=1e-9 * error)


@each("name", ["WN", "GM", "FN", "RW", "QN"])
def test_the_derivative_is_zero_at_the_best_gain(name):
    # The gain comes from an interpolation of the derivative between two points of a grid.
    model = WN(sigma2=1.0) + RW(gamma2=1e-7) + FN(b2=1e-3)
    prediction = FilterPrediction.of([*model.processes, NOISES[name]], RATE, 100)
    gain = best_gain(prediction)
    error, slope = prediction.error(gain)
    curvature = prediction.error(FilterGain(gain.bandwidth * math.exp(0.01)))[1] / 0.01
    assert error > 0
    assert abs(slope) < 1e-12 * curvature


@each("rate", [0.001, 1.0, 100.0, 10_000.0])
@each("horizon", [1e-3, 1.0, 60.0])
@each("bandwidth", [1e-7, 1e-3, 1.0])
def test_white_noise_and_a_walk_return_their_coefficients(rate, horizon, bandwidth):
    # Bandwidth is w Δt: for every rate and horizon, the two numbers are those of the terms.
    white, walk = 1e-4, 1e-4 * bandwidth * rate
    model = WN(sigma2=white**2 * rate) + RW(gamma2=walk**2 / rate)
    assert numbers(model, horizon, rate) == pytest.approx((white, walk), rel=1e-9)


def test_flicker_noise_has_a_closed_form_for_a_short_horizon():
    # J = N² w/2 − (B²/π) ln w + … is lowest at w = 2B²/(πN²).
    white, flicker = 1e-3, 1e-5
    model = WN(sigma2=white**2 * RATE) + FN(b2=flicker**2)
    found = filter_numbers(model.processes, RATE, 1.0)
    assert pytest.approx(2 * flicker**2 / (math.pi * white), rel=2e-3) == found.K
    assert pytest.approx(white, rel=1e-3) == found.N


@pytest.mark.parametrize(("white", "sigma", "time"), [(1.0, 5.0, 15.0), (1.0, 5.0, 300.0), (0.2, 3.0, 0.13)])
def test_the_integral_in_continuous_time(white, sigma, time):
    """The definition of the theory, with the densities in continuous time, at a rate that is far higher."""
    rate, horizon = 5_000.0, 10.0
    model = WN(sigma2=white**2 * rate) + GM(beta=1 / time, sigma2=sigma**2)
    found = filter_numbers(model.processes, rate, horizon)
    w = found.K / found.N
    decay, a = math.exp(-horizon / time), 1 / time
    # The mean square of the Gauss-Markov part: mean over T, estimate, and both.
    mean = 2 * sigma**2 * (time / horizon - (time / horizon) ** 2 * (1 - decay))
    markov = mean + sigma**2 * w / (w + a) - 2 * sigma**2 * w / (w + a) * (1 - decay) * time / horizon
    assert found.prediction.error(found.gain)[0] == pytest.approx(white**2 * (1 / horizon + w / 2) + markov, rel=1e-3)
    assert found.N**2 * (1 / horizon + w + w**2 * horizon / 3) == pytest.approx(
        white**2 * (1 / horizon + w / 2) + markov, rel=1e-3
    )


def test_no_walk_and_no_white_noise():
    assert numbers(WN(sigma2=1.0) + QN(q2=1.0))[1] == 0.0
    white, walk = numbers(Model((RW(gamma2=1.0),)))
    assert (white, walk) == (0.0, pytest.approx(10.0, rel=1e-6))
    # A Gauss-Markov term that white noise hides makes no filter better.
    assert numbers(WN(sigma2=1.0) + GM(beta=1e-3, sigma2=1e-9))[1] == 0.0


def test_a_ramp_is_followed():
    slope, white = 1e-6, 1.0
    model = WN(sigma2=white) + DR(omega=slope)
    found = filter_numbers(model.processes, RATE, 1.0)
    # J = r g/2 + ω² ((n + 1)/2 + 1/g)² for a small gain.
    at = np.geomspace(1e-6, 1e-2, 4001)
    error = white * at / 2 + slope**2 * (50.5 + 1 / at) ** 2
    assert found.gain.g == pytest.approx(at[np.argmin(error)], rel=5e-3)


@pytest.mark.parametrize("periods", [0.32, 11.0])
def test_sinusoids_far_from_the_horizon_are_left_out(periods):
    model = WN(sigma2=1.0) + RW(gamma2=1e-6)
    assert numbers(model + SIN(frequency=periods, power=3.0)) == numbers(model)


@pytest.mark.parametrize("frequency", [0.34, 0.56, 3.1, 9.1])
def test_sinusoids_near_the_horizon_are_part_of_the_error(frequency):
    rng, samples = np.random.default_rng(4), 400_000
    model, power = WN(sigma2=1.0) + RW(gamma2=1e-6), 0.3
    found = filter_numbers((model + SIN(frequency=frequency, power=power)).processes, RATE, 1.0)
    phase = 2 * np.pi * frequency * np.arange(samples) / RATE + 1.0
    x = rng.normal(size=samples) + np.cumsum(1e-3 * rng.normal(size=samples)) + np.sqrt(2 * power) * np.sin(phase)
    g = found.gain.g
    bias = lfilter([g], [1, g - 1], x)
    ahead = np.convolve(x, np.ones(100) / 100, "valid")  # the mean of 100 samples from each sample on
    error = ahead[20_001:] - bias[20_000 : 20_000 + ahead.size - 20_001]
    stated = found.N**2 * RATE * found.gain.claim(100)[0]
    assert np.mean(error**2) == pytest.approx(stated, rel=0.05)
    # The filter does not follow the line, however strong it is.
    for strength in (power, 10.0, 1e3):
        strong = filter_numbers((model + SIN(frequency=frequency, power=strength)).processes, RATE, 1.0)
        assert strong.gain.bandwidth < filter_numbers(model.processes, RATE, 1.0).gain.bandwidth


def test_resonances_are_integrated():
    # A pole pair of radius 0.9995 at 10 Hz, whose peak has a width of 16 mHz.
    radius, angle = 0.9995, 2 * math.pi * 0.1
    phi1, phi2 = 2 * radius * math.cos(angle), -(radius**2)
    process = gmwm.Model.parse(f"AR(2, phi1={phi1!r}, phi2={phi2!r}, sigma2=1)").processes[0]
    for samples in (100, 6000):
        prediction = FilterPrediction.of([process], RATE, samples)
        variance = float(process.autocovariance([0], RATE)[0])
        assert sum(mass.sum() for _, mass in prediction.parts) == pytest.approx(variance, rel=1e-6)


def test_noises_with_the_same_resonances_share_a_quadrature():
    first, second = (
        Model.parse(f"GM(beta={beta}, sigma2=1) + RW(gamma2={walk}) + OSC(frequency=3.0, quality=40.0, sigma2={size})")
        for beta, walk, size in ((0.5, 1e-6, 0.1), (2.0, 1e-9, 40.0))
    )
    for samples in (100, 6000):
        one, other = (FilterPrediction.of(model.processes, RATE, samples).parts[0][0] for model in (first, second))
        assert one is other


def test_a_measured_ratio_is_integrated_between_octave_centres():
    levels = np.arange(1.0, 13.0)
    logs = np.where(levels == 6, 1.0, np.where(levels == 9, -0.5, 0.0))
    ratio, gain = CurveRatio(levels, logs, np.zeros(12)), FilterGain(0.01)
    found = FilterPrediction.of([WN(sigma2=1.0)], RATE, 100, ratio).error(gain)[0]

    def integrand(log: float) -> float:
        theta = math.exp(log)
        z = complex(math.cos(theta), math.sin(theta))
        response = sum(z**m for m in range(1, 101)) / 100 - gain.g / (1 - gain.keep / z)
        return abs(response) ** 2 * float(ratio(np.array([theta]))[0]) * theta / math.pi

    ends = [-20.0, *sorted(math.log(math.sqrt(2) * math.pi / 2**level) for level in levels[1:]), math.log(math.pi)]
    value = sum(quad(integrand, low, high, limit=400)[0] for low, high in pairwise(ends))
    assert found == pytest.approx(value, rel=1e-8)


def test_the_smallest_of_several_minima():
    # White noise, a Gauss-Markov term of 1 s and a slow walk: the error has two minima.
    model = WN(sigma2=1e-4) + GM(beta=1.0, sigma2=1e-2) + RW(gamma2=1e-9)
    prediction = FilterPrediction.of(model.processes, RATE, 2000)
    gain = best_gain(prediction)
    tried = [prediction.error(FilterGain(q))[0] for q in np.geomspace(1e-8, 10, 2000)]
    assert prediction.error(gain)[0] <= min(tried)


def flicker(count: int, rng: np.random.Generator) -> np.ndarray:
    """Flicker noise by the impulse response of Kasdin, with the density B²/(2πf) of B² = 2π dt-free units."""
    k = np.arange(1, count)
    response = np.concatenate([[1.0], np.cumprod((k - 0.5) / k)])
    size = 2 * count
    return np.fft.irfft(np.fft.rfft(response, size) * np.fft.rfft(rng.standard_normal(count), size))[:count]


def test_a_simulated_filter_makes_the_stated_error():
    """White noise plus flicker of another simulator: the filter with N and K errs as it claims, and no bandwidth is
    better."""
    rng, rate, count = np.random.default_rng(3), 1.0, 400_000
    # The density of Kasdin's noise is 1/θ in rad per sample, so B² = 1 in B²/θ.
    signal = 4.0 * rng.standard_normal(count) + flicker(count, rng)
    found = filter_numbers((WN(sigma2=16.0) + FN(b2=1.0)).processes, rate, 10.0)
    sums = np.concatenate([[0.0], np.cumsum(signal)])
    ahead = (sums[10:] - sums[:-10]) / 10

    def made(gain: FilterGain) -> float:
        estimate = lfilter([gain.g], [1, -gain.keep], signal)
        wrong = ahead[1:] - estimate[:-10]
        return float(np.mean(wrong[20_000:] ** 2))

    real = made(found.gain)
    assert real == pytest.approx(found.N**2 * found.gain.claim(10)[0], rel=0.02)
    for factor in (0.3, 3.0):
        assert made(FilterGain(found.gain.bandwidth * factor)) > real


def test_the_density_of_flicker_noise_agrees_with_quadrature():
    gain, samples = FilterGain(0.02), 50
    process = FN(b2=1.0)

    def integrand(log: float) -> float:
        theta = math.exp(log)
        z = complex(math.cos(theta), math.sin(theta))
        ahead = sum(z**m for m in range(1, samples + 1)) / samples
        back = gain.g / (1 - gain.keep / z)
        density = RATE * process.psd([theta * RATE / (2 * math.pi)], RATE)[0]
        return float(abs(ahead - back) ** 2 * density * theta / math.pi)

    value = sum(quad(integrand, a, b, limit=400)[0] for a, b in ((-16, -4), (-4, -1), (-1, math.log(math.pi))))
    assert FilterPrediction.of([process], RATE, samples).error(gain)[0] == pytest.approx(value, rel=1e-6)


@pytest.mark.parametrize(
    "model",
    [PL(alpha=2.9, nu2=1.0), MAT(beta=1.0, nu=0.3, sigma2=1.0), AR1(phi=-0.99, sigma2=1.0), DR(omega=1e-3)],
)
@pytest.mark.parametrize("rate", [0.001, 10_000.0])
def test_every_process_has_finite_numbers(model, rate):
    for horizon in (1e-6, 1.0, 600.0):
        found = filter_numbers((model, WN(sigma2=1.0)), rate, horizon)
        assert 0 < max(found.N, found.K) < math.inf
        assert min(found.N, found.K) >= 0
