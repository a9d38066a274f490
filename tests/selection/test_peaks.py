"""Terms for the peaks of a spectrum: which peaks are terms, and whose power is fitted; noise made with NumPy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

import gmwm
from gmwm import wavelet_variance
from gmwm.choosing.selection.fast_part import FELT, UNSEEN_DISTANCE, peak_terms
from gmwm.measuring.spectrum.line import Line
from gmwm.theory.processes.parameter import Fixed
from gmwm.theory.processes.sinusoid import SIN

RATE, SAMPLES = 100.0, 200_000


def with_lines(*lines, seed=5):
    """White noise with sinusoids of these frequencies (Hz) and amplitudes."""
    rng = np.random.default_rng(seed)
    t, x = np.arange(SAMPLES) / RATE, rng.normal(size=SAMPLES)
    return x + sum(amplitude * np.sin(2 * np.pi * frequency * t + rng.random()) for frequency, amplitude in lines)


def resonance(rng, frequency, quality, deviation):
    """Noise of a damped oscillator, sampled by the exact recursion of its autocovariance."""
    angle, radius = 2 * np.pi * frequency / RATE, np.exp(-np.pi * frequency / quality / RATE)
    x = signal.lfilter([1.0], [1, -2 * radius * np.cos(angle), radius**2], rng.normal(size=SAMPLES + 20_000))[20_000:]
    return deviation * x / x.std()


def terms_of(x):
    spectrum = gmwm.psd(x, RATE)
    return peak_terms(spectrum, wavelet_variance(x, rate=RATE), spectrum.bumps)


def planted(wv, frequencies, share):
    """A spectrum with lines that are this share of the wavelet variance at most."""
    spectrum = gmwm.psd(np.random.default_rng(1).normal(size=SAMPLES), RATE)
    lines = []
    for frequency in frequencies:
        unit = SIN(frequency=Fixed(frequency), power=Fixed(1.0)).wavelet_variance(wv.levels, RATE)
        power = share / float(np.max(unit / wv.variance))
        lines.append(
            Line(
                frequency=frequency, frequency_error=0.001, amplitude=np.sqrt(2 * power), amplitude_error=0.0,
                width=0.0, height=2.0, p_value=0.0,
            )
        )  # fmt: skip
    return replace(spectrum, lines=tuple(lines), bumps=())


@pytest.mark.slow
def test_only_the_strongest_line_has_a_free_power():
    terms = terms_of(with_lines((7.3, 0.3), (21.1, 0.2), (33.7, 0.25), (12.9, 0.035)))
    assert sorted(round(line.value("frequency"), 1) for line in terms) == [7.3, 21.1, 33.7]
    assert [line.is_fixed("power") for line in terms] == [False, True, True]
    assert all(line.is_fixed("frequency") for line in terms)


@pytest.mark.parametrize(("samples", "share", "count"), [(20_000_000, 0.0035, 1), (20_000_000, 0.0025, 0)])
def test_a_peak_is_measured_from_a_share_of_the_curve_on(samples, share, count):
    curve = 2.0 ** -np.arange(1, 15)
    wv = gmwm.WaveletVariance.from_values(curve, samples=samples, rate=RATE)
    assert FELT == 0.003
    assert len(peak_terms(planted(wv, [7.3], share), wv, ())) == count


@pytest.mark.parametrize(("distance", "count"), [(0.8, 0), (1.3, 1)])
def test_a_peak_is_a_term_if_it_changes_the_curve_by_a_standard_error(distance, count):
    wv = gmwm.WaveletVariance.from_values(2.0 ** -np.arange(1, 15), samples=100_000, rate=RATE)
    unit = SIN(frequency=Fixed(7.3), power=Fixed(1.0)).wavelet_variance(wv.levels, RATE) / wv.variance
    share = distance * unit.max() / np.linalg.norm(unit * np.sqrt(wv.degrees_of_freedom / 2))
    assert UNSEEN_DISTANCE == 1.0
    assert len(peak_terms(planted(wv, [7.3], share), wv, ())) == count


def test_weak_peaks_are_left_out_only_while_their_sum_is_unseen():
    wv = gmwm.WaveletVariance.from_values(2.0 ** -np.arange(1, 15), samples=100_000, rate=RATE)
    unit = SIN(frequency=Fixed(7.3), power=Fixed(1.0)).wavelet_variance(wv.levels, RATE) / wv.variance
    share = 0.4 * unit.max() / np.linalg.norm(unit * np.sqrt(wv.degrees_of_freedom / 2))
    frequencies = [7.3, 7.4, 7.5, 7.6]
    counts = [len(peak_terms(planted(wv, frequencies[:k], share), wv, ())) for k in range(1, 5)]
    assert counts == [0, 0, 1, 1]


@pytest.mark.slow
def test_the_power_of_sidebands_is_added_to_the_line_beside_them():
    """A strong line that varies has weak neighbours, which no scale separates from it."""
    lines = (9.0, 0.2), (9.4, 0.06), (8.6, 0.06), (33.0, 0.9)
    terms = {round(term.value("frequency")): term for term in terms_of(with_lines(*lines))}
    assert sorted(terms) == [9, 33]
    assert not terms[33].is_fixed("power")
    assert terms[9].value("power") == pytest.approx((0.2**2 + 2 * 0.06**2) / 2, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(("deviation", "free"), [(1.0, [False, False]), (0.25, [False, True])])
def test_a_power_is_fitted_if_the_curve_determines_it_better_than_the_spectrum(deviation, free):
    rng = np.random.default_rng(3)
    x = rng.normal(size=SAMPLES) + resonance(rng, 12.0, 15.0, deviation) + resonance(rng, 1.5, 12.0, 1.5)
    terms = sorted(terms_of(x), key=lambda term: term.value("frequency"))
    assert [term.value("frequency") for term in terms] == pytest.approx([1.5, 12.0], rel=0.05)
    assert [term.is_fixed("sigma2") for term in terms] == free
