"""Flicker noise, power-law noise and fractional Gaussian noise: what they are beyond the laws of all processes."""

import math

import mpmath as mp
import numpy as np
import pytest

import gmwm
from gmwm import FGN, FN, PL, RW, WN, Model, WaveletVariance
from gmwm.base.errors import MissingTheoryError, ModelError
from gmwm.measuring.covariance import wavelet_covariance
from gmwm.measuring.covariance.design import Design
from gmwm.theory.processes.circulant_embedding import amplitudes
from gmwm.theory.processes.haar_covariance import LagGrid
from tests.helpers import each, raises

RATE = 100.0
ALPHAS = (-0.99, -0.3, 0.0, 0.7, 1.0 - 1e-9, 1.0, 1.0 + 1e-12, 1.4, 2.0, 2.7, 2.99)
LAGS = (0, 1, 2, 3, 4, 5, 17, 1000, 10**6, 2**30)
FLICKER = math.log(2) / math.pi


def power(alpha, nu2=1.0):
    return FN(b2=nu2 / FLICKER) if alpha == 1.0 else PL(alpha=alpha, nu2=nu2)


def exact_k(alpha, m):
    """K(m) in 60 digits, ν_1² = 1."""
    m, eps = abs(mp.mpf(m)), mp.mpf(alpha) - 1
    if m == 0:
        return mp.mpf(0)
    if eps == 0:
        return m * m * mp.ln(m) / (2 * mp.ln(2))
    return (m ** (2 + eps) - m * m) / (2 * (mp.mpf(2) ** eps - 1))


def exact_curve(model, levels=15, samples=2**17):
    values = model.wavelet_variance(levels, RATE)
    return WaveletVariance.from_values(values, samples=samples, rate=RATE, unit="rad/s", axis="gyro_x")


# --- the family -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["haar", "la8"])
@pytest.mark.parametrize(
    ("one", "other"),
    [
        (PL(alpha=0.0, nu2=1.0), WN(sigma2=2.0)),
        (PL(alpha=1.0, nu2=FLICKER), FN(b2=1.0)),
        (FGN(hurst=0.5, sigma2=2.0), WN(sigma2=2.0)),
        (FGN(hurst=0.8, sigma2=2.0), PL(alpha=0.6, nu2=2.0 * (1 - 2**-0.4))),
        # A walk that goes on between the samples is their mean of a random walk and a noise that differencing hides.
        (PL(alpha=2.0, nu2=0.5), RW(gamma2=3.0)),
    ],
)
def test_special_cases_are_other_processes(one, other, name):
    levels = np.arange(1, 13) if not isinstance(other, RW) else np.arange(9, 13)
    rel = 1e-12 if not isinstance(other, RW) else 1e-4
    np.testing.assert_allclose(
        one.wavelet_variance(levels, RATE, name), other.wavelet_variance(levels, RATE, name), rtol=rel
    )
    f = np.array([0.01, 0.1, 0.3, 0.5]) * RATE
    if not isinstance(other, RW):
        np.testing.assert_allclose(one.psd(f, RATE), other.psd(f, RATE), rtol=1e-12)


def test_flicker_noise_has_the_density_and_the_deviation_of_the_standard():
    one = FN(b2=4.0)
    f = np.array([1e-6, 1e-4]) * RATE
    np.testing.assert_allclose(one.psd(f, RATE), 4.0 / (2 * math.pi * f), rtol=1e-6)
    deviation = np.sqrt(one.allan_variance([1, 7, 10**6], RATE))
    np.testing.assert_allclose(deviation, 2.0 * math.sqrt(2 * math.log(2) / math.pi), rtol=1e-14)
    assert np.isinf(one.psd([0.0], RATE)[0])
    assert PL(alpha=-0.5, nu2=1.0).psd([0.0], RATE)[0] == 0
    assert math.isinf(one.correlation_time(RATE))


def test_one_of_a_family_in_a_sum_and_one_of_each():
    with raises(ModelError, "power law", first="PL", second="FGN"):
        PL() + FGN()
    with raises(ModelError, "FN", count=2):
        2 * FN()
    assert str(Model.parse("WN + FN + PL(alpha=1.5)")) == "WN + FN + PL(alpha=1.5)"
    with raises(ModelError, "between -1 and 3", argument="PL.alpha", got=3.0):
        PL(alpha=3.0)


