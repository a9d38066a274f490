"""Uncertainty of shapes that a search fixes: of a filter from the spectrum, and of flicker noise near half the rate."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import quad

import gmwm
from gmwm.choosing.selection.fast_part import SAMPLED, band_errors, with_sampling_error
from gmwm.fitting.estimation import fit as fitted
from gmwm.measuring.spectrum.short_memory import Alternative, SpectralShape, short_memory

RATE = 100.0


def haar_variance(density, level):
    """Haar wavelet variance of a two-sided density per sample."""
    half = 2 ** (level - 1)

    def integrand(f):
        return np.sin(np.pi * f * half) ** 4 / (half * np.sin(np.pi * f)) ** 2 * density(f)

    edges = np.linspace(0, 0.5, half + 1)
    return 2 * sum(quad(integrand, low, high)[0] for low, high in pairwise(edges))


@pytest.mark.parametrize("level", range(1, 7))
def test_discrete_flicker_noise_has_more_power_at_the_first_levels(level):
    found = haar_variance(lambda f: np.pi / np.sin(np.pi * f), level)
    # The mean of 1/f noise over each interval has the wavelet variance 2 ln 2 at every level.
    assert found / (2 * math.log(2)) - 1 == pytest.approx(SAMPLED[level - 1], abs=1e-4)


def flicker(text, model="WN + FN"):
    x = gmwm.Model.parse(text).simulate(60_000, RATE, rng=1)
    curve = gmwm.wavelet_variance(gmwm.Signal(x, RATE, "rad/s", "gyro_x"))
    return fitted(model, curve), curve


def test_the_sampling_of_flicker_noise_widens_the_interval_of_white_noise():
    fit, curve = flicker("WN(sigma2=1) + FN(b2=3)")
    wider = with_sampling_error(curve, fit)
    share = fit.decomposition["FN"] / fit.implied
    assert wider.excess[0, 0] < (share[0] * SAMPLED[0]) ** 2
    assert wider.excess[0, 0] > (share[0] * SAMPLED[0] / 2) ** 2
    low, high = fit.confidence_intervals()["WN.sigma2"]
    again = fitted("WN + FN", wider).confidence_intervals()["WN.sigma2"]
    assert again[1] - again[0] > 1.5 * (high - low)


def test_no_flicker_noise_has_no_uncertain_sampling():
    fit, curve = flicker("WN(sigma2=1)", "WN")
    assert with_sampling_error(curve, fit) is curve


def shape(seed):
    """The fit of a spectrum of a low-pass of second order at 10 Hz."""
    rng, frequencies = np.random.default_rng(seed), np.geomspace(0.8, RATE / 2 * 0.999, 200)
    truth = np.abs(signal.freqz(*signal.butter(2, 0.2), frequencies, fs=RATE)[1]) ** 2
    density = truth * rng.chisquare(1000, 200) / 1000
    return short_memory(frequencies, density, np.full(200, 1000.0), rate=RATE, known=np.zeros(200))


@pytest.mark.slow
def test_the_error_of_the_bandwidth_is_its_scatter():
    scores = []
    for seed in range(40):
        found = shape(seed)
        process = gmwm.ARMA(phi=found.phi, theta=found.theta, sigma2=1.0)
        value = next(number.value for number in process.physical(RATE) if number.symbol == "f_b")
        # A Butterworth filter has half its power at its cut-off.
        scores.append(math.log(value / 10.0) / band_errors(found, RATE)["f_b"])
    assert np.mean(np.abs(scores) < 1.96) >= 0.9
    assert np.sqrt(np.mean(np.square(scores))) > 0.5


def test_other_orders_widen_the_error_of_the_bandwidth():
    one = SpectralShape(
        phi=np.array([0.5]), theta=np.zeros(0), innovation=1.0, covariance=np.array([[1e-6]]), misfit=1.0
    )
    other = Alternative(phi=np.array([0.6]), theta=np.zeros(0), density=1.0, weight=0.25)
    both = SpectralShape(
        phi=one.phi, theta=one.theta, innovation=1.0, covariance=one.covariance, misfit=1.0, alternatives=(other,)
    )

    def band(phi):
        return next(n.value for n in gmwm.AR(phi=[phi], sigma2=1.0).physical(RATE) if n.symbol == "f_b")

    alone, together = (band_errors(one_of, RATE)["f_b"] for one_of in (one, both))
    spread = 0.25 * math.log(band(0.6) / band(0.5)) ** 2
    assert together**2 - alone**2 == pytest.approx(spread)
