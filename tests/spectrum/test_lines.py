"""Lines and bumps: what is found, how precisely, and what is not found."""

from dataclasses import replace

import numpy as np
import pytest

from gmwm import psd
from gmwm.measuring.spectrum.line import Line
from gmwm.measuring.spectrum.peaks import distinct
from tests.spectrum.recordings import RATE, RESONANCES, SMOOTH, line, resonance


@pytest.mark.slow
@pytest.mark.parametrize("kind", [kind for kind in SMOOTH if kind not in ("low-pass 2, low", "quantised")])
def test_false_alarms(kind):
    runs = 100
    found = [psd(SMOOTH[kind](np.random.default_rng([5, run]), 6000), RATE) for run in range(runs)]
    alarms = sum(bool(one.lines or one.bumps) for one in found)
    # 1 %: at most 1 on average, and 4 with a probability of 99.6 %.
    assert alarms <= 4


@pytest.mark.slow
@pytest.mark.parametrize("which", [which for which in RESONANCES if which[1] != 5], ids=str)
def test_a_resonance_is_a_bump(which):
    frequency, quality = which
    runs = 30
    found = [psd(RESONANCES[which](np.random.default_rng([6, run]), 33_000), RATE) for run in range(runs)]
    assert sum(bool(one.lines) for one in found) <= 2
    assert sum(len(one.bumps) == 1 for one in found) >= runs - 2
    bumps = [one.bumps[0] for one in found if one.bumps]
    # The peak of two poles with Q = 2 lies 4 % below their frequency, and its width depends on what lies beside it.
    assert np.median([bump.frequency for bump in bumps]) == pytest.approx(frequency, rel=0.05)
    assert np.median([bump.quality for bump in bumps]) == pytest.approx(quality, rel=0.4 if quality == 2 else 0.12)


@pytest.mark.slow
def test_a_resonance_of_a_few_frequencies_is_a_bump():
    runs, noise = 60, resonance(20.0, 20.0)
    # 5 s blocks: 1 Hz wide is 5 frequencies.
    found = [psd(noise(np.random.default_rng([17, run]), 5000), RATE) for run in range(runs)]
    assert sum(bool(one.lines) for one in found) <= 2
    assert np.median([bump.quality for one in found for bump in one.bumps]) == pytest.approx(20, rel=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("samples", [4096, 40_000])
def test_power_of_detection(samples):
    rng, hits, runs = np.random.default_rng(7), 0, 120
    for _ in range(runs):
        x, frequency = rng.normal(size=samples), 10 + 20 * rng.random()
        amplitude = float(psd(x, RATE).detectable_amplitude(frequency))
        found = psd(x + line(amplitude, frequency, samples, rng), RATE)
        hits += any(abs(one.frequency - frequency) < found.resolution for one in found.lines)
    # 90 %, with a standard error of 2.7 %.
    assert 0.81 <= hits / runs <= 0.98


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [2, 20])
def test_standard_errors_of_a_line(ratio):
    rng, errors, samples = np.random.default_rng(8), [], 20_000
    for _ in range(100):
        x, frequency = rng.normal(size=samples), 10 + 20 * rng.random()
        amplitude = ratio * float(psd(x, RATE).detectable_amplitude(frequency))
        (found,) = psd(x + line(amplitude, frequency, samples, rng), RATE).lines
        errors.append(
            (
                (found.frequency - frequency) / found.frequency_error,
                (found.amplitude - amplitude) / found.amplitude_error,
            )
        )
    scatter, bias = np.std(errors, axis=0), np.mean(errors, axis=0)
    assert np.all((scatter > 0.7) & (scatter < 1.2))
    assert np.all(np.abs(bias) < 0.3)


def test_a_line_that_wanders_is_one_line():
    rng, n = np.random.default_rng(9), 400_000
    # The frequency is a random walk within ± 0.02 Hz, 7 frequencies of the spectrum.
    frequency = 17.0 + 0.01 * np.sin(np.cumsum(rng.normal(size=n)) * 0.01)
    x = rng.normal(size=n) + 0.3 * np.sin(2 * np.pi * np.cumsum(frequency) / RATE)
    found = psd(x, RATE)
    (one,) = found.lines
    assert one.frequency == pytest.approx(17.0, abs=0.01)
    assert one.amplitude == pytest.approx(0.3, rel=0.1)
    assert not one.narrow
    assert 0.005 < one.width < 0.1


