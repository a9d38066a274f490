"""The formulas of docs/theory.md are those that the code computes."""

import numpy as np
import pytest

import gmwm

RATE, LEVELS = 100.0, np.arange(1, 16)
TAU, H = 2.0**LEVELS, 2.0 ** (LEVELS - 1)
LAM, PHI = 0.02, np.exp(-0.02)


def g(x):
    return 2 * x + 4 * np.expm1(-x) - np.expm1(-2 * x)


IMPLIED = {
    "WN(sigma2=3)": 3 / TAU,
    "QN(q2=3)": 6 * 3 / TAU**2,
    "RW(gamma2=3)": 3 * (TAU**2 + 2) / (12 * TAU),
    "DR(omega=3)": 9 * TAU**2 / 16,
    "GM(beta=2, sigma2=3)": 3 * (g(LAM * H) + 2 * H * (np.sinh(LAM) - LAM)) / (8 * H**2 * np.sinh(LAM / 2) ** 2),
    "FN(b2=3)": 3 * np.log(2) / np.pi + 0 * TAU,
    "PL(alpha=1.5, nu2=3)": 3 * (TAU / 2) ** 0.5,
    "MA(1, theta1=0.4, sigma2=3)": 3 * (1.4**2 * TAU - 6 * 0.4) / TAU**2,
    "SIN(frequency=7, power=3)": 3 * np.sin(np.pi * H * 0.07) ** 4 / (H**2 * np.sin(np.pi * 0.07) ** 2),
}
M = np.arange(50)
COVARIANCE = {
    "WN(sigma2=3)": -3 * M / 2,
    "QN(q2=3)": 3.0 * (M == 0),
    "RW(gamma2=3)": 3 * (M**3.0 - M) / 12,
    "GM(beta=2, sigma2=3)": -1.5 * (M * (1 + PHI) / (1 - PHI) - 2 * PHI * (1 - PHI**M) / (1 - PHI) ** 2),
}


@pytest.mark.parametrize("text", IMPLIED)
def test_the_wavelet_variance_of_a_process(text):
    found, curve = gmwm.Model.parse(text).wavelet_variance(LEVELS, RATE), IMPLIED[text]
    assert np.allclose(found, curve, rtol=1e-7, atol=1e-10 * curve.max())


@pytest.mark.parametrize("text", COVARIANCE)
def test_the_covariance_of_the_cumulative_sum(text):
    found, covariance = gmwm.Model.parse(text).processes[0].running_sum_covariance(M, RATE), COVARIANCE[text]
    # It is defined up to a + b m², which third differences remove.
    assert np.allclose(np.diff(found, 3), np.diff(covariance, 3), rtol=0, atol=1e-10 * np.abs(covariance).max())


def test_the_allan_variance_the_objective_and_the_bounds():
    model = gmwm.Model.parse("GM(beta=2, sigma2=3) + WN(sigma2=1)")
    x = model.simulate(20_000, RATE, rng=1)
    wv, allan = gmwm.wavelet_variance(x, RATE), gmwm.allan_variance(x, RATE)
    at = [int(np.argmin(np.abs(allan.tau - t / 2))) for t in wv.tau]
    assert np.allclose(allan.variance[at], 2 * wv.variance)
    fit = gmwm.fit("GM + WN", wv, weighting="optimal")
    r = wv.variance - fit.implied
    assert np.isclose(r @ fit.weighting_matrix @ r, fit.objective)
    assert np.isclose(fit.wic().optimism, 2 * 3, rtol=0.1)  # 2p, p = 3
    assert fit.relaxed_bound <= fit.lower_bound <= fit.objective


def test_the_numbers_of_other_programs_as_processes():
    """The last column of the table in docs/coming-from/index.md."""
    N, K, Q, R, T_c, q_c = 2e-4, 3e-6, 1e-6, 1e-9, 50.0, 1e-5
    tau = np.array([0.01, 1.0, 100.0])
    n = np.rint(tau * RATE).astype(int)
    parts = {
        gmwm.WN(sigma2=N**2 * RATE): N**2 / tau,
        gmwm.RW(gamma2=K**2 / RATE): K**2 * tau / 3 + K**2 / (6 * n * RATE),  # the second: discrete steps
        gmwm.QN(q2=Q**2 * RATE**2): 3 * Q**2 / tau**2,
        gmwm.DR(omega=R / RATE): R**2 * tau**2 / 2,
    }
    for process, allan in parts.items():
        assert np.allclose(process.allan_variance(n, RATE), allan), process
    slow = gmwm.GM(beta=1 / T_c, sigma2=q_c**2 * T_c / 2)
    # A random walk, far below T_c.
    assert np.isclose(slow.allan_variance(np.array([100]), RATE)[0], q_c**2 * 1.0 / 3, rtol=0.02)


def test_the_processes_of_r():
    """The table in docs/coming-from/r.md: AR1 and GM, β without a frequency, the sinusoid and quantization noise."""
    rate, beta, sigma2, levels = 250.0, 0.4, 2e-8, 14
    phi = np.exp(-beta / rate)
    as_ar1 = gmwm.AR1(phi=phi, sigma2=sigma2 * (1 - phi**2)).wavelet_variance(levels, rate)
    assert np.allclose(gmwm.GM(beta=beta, sigma2=sigma2).wavelet_variance(levels, rate), as_ar1, rtol=1e-9)
    per_sample = gmwm.GM(beta=0.0016, sigma2=sigma2).wavelet_variance(levels, 1.0)
    assert np.allclose(gmwm.GM(beta=0.0016 * rate, sigma2=sigma2).wavelet_variance(levels, rate), per_sample)
    alpha2, angular = 0.5, 0.05
    wave = np.sqrt(alpha2) * np.sin(angular * np.arange(2**16) + 1.0)
    line = gmwm.SIN(frequency=angular * rate / (2 * np.pi), power=alpha2 / 2)
    assert np.allclose(gmwm.wavelet_variance(wave, rate).variance[:6], line.wavelet_variance(6, rate), rtol=1e-3)
    rounding = np.sqrt(12 * 3.0) * np.diff(np.random.default_rng(1).uniform(size=200_001))
    found = gmwm.wavelet_variance(rounding, rate).variance[:4]
    assert np.allclose(found, gmwm.QN(q2=3.0).wavelet_variance(4, rate), rtol=0.02)
