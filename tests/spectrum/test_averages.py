"""Side lobes of an average of samples are no resonances, and its model is a moving average."""

import numpy as np
import pytest
import scipy.signal

import gmwm
from gmwm import Signal
from tests.helpers import codes

RATE, WHITE, SIZE = 100.0, 1e-4, 60_000


def _averaged(length, passes, seed, extra=0.0):
    noise = WHITE * RATE**0.5 * np.random.default_rng(seed).normal(size=SIZE + 200) + extra
    for _ in range(passes):
        noise = scipy.signal.lfilter(np.ones(length) / length, [1], noise)
    return noise[200:]


@pytest.mark.parametrize(("length", "passes"), [(2, 1), (4, 1), (16, 1), (64, 1), (2, 2), (8, 2), (32, 2)])
def test_an_average_is_recognised_and_its_side_lobes_are_no_peaks(length, passes):
    for seed in range(3):
        x = _averaged(length, passes, seed)
        step = 0.05 * x.std()
        for values in (x, np.round(x / step) * step):
            spectrum = gmwm.psd(values, RATE)
            assert spectrum.average[:2] == (length, passes)
            assert not spectrum.bumps
            assert not spectrum.lines


@pytest.mark.parametrize("filter", ["none", "one pole", "two poles", "sharp", "walk"])
def test_other_filters_are_no_averages(filter):
    for seed in range(5):
        x = np.random.default_rng(seed).normal(size=SIZE)
        edge = 0.05 + 0.17 * seed  # a pole at half of half the rate is an average of two samples
        if filter in ("one pole", "two poles"):
            x = scipy.signal.lfilter(*scipy.signal.butter(["one pole", "two poles"].index(filter) + 1, edge), x)
        elif filter == "sharp":
            x = scipy.signal.lfilter(scipy.signal.firwin(41, edge), [1], x)
        elif filter == "walk":
            x = x + np.cumsum(edge * np.random.default_rng(seed + 100).normal(size=SIZE))
        assert gmwm.psd(x, RATE).average is None


def test_a_resonance_and_a_line_behind_an_average_are_measured():
    rng = np.random.default_rng(5)
    pole = 0.98 * np.exp(2j * np.pi * 0.155)
    ringing = scipy.signal.lfilter([1], [1, -2 * pole.real, abs(pole) ** 2], 1e-4 * rng.normal(size=SIZE + 200))
    wave = 1e-3 * np.sin(2 * np.pi * 0.08 * np.arange(SIZE + 200))
    spectrum = gmwm.psd(_averaged(8, 1, 5, ringing + wave), RATE)
    assert spectrum.average[:2] == (8, 1)
    assert [round(bump.frequency, 0) for bump in spectrum.bumps] == [pytest.approx(15.5, abs=1)]
    (line,) = spectrum.lines
    gain = abs(np.sin(np.pi * 8 * 0.08) / (8 * np.sin(np.pi * 0.08)))
    assert (line.frequency, line.amplitude) == (pytest.approx(8, abs=0.01), pytest.approx(1e-3 * gain, rel=0.1))


@pytest.mark.parametrize(("length", "passes"), [(16, 1), (32, 1), (8, 2), (16, 2)])
def test_the_model_is_a_moving_average_and_n_can_be_used(length, passes):
    walk = np.cumsum(1e-6 * np.random.default_rng(9).normal(size=SIZE + 200))
    x = _averaged(length, passes, 8, walk)
    calibration = gmwm.calibrate(Signal(x, RATE, "rad/s", axis="gyro_x"))
    result = calibration["gyro_x"]
    assert f"MA({passes * (length - 1)})" in result.model.structure
    assert "resonance-found" not in codes(calibration.remarks)
    number = calibration.datasheets["gyro_x"]["N"]
    # The average of T samples is less noisy if part of them are averaged already.
    memory = length * passes / 3 / RATE
    assert number.low < WHITE * (1 - memory / 2) * 1.01
    assert number.high > WHITE * (1 - memory)
    assert calibration.number_verdicts["gyro_x"]["N"].usability.value == "use"