# --- closed forms where they would cancel ---------------------------------------------------------------


@pytest.mark.parametrize("alpha", ALPHAS)
def test_covariances_have_their_digits_at_every_lag(alpha):
    one = power(alpha)
    found = one.generalised_covariance(np.array(LAGS), RATE)
    scale = abs(one.generalised_covariance(np.array([1]), RATE)[0])
    with mp.workdps(60):
        for lag, value in zip(LAGS, found, strict=True):
            exact = 2 * exact_k(alpha, lag) - exact_k(alpha, lag - 1) - exact_k(alpha, lag + 1)
            assert value == pytest.approx(float(exact), rel=3e-14, abs=1e-15 * scale)


@each("alpha", ALPHAS)
@each("steps", [(1, 1), (1, 2**12), (16, 64)])
def test_coefficient_covariances_have_their_digits(alpha, steps):
    fine, coarse = steps
    lags = np.array([0, 1, fine, coarse, 2 * coarse, 3 * coarse + 1, 40 * coarse, 10**7])
    at = LagGrid(np.full(lags.size, float(fine)), np.full(lags.size, float(coarse)), lags.astype(float))
    found = power(alpha).coefficient_covariance(at, RATE)
    with mp.workdps(60):
        exact = [
            sum(
                a * b * exact_k(alpha, int(u) - j * coarse + i * fine)
                for i, a in enumerate((1, -2, 1))
                for j, b in enumerate((1, -2, 1))
            )
            for u in lags
        ]
    sizes = np.array([float(fine), float(coarse)])
    own = power(alpha).coefficient_covariance(LagGrid(sizes, sizes, np.zeros(2)), RATE)
    np.testing.assert_allclose(found, np.array(exact, dtype=float), rtol=1e-11, atol=1e-14 * math.sqrt(own.prod()))


@pytest.mark.slow
@pytest.mark.parametrize("one", [power(a) for a in ALPHAS] + [FGN(hurst=0.93, sigma2=2.0)], ids=str)
def test_covariance_of_the_wavelet_variance_is_the_sum_over_all_pairs(one):
    n, levels = 300, np.arange(1, 9)
    lags = np.arange(n)
    a = one.generalised_covariance(lags, RATE)
    matrix = (a - a[0])[np.abs(np.subtract.outer(lags, lags))]
    rows = []
    for level in levels:
        taps = np.repeat([1.0, -1.0], 2 ** (level - 1)) / 2**level
        rows.append(np.array([np.pad(taps, (t, n - t - taps.size)) for t in range(n - taps.size + 1)]))
    brute = [[2 * np.mean((x @ matrix @ y.T) ** 2) for y in rows] for x in rows]
    np.testing.assert_allclose(wavelet_covariance(one, n, RATE), brute, rtol=1e-8)


@pytest.mark.parametrize("one", [FN(b2=2.0), PL(alpha=-0.8, nu2=1.0), PL(alpha=2.5, nu2=1.0)], ids=str)
def test_rules_between_the_kinks_are_the_sum_over_all_lags_of_a_long_record(one):
    n, half = 2**16, np.array([1.0, 16.0, 2.0**10])
    design = Design(np.array([1, 5, 11]), n, RATE)
    found = wavelet_covariance(one, n, RATE, levels=[1, 5, 11])
    u = np.arange(-n, n + 1.0)
    for j, h in enumerate(half):
        for k in range(j, 3):
            g = half[k]
            c = one.coefficient_covariance(LagGrid(np.full(u.size, h), np.full(u.size, g), u), RATE) / (4 * h * g)
            pairs = np.maximum(n - np.maximum(u, 0) - np.maximum(2 * h - 1, 2 * g - 1 - u), 0)
            exact = 2 * np.sum(pairs * c * c) / (design.counts[j] * design.counts[k])
            assert found[j, k] == pytest.approx(exact, rel=1e-9)


# --- simulation -----------------------------------------------------------------------------------------


