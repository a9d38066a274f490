"""Lost samples are drawn so that a signal keeps its second moments at every scale. The simulators are plain NumPy."""

import numpy as np
import pytest
from scipy.signal import lfilter

from gmwm.recording.gaps import drawn
from tests.helpers import each

N = 1 << 16


def white(n, rng):
    return rng.normal(size=n)


def gauss_markov(n, rng):
    steps = np.concatenate([rng.normal(size=1), rng.normal(size=n - 1) * np.sqrt(1 - 0.999**2)])
    slow = lfilter([1.0], [1.0, -0.999], steps)
    return rng.normal(size=n) + 0.3 * slow


def walk(n, rng):
    return np.cumsum(rng.normal(size=n))


def quantization(n, rng):
    return np.diff(rng.uniform(-1.0, 1.0, n + 1)) + 0.3 * rng.normal(size=n)


def low_pass(n, rng):
    return np.convolve(rng.normal(size=n + 30), np.hanning(31), mode="valid")


def rounded(n, rng):
    return np.round(rng.normal(size=n) / 2) * 2


SIGNALS = {f.__name__: f for f in (white, gauss_markov, walk, quantization, low_pass, rounded)}


def losses(n, share, burst, rng):
    present = np.ones(n, dtype=bool)
    count = rng.poisson(share * n / burst)
    for first in rng.integers(50, n - 50, count):
        present[first : first + (rng.geometric(1 / burst) if burst > 1 else 1)] = False
    present[:40] = present[-40:] = True
    return present


def curve(x, levels):
    path = np.concatenate([[0.0], np.cumsum(x - x.mean())])
    halves = [1 << k for k in range(levels)]
    return np.array([np.mean((path[2 * h :] - 2 * path[h:-h] + path[: -2 * h]) ** 2) / (4.0 * h * h) for h in halves])


@pytest.mark.slow
@each(("share", "burst"), [(0.005, 1), (0.1, 1), (0.03, 100)])
@each("name", SIGNALS)
def test_the_wavelet_variance_is_unbiased_at_all_scales(name, share, burst):
    levels, ratios, white = 10, [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        x = SIGNALS[name](N, rng)
        present = losses(N, share, burst, rng)
        ratios.append(curve(drawn(x, present), levels) / curve(x, levels))
        white.append(np.var(x) / 2.0 ** np.arange(1, levels + 1) / curve(x, levels))
    error = np.std(ratios, axis=0) / np.sqrt(len(ratios))
    bias = np.mean(ratios, axis=0) - 1
    # Beyond chance, 1 % at fine scales and a few percent at coarse ones, where the data scatter by far more.
    allowed = np.maximum(0.01, np.minimum(share, 0.05) * 0.6) * np.where(np.arange(levels) < 4, 0.5, 1.0)
    # In addition, lost samples of a smooth signal have white noise of 0.1 % of its variance.
    allowed += share * 1e-3 * np.mean(white, axis=0)
    assert np.all(np.abs(bias) < 4 * error + allowed)


@pytest.mark.slow
@each("taps", [(1, 1), (1, 1, 1, 1), (1, 2, 3, 4, 3, 2, 1)])
@each("periodic", [False, True])
def test_a_quarter_of_the_samples_of_a_smooth_output_can_be_lost(taps, periodic):
    """Draws in turn, each from neighbours that are drawn too, would amplify each other without limit."""
    ratios = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        x = np.convolve(rng.normal(size=N), taps, "valid") + np.cumsum(1e-3 * rng.normal(size=N - len(taps) + 1))
        present = np.arange(x.size) % 4 > 0 if periodic else rng.random(x.size) > 0.25
        ratios.append(curve(drawn(x, present), 9) / curve(x, 9))
    error = np.std(ratios, axis=0) / np.sqrt(len(ratios))
    assert np.all(np.abs(np.mean(ratios, axis=0) - 1) < 4 * error + 0.02)


def test_mean_values_or_interpolation_would_not_do():
    rng = np.random.default_rng(1)
    x, present = rng.normal(size=1 << 18), rng.random(1 << 18) > 0.05
    places = np.arange(x.size)
    line = np.interp(places, places[present], x[present])
    ratio = curve(line, 8) / curve(x, 8)
    assert ratio[0] < 0.97
    assert ratio[6] > 1.04
    assert np.all(np.abs(curve(drawn(x, present), 8) / curve(x, 8) - 1) < 0.03)


def test_known_samples_stay_and_the_draws_are_reproducible():
    rng = np.random.default_rng(2)
    x = rng.normal(size=5000) + 1e6
    present = losses(5000, 0.05, 3, rng)
    spoilt = np.where(present, x, np.nan)
    found = drawn(spoilt, present)
    assert np.array_equal(found[present], x[present])
    assert np.array_equal(found, drawn(spoilt, present))
    assert not np.array_equal(found, drawn(spoilt, present, seed=1))
    assert np.all(np.isfinite(found))


def test_offset_and_scale():
    rng = np.random.default_rng(3)
    x = rng.normal(size=5000)
    present = losses(5000, 0.05, 3, rng)
    one = drawn(x, present)
    assert np.allclose(drawn(1e-9 * x + 1.0, present), 1e-9 * one + 1.0, rtol=0, atol=1e-15)
    assert np.array_equal(drawn(2.0**40 * x, present), 2.0**40 * one)


@pytest.mark.slow
def test_the_covariance_of_two_axes_is_kept():
    rng = np.random.default_rng(4)
    common = rng.normal(size=1 << 17)
    a, b = common + 0.5 * rng.normal(size=common.size), common + 0.5 * rng.normal(size=common.size)
    present = rng.random(common.size) > 0.1
    found = np.corrcoef(drawn(a, present)[~present], drawn(b, present)[~present])[0, 1]
    assert found == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize("value", [0.0, 9.81])
def test_a_constant_signal_stays_constant(value):
    present = np.ones(1000, dtype=bool)
    present[[3, 500, 501, 990]] = present[600:700] = False
    assert np.ptp(drawn(np.full(1000, value), present)) < 1e-12


def test_a_line_of_the_mains_keeps_its_amplitude():
    rng = np.random.default_rng(5)
    t = np.arange(1 << 16) / 1000.0
    x = rng.normal(size=t.size) + np.sin(2 * np.pi * 50.3 * t)
    found = drawn(x, rng.random(t.size) > 0.05)
    amplitude = 2 * np.abs(np.mean(found * np.exp(-2j * np.pi * 50.3 * t)))
    assert amplitude == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("n", [9, 17, 40, 100, 300])
def test_short_signals(n):
    x = np.random.default_rng(n).normal(size=n)
    present = np.ones(n, dtype=bool)
    present[n // 2] = False
    found = drawn(x, present)
    assert np.isfinite(found).all()
    assert abs(found[n // 2]) < 10
