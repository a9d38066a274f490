"""Sinusoids: aliases, exact zeros, order, fits."""

import numpy as np
import pytest

from gmwm import SIN, WN, fit, fixed
from gmwm.base.errors import MissingTheoryError, ModelError
from gmwm.theory.filters import FILTERS, find_filter
from gmwm.theory.processes import Model
from tests.helpers import code_of, each, raises

RATE = 100.0


@each("name", FILTERS)
def test_the_shape_is_the_squared_gain(name):
    f, frequency = find_filter(name), np.array([0.03, 1.7, 12.5, 33.0, 49.99])
    shape = SIN.shape(frequency[:, None], 12, RATE, f)
    gain = np.array([f.squared_gain(frequency / RATE, j) for j in range(1, 13)]).T
    np.testing.assert_allclose(shape, gain, atol=1e-13)


@pytest.mark.parametrize("name", ["haar", "d4", "mb8"])
def test_the_slope_is_the_derivative(name):
    f, frequency, levels = find_filter(name), np.array([0.3, 4.3, 12.5, 33.0, 49.9]), np.arange(1, 9)
    slope = SIN.shape_jacobian(frequency[:, None], levels, RATE, f)[:, :, 0]
    step = 1e-5
    near, far = (
        (SIN.shape((frequency + s)[:, None], levels, RATE, f) - SIN.shape((frequency - s)[:, None], levels, RATE, f))
        / (2 * s)
        for s in (step, 2 * step)
    )
    np.testing.assert_allclose(slope, (4 * near - far) / 3, atol=1e-8)


def test_above_half_the_rate_an_alias_is_seen():
    for name in ("haar", "la8"):
        ten = SIN(10.0, 2.0).wavelet_variance(12, RATE, name)
        for alias in (90.0, 110.0, 190.0):
            np.testing.assert_allclose(SIN(alias, 2.0).wavelet_variance(12, RATE, name), ten, rtol=1e-12)
        np.testing.assert_array_equal(SIN(3 * RATE, 2.0).wavelet_variance(12, RATE, name), np.zeros(12))
    lags = np.arange(-9, 10)
    np.testing.assert_allclose(SIN(90.0, 2.0).autocovariance(lags, RATE), SIN(10.0, 2.0).autocovariance(lags, RATE))
    assert SIN(260.0, 1.0).line(250.0) == (1.0, 10.0 / 250.0)


def test_whole_turns_in_half_a_scale_leave_exactly_nothing():
    variance = SIN(frequency=12.5, power=1.0).wavelet_variance(20, RATE)
    assert np.all(variance[:3] > 0)
    np.testing.assert_array_equal(variance[3:], 0.0)


def test_small_frequencies_act_as_a_ramp_and_lose_no_digit():
    # ν² → P π² f² h² of a sine that hardly turns.
    variance = SIN(1e-150, 1.0).wavelet_variance(20, RATE)
    np.testing.assert_allclose(variance, (np.pi * 1e-152 * np.ldexp(1.0, np.arange(20))) ** 2, rtol=1e-12)


def test_lags_are_exact_however_long():
    # 2^40 + 1 turns of 3/8 are 3/8 of a turn more than whole ones.
    lags = np.array([2**28 + 1, 2**28 + 8 * 12345 + 3])
    np.testing.assert_allclose(SIN(37.5, 1.0).autocovariance(lags, RATE), np.cos(2 * np.pi * np.array([3, 9]) / 8))


def test_allan_variance_is_twice_the_wavelet_variance():
    one = SIN(3.3, 2.0)
    np.testing.assert_allclose(one.allan_variance(2 ** np.arange(10), RATE), 2 * one.wavelet_variance(10, RATE))
    paths = one.simulate(3000, RATE, 1, paths=4)
    for n in (3, 10, 45):
        means = paths[:, : 3000 // n * n].reshape(4, -1, n).mean(axis=2)
        found = np.mean(np.diff(means, axis=1) ** 2) / 2
        assert found == pytest.approx(one.allan_variance([n], RATE)[0], rel=0.1)


def test_paths_have_their_amplitude():
    paths = SIN(1.0, 8.0).simulate(1000, RATE, 1, paths=50)
    np.testing.assert_allclose(np.abs(paths).max(axis=1), 4.0, rtol=1e-2)
    np.testing.assert_allclose(np.mean(paths**2, axis=1), 8.0, rtol=1e-12)
    assert np.ptp(paths[:, 0]) > 6.0


def test_no_spectral_density():
    with raises(MissingTheoryError, "power spectral density", process="SIN", theory="psd"):
        SIN(1.0, 1.0).psd([1.0], RATE)
    assert not SIN.has("psd")
    with raises(MissingTheoryError, process="SIN", rest="WN(sigma2=1.0)"):
        (SIN(1.0, 1.0) + WN(1.0)).psd([1.0], RATE)


def test_several_are_sorted_by_frequency_and_one_frequency_is_held_once():
    model = (SIN(50.0, 1.0) + WN(1.0) + SIN(3.0, 2.0)).sorted(RATE)
    assert [p.values.get("frequency") for p in model.processes] == [3.0, None, 50.0]
    with raises(ModelError, "SIN", "both fixed"):
        SIN(frequency=fixed(50.0)) + SIN(frequency=fixed(50.0))
    assert str(Model.parse("2*SIN + WN")) == "2*SIN + WN"


def test_remarks_where_the_phase_stands_still():
    half = RATE / 2
    for frequency in (half, 3 * half, half * (1 + 1e-7)):
        (remark,) = SIN(frequency, 8.0).remarks("SIN", 10_000, RATE)
        assert (code_of(remark), remark.facts["half"].value) == ("line-invisible:half", half)
    (remark,) = SIN(RATE, 8.0).remarks("SIN", 10_000, RATE)
    assert (code_of(remark), remark.facts["frequency"].value) == ("line-invisible:rate", RATE)
    # With half a turn of the phase over the record, the mean of sin² is one half again.
    for frequency in (half * (1 + 1e-4), 0.7, 0.9 * half, RATE / 1e6):
        assert SIN(frequency, 8.0).remarks("SIN", 10_000, RATE) == ()
    assert SIN(half, 0.0).remarks("SIN", 10_000, RATE) == ()


def test_physical_frequency_and_amplitude():
    frequency, amplitude = SIN(1.0, 8.0).physical(RATE)
    assert (frequency.symbol, frequency.value, frequency.signal_power, frequency.time_power) == ("f_0", 1.0, 0, -1.0)
    assert (amplitude.symbol, amplitude.value, amplitude.signal_power, amplitude.time_power) == ("A", 4.0, 1, 0.0)


@pytest.mark.parametrize("wanted", [SIN(), SIN(frequency=fixed(3.0))])
def test_fit(wanted):
    x = (WN(1.0) + SIN(3.0, 2.0)).simulate(2**15, RATE, 5)
    found = fit(WN() + wanted, x, rate=RATE)
    limits = found.confidence_intervals(level=0.9999)
    for name, truth in (("WN.sigma2", 1.0), ("SIN.frequency", 3.0), ("SIN.power", 2.0)):
        if name not in found.model.fixed_names:
            assert limits[name][0] <= truth <= limits[name][1]
    # Far better known than a noise of that variance would be, with some 300 coefficients of its scale.
    assert np.ptp(limits["SIN.power"]) < 0.2