@each("alpha", [*ALPHAS, *np.linspace(-0.95, 2.95, 14)])
def test_embedded_autocovariances_are_the_wanted_ones(alpha):
    """No eigenvalue is below zero but for rounding, so that roots squared give the autocovariance back."""
    half = 2**12
    k, ones = np.arange(half + 1), np.ones(half + 1)
    if alpha < 1:
        r = FGN(hurst=(alpha + 1) / 2, sigma2=1.0).autocovariance(k, RATE)
    else:
        r = power(alpha).coefficient_covariance(LagGrid(ones, ones, k.astype(float)), RATE)
    roots = amplitudes(lambda lags: r[lags.astype(int)], half)
    assert np.sum(roots == 0) <= 1
    back = np.fft.irfft(roots**2)[: half + 1]
    np.testing.assert_allclose(back, r, rtol=0, atol=1e-13 * r[0])


@pytest.mark.slow
def test_paths_of_any_length_and_their_joint_law():
    for n in (1, 2, 3, 5, 64):
        assert FN(b2=1.0).simulate(n, RATE, 1, paths=2).shape == (2, n)
    one = FGN(hurst=0.9, sigma2=2.0)
    paths = one.simulate(6, RATE, 3, paths=40_000)
    found = paths.T @ paths / len(paths)
    wanted = one.autocovariance(np.subtract.outer(np.arange(6), np.arange(6)), RATE)
    error = np.sqrt((wanted**2 + wanted[0, 0] ** 2) / len(paths))
    assert np.all(np.abs(found - wanted) < 4.5 * error)


# --- fits, numbers, what there is not -------------------------------------------------------------------


def test_fits_find_what_a_curve_was_made_of():
    truth = WN(sigma2=1.0) + FN(b2=0.02) + RW(gamma2=1e-6)
    found = gmwm.fit("WN + FN + RW", exact_curve(truth)).parameters
    assert found == pytest.approx(truth.parameters, rel=1e-6)
    for one in (PL(alpha=1.4, nu2=0.3), FGN(hurst=0.8, sigma2=2.0)):
        found = gmwm.fit(type(one)() + WN(), exact_curve(one + WN(sigma2=1.0))).parameters
        assert found == pytest.approx((one + WN(sigma2=1.0)).parameters, rel=1e-4)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
def test_intervals_of_flicker_noise_hold_the_truth_and_the_model_is_not_rejected():
    truth = WN(sigma2=1.0) + FN(b2=0.05) + RW(gamma2=1e-6)
    held, rejected, runs = 0, 0, 25
    for seed in range(runs):
        fit = gmwm.fit(truth.structure, truth.simulate(20_000, RATE, seed), rate=RATE)
        low, high = fit.confidence_intervals()["FN.b2"]
        held += low <= 0.05 <= high
        rejected += fit.goodness_of_fit().pvalue < 0.05
    # 95 % and 5 %, within four standard errors.
    assert held >= runs * (0.95 - 4 * math.sqrt(0.95 * 0.05 / runs))
    assert rejected <= runs * (0.05 + 4 * math.sqrt(0.95 * 0.05 / runs))


@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
def test_flicker_noise_is_the_bias_instability_of_the_standard():
    truth = WN(sigma2=1e-4) + FN(b2=4e-6) + RW(gamma2=1e-10)
    sheet = gmwm.fit(truth.structure, exact_curve(truth)).datasheet()
    assert list(sheet) == ["N", "K", "B", "N of WN", "K of RW"]
    assert sheet["B"].value == pytest.approx(2e-3, rel=1e-6)
    assert sheet["B"].low < 2e-3 < sheet["B"].high
    assert (sheet["B"].unit, sheet["B"].term, sheet["B"].tau) == ("rad/s", "FN", None)
    assert sheet["B"].title == "bias instability of flicker noise"
    alone = gmwm.fit(FN(), exact_curve(FN(b2=4e-6))).datasheet()
    assert alone["B"].value == pytest.approx(2e-3, rel=1e-6)
    assert not alone["B"].upper_only
    assert not alone.remarks


def test_a_process_that_is_not_stationary_has_no_autocovariance():
    with raises(MissingTheoryError, "not stationary", process="PL", theory="autocovariance"):
        PL(alpha=0.2, nu2=1.0).autocovariance([0, 1], RATE)
