"""No number that the estimates leave open exceeds what the measured curve allows."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter

import gmwm
from gmwm.applications.navigation.api import budget
from gmwm.calibration.rest import _limits, reach_of
from gmwm.choosing.datasheets.bias_changes import BiasTerms, is_slow
from gmwm.choosing.datasheets.limits import variance_limit
from tests.helpers import each

RATE, SAMPLES = 10.0, 20_000
STRUCTURES = ("WN + GM", "GM + GM + WN", "WN + FN + RW", "WN + RW", "QN + WN + GM + RW")


def recording(seed):
    """Noise with a random slow part that the recording determines poorly."""
    rng = np.random.default_rng(seed)
    white = rng.normal(0.0, 10.0 ** rng.uniform(-6, -2), SAMPLES)
    walk = np.cumsum(rng.normal(0.0, np.std(white) * 10.0 ** rng.uniform(-6, -3), SAMPLES))
    decay = math.exp(-1 / (RATE * 10.0 ** rng.uniform(-2, 3)))
    kicks = rng.normal(0.0, np.std(white) * 10.0 ** rng.uniform(-4, -1), SAMPLES)
    kicks[0] = 0.0
    return gmwm.Signal(white + walk + lfilter([1.0], [1.0, -decay], kicks), RATE, "rad/s")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.base.errors.FitWarning")
@each("seed", range(30))
def test_no_number_exceeds_the_measured_curve(seed):
    fit = gmwm.fit(STRUCTURES[seed % len(STRUCTURES)], recording(seed))
    wv = fit.wavelet_variance
    sheet = fit.datasheet()
    for entry in sheet.entries:
        if entry.high is None or not math.isfinite(entry.high) or entry.unit not in ("rad/s", "rad/s/√Hz", "rad/s/√s"):
            continue
        if entry.symbol == "B" and entry.term is None:
            near = np.sqrt(2 * wv.upper)
            k = int(np.argmin(near))
            assert entry.high <= max(entry.value, near[max(k - 1, 0) : k + 2].max() / 0.664) * 1.01
        # Whatever the noise, its density is at most the largest one of any level, and its step that of the first level.
        largest = np.sqrt(2 * wv.upper.max()) * math.sqrt(SAMPLES / RATE)
        assert entry.high <= 10 * max(entry.value, largest)
    terms = BiasTerms.of(fit)
    total = float(np.sum(wv.upper)) + float(wv.upper[-1])
    for variance in (terms.variance_over(SAMPLES / RATE), terms.variance_of_mean(SAMPLES, SAMPLES)):
        assert variance.value <= variance.limit * (1 + 1e-9)
        assert variance.limit <= 4 * total
        assert _limits(variance, 0.95)[1] <= math.sqrt(variance.limit) * (1 + 1e-9)
        assert reach_of([(1.0, variance)], 0.95) <= 1.96 * math.sqrt(variance.limit) * (1 + 1e-6)
    for growth in budget({"gyro_x": fit}, duration=100.0).growths.values():
        wide = growth.low == 0
        assert np.all(growth.high[~wide] <= 10.0001 * growth.low[~wide])
        # A constant rate as large as the whole signal, for 100 s, gives a larger tilt.
        if growth.unit == "deg":
            assert growth.high.max() <= math.degrees(10 * math.sqrt(total) * 100.0)


def test_the_limit_is_that_of_a_walk_with_the_upper_limit_of_its_curve():
    fit = gmwm.fit("RW", gmwm.Signal(gmwm.RW(gamma2=1.0).simulate(10_000, RATE, rng=1), RATE, "rad/s"))
    wv, walk = fit.wavelet_variance, gmwm.RW(gamma2=1.0)
    most = float(variance_limit(wv, [walk], lambda process: process.scale))
    assert most == pytest.approx(float((wv.upper / walk.wavelet_variance(wv.levels, RATE)).min()))
    assert 0.9 < most < 3.0


def test_a_fast_process_with_a_slow_pole_is_no_bias():
    slow_pole = math.exp(-1 / (10.0 * RATE))
    fast = gmwm.ARMA(phi=[slow_pole], theta=[-0.98], sigma2=1.0)
    assert fast.correlation_time(RATE) >= 1.0
    assert not is_slow(fast, RATE)
    assert is_slow(gmwm.GM(beta=0.9, sigma2=1.0), RATE)
    assert is_slow(gmwm.GM(beta=0.9, sigma2=1.0), 1000.0)