def test_a_line_that_wanders_far_is_one_line():
    rng, n = np.random.default_rng(10), 400_000
    frequency = 40.0 + 0.1 * np.sin(2 * np.pi * np.arange(n) / n * 5 + 0.1 * np.cumsum(rng.normal(size=n)))
    x = rng.normal(size=n) + 0.5 * np.sin(2 * np.pi * np.cumsum(frequency) / RATE)
    found = psd(x, RATE)
    (one,) = found.lines
    assert one.frequency == pytest.approx(40.0, abs=0.1)
    assert one.amplitude == pytest.approx(0.5, rel=0.15)
    assert found.bumps == ()


def test_harmonics_are_grouped():
    rng, n = np.random.default_rng(11), 200_000
    x = rng.normal(size=n) + line(0.2, 31.7, n, rng)
    x += sum(line(0.3 / k, k * 3.21, n, rng) for k in (1, 2, 3, 5))
    found = psd(x, RATE).lines
    assert [one.harmonic for one in found] == [1, 2, 3, 5, None]
    first = f"{found[0].frequency:.5g} Hz"
    assert [one.multiple for one in found] == [first, *(f"{k} × {first}" for k in (2, 3, 5)), ""]
    assert all(one.fundamental == found[0].frequency for one in found[:4])
    assert found[4].fundamental is None


def test_a_line_on_a_resonance_is_found():
    rng, n = np.random.default_rng(12), 200_000
    noise = resonance(20.0, 10.0)(rng, n)
    x = noise / noise.std() + line(0.2, 20.3, n, rng)
    found = psd(x, RATE)
    (one,) = found.lines
    assert one.frequency == pytest.approx(20.3, abs=0.01)
    assert one.amplitude == pytest.approx(0.2, rel=0.1)
    (bump,) = found.bumps
    assert bump.quality == pytest.approx(10, rel=0.2)


@pytest.mark.parametrize("frequency", [49.9, 0.1])
def test_a_line_close_to_an_end(frequency):
    rng, n = np.random.default_rng(13), 200_000
    x = rng.normal(size=n) + line(1.0, frequency, n, rng)
    (one,) = psd(x, RATE).lines
    assert one.frequency == pytest.approx(frequency, abs=3e-3)


def test_a_very_strong_line_is_one_line():
    rng, n = np.random.default_rng(14), 100_000
    x = rng.normal(size=n) + line(1e4, 12.3456, n, rng)
    (one,) = psd(x, RATE).lines
    assert one.frequency == pytest.approx(12.3456, abs=5 * one.frequency_error)
    assert one.amplitude == pytest.approx(1e4, rel=1e-3)


@pytest.mark.slow
def test_knocks_make_no_lines():
    runs, alarms = 100, 0
    for run in range(runs):
        rng = np.random.default_rng([15, run])
        x = rng.normal(size=33_000)
        begin = int(rng.integers(0, 32_000))
        x[begin : begin + 150] += 30 * rng.normal(size=150) * np.hanning(150)
        found = psd(x, RATE)
        alarms += bool(found.lines or found.bumps)
    assert alarms <= 5


def test_detectable_amplitude_falls_with_the_length():
    rng = np.random.default_rng(16)
    x = rng.normal(size=800_000)
    short, long = (psd(x[:n], RATE).detectable_amplitude([5.0, 30.0]) for n in (50_000, 800_000))
    # Sixteen times the length: the blocks are 16 times as long, and the amplitude falls by four.
    assert short / long == pytest.approx(4.0, rel=0.25)
    assert np.isnan(psd(x[:50_000], RATE).detectable_amplitude([0.01, 60.0])).all()


def test_a_line_that_is_found_twice_is_one():
    strong = Line(
        frequency=10.0, frequency_error=1e-4, amplitude=2.0, amplitude_error=0.1, width=0.0, height=50.0, p_value=0.0
    )
    twin, other = replace(strong, frequency=10.0004, amplitude=0.5), replace(strong, frequency=10.01, amplitude=0.5)
    assert distinct([twin, strong, other], resolution=0.0022) == [strong, other]
    assert distinct([replace(strong, width=0.1), other], resolution=0.0022) == [replace(strong, width=0.1)]
