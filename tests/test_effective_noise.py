"""N and K for a filter that has only two numbers: a zero never reaches it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import gmwm
from gmwm import GM, RW, WN, fixed
from gmwm.choosing.datasheets.effective import Use, curve_ratio, filter_entries
from gmwm.choosing.datasheets.filter_numbers import filter_numbers
from tests.helpers import codes, only, raises
from tests.test_datasheet import exact, near

# Terms that the data do not need are what this is about.
pytestmark = pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")


def test_effective_noise_is_never_zero():
    # The only slow term is white noise over a long horizon: no walk is in the model, and no zero in the answer.
    fit = gmwm.fit("GM + WN", exact(GM(beta=0.5, sigma2=1e-8) + WN(sigma2=1e-6)))
    found = gmwm.datasheets.effective_noise(fit, 10.0)["K"]
    assert (found.low, found.value, found.upper_only) == (0.0, found.high, True)
    wider = gmwm.fit("GM + WN + RW", exact(GM(beta=0.5, sigma2=1e-8) + WN(sigma2=1e-6)), certify=False)
    assert found.high == near(wider.datasheet()["K of RW"].high, 1e-3)
    assert found.text().startswith("≤ ")
    white = gmwm.datasheets.effective_noise(gmwm.fit("RW", exact(RW(gamma2=1e-12))), 1.0)["N"]
    assert white.value == white.high > white.low == 0
    # Where the data give no limit there is none, and still no zero.
    few = gmwm.datasheets.effective_noise(gmwm.fit("WN", np.random.default_rng(1).normal(size=8), rate=1.0), 1.0)["K"]
    assert few.value == few.high > 0


def test_where_the_model_does_not_fit_the_curve_gives_the_numbers():
    """A model without the Gauss-Markov term of 0.25 s that the data have: N and K are those of the whole curve."""
    truth = GM(beta=4.0, sigma2=3e-8) + WN(sigma2=1e-6) + RW(gamma2=1e-12)
    whole, lacking = (gmwm.fit(model, exact(truth), certify=False) for model in ("GM + WN + RW", "WN + RW"))
    assert curve_ratio(whole) is None
    right, found = gmwm.datasheets.effective_noise(whole), gmwm.datasheets.effective_noise(lacking)
    alone = filter_numbers(lacking.model.processes, 100.0)
    assert found["N"].value == near(right["N"].value, 0.12)
    assert found["K"].value == near(right["K"].value, 0.5)
    assert 0.8 * right["N"].value > alone.N
    assert 2.5 * right["K"].value < alone.K
    assert found["N"].low <= alone.N
    assert found["K"].high >= alone.K
    assert only(lacking.datasheet().remarks, "numbers-from-curve").facts["factor"] > 2
    assert "numbers-from-curve" not in codes(whole.datasheet().remarks)


@pytest.mark.parametrize(("frequency", "includes"), [(12.0, True), (8.0, False)])
def test_the_interval_of_white_noise_includes_the_number_without_the_flanks_of_fast_oscillators(frequency, includes):
    """A fan whose speed wanders has no flanks at low frequencies, unlike the oscillator that describes its peak."""
    line = gmwm.OSC(frequency=fixed(frequency), quality=fixed(20.0), sigma2=1e-4)
    fit = gmwm.fit(line.with_values(sigma2=None) + WN(), exact(line + WN(sigma2=1e-6)), certify=False)
    white = filter_entries(fit, Use(), 0.95)["N"]
    assert white.value > 1.3e-4
    assert (white.low < 1e-4) == includes


def test_the_interval_of_white_noise_includes_the_number_without_a_ramp():
    """A filter that follows a ramp is faster, with a larger K and a smaller N than the sensor has."""
    truth = WN(sigma2=1e-6) + gmwm.DR(omega=4e-8)
    white = filter_entries(gmwm.fit("WN + DR", exact(truth), certify=False), Use(), 0.95)["N"]
    assert white.value < 0.985e-4
    assert white.low < white.value < 1e-4 < white.high


@pytest.mark.parametrize(("power", "changes"), [(1e-4, False), (1e-8, True)])
def test_a_misfit_where_an_oscillation_prevails_is_not_one_of_the_noise(power, changes):
    """A small error in the shape of an oscillation of 10 standard deviations is as large as the noise below it."""
    line = gmwm.OSC(frequency=fixed(24.5), quality=fixed(1000.0), sigma2=power)
    fit = gmwm.fit(line.with_values(sigma2=None) + WN(), exact(line + WN(sigma2=1e-6)), certify=False)
    moved = replace(fit, implied=fit.implied * np.where(fit.wavelet_variance.levels <= 2, 1.5, 1.0))
    assert (curve_ratio(moved) is not None) == changes


@pytest.mark.parametrize(("share", "visible"), [(8.0, True), (12.0, False)])
def test_a_walk_that_needs_a_filter_as_slow_as_the_recording_is_zero(share, visible):
    curve = exact(WN(sigma2=1e-6) + RW(gamma2=1e-6 * (share / 2**18) ** -2 * (share / 2**18) ** 4))
    fit = gmwm.fit("WN + RW", curve, certify=False)
    white, walk = filter_entries(fit, Use(), 0.95).values()
    assert white.value == near(1e-4, 1e-3)
    assert (walk.value > 0) == (not visible)


def test_three_standard_errors_make_a_misfit():
    curve = exact(WN(sigma2=1e-6))
    fit = gmwm.fit("WN", curve, certify=False)
    error = np.log(curve.upper / curve.variance) / 1.959963985
    for distance, level in ((2.9, 8), (3.1, 8)):
        moved = fit.implied * np.exp(np.where(curve.levels == level, distance * error, 0.0))
        ratio = curve_ratio(replace(fit, implied=moved))
        assert (ratio is not None) == (distance > 3)


@pytest.mark.parametrize("given", ["WN", WN(sigma2=1.0), WN(sigma2=1.0) + RW(gamma2=1.0), None])
def test_only_a_fit_has_limits(given):
    with raises(gmwm.errors.OptionError, type(given).__name__, argument="fit", advises=["gmwm.fit(model, data)"]):
        gmwm.datasheets.effective_noise(given, 10.0)


@pytest.mark.parametrize("horizon", [0.5, 1.0, 3.0])
def test_white_noise_includes_slow_noise_below_the_limit_of_the_walk(horizon):
    x = np.random.default_rng(1).normal(size=3000)
    fit = gmwm.fit("WN", gmwm.Signal(x, 100.0, "rad/s"))
    white, walk = gmwm.datasheets.effective_noise(fit, horizon).values()
    alone = fit.datasheet()["N"].value
    assert walk.upper_only
    assert white.value == near(alone, 1e-6)
    # Allan variances at T: N²/T of white noise, K² T/3 of a walk, K N ln 2 of flicker noise with the same filter.
    assert white.high**2 > alone**2 + horizon * walk.high * max(walk.high * horizon / 3, alone * np.log(2))


def test_a_walk_is_a_limit_if_another_filter_may_be_best():
    """A filter averages a Gauss-Markov term of 0.6 s, and tracks one of 1.2 s, which is the estimate here."""
    rng, rate = np.random.default_rng(4), 100.0
    for time, samples, limit in ((1.2, 6000, True), (20.0, 600_000, False)):
        phi = np.exp(-1 / (rate * time))
        x = lfilter([1.0], [1.0, -phi], 0.03 * rng.normal(size=samples) * np.sqrt(1.2 / time)) + rng.normal(
            size=samples
        )
        fit = gmwm.fit("GM + WN", gmwm.Signal(x, rate, "rad/s"))
        assert gmwm.datasheets.effective_noise(fit)["K"].upper_only == limit
