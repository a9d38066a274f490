"""The search for a model: simple noise, the filters of sensors, resonances and lines, made with NumPy and SciPy."""

import numpy as np
import pytest
from scipy import signal

import gmwm
from gmwm import Model, wavelet_variance
from gmwm.choosing.datasheets import datasheet
from gmwm.choosing.selection.api import select_within
from gmwm.choosing.selection.options import SLOW, RankingOptions
from gmwm.choosing.selection.search import FELT, MOST_FREE, REJECTED, _largest, _lines, search, within_family
from gmwm.choosing.selection.structure import freedom
from gmwm.theory.processes.sinusoid import SIN

RATE = 100.0
OPTIONS = RankingOptions(draws=200)


def walk(rng, n, size=2e-3):
    return size * np.cumsum(rng.normal(size=n))


def filtered(forward, back, rng, n):
    return signal.lfilter(forward, back, rng.normal(size=n + 2000))[2000:]


def markov(rng, n, seconds, deviation):
    phi = np.exp(-1 / (seconds * RATE))
    return filtered([deviation * np.sqrt(1 - phi**2)], [1, -phi], rng, n)


def searched(x, spectrum=True):
    return search(wavelet_variance(x, rate=RATE), gmwm.psd(x, RATE) if spectrum else None, OPTIONS)


def density(found):
    """N (u·√s) at a rate of 1: the root of the density per sample at low frequencies."""
    processes = found.ranking.recommended.fit.model.processes
    squares = [p.value**2 * RATE for one in processes if one.scale > 0 for p in one.physical(RATE) if p.symbol == "N"]
    return np.sqrt(sum(squares))


def names(found):
    return sorted(process.name for process in found.ranking.recommended.model.processes)


@pytest.mark.slow
def test_simple_noise_is_found_without_the_spectrum():
    rng, n = np.random.default_rng(1), 200_000
    x = rng.normal(size=n) + markov(rng, n, 1.0, 0.3) + walk(rng, n)
    found = searched(x)
    assert found.ranking.recommended.structure == "GM + WN + RW"
    assert (found.error, found.tried) == (0.0, (SLOW,))
    assert found.with_error.model_error == 0.0
    assert found.ranking.recommended.pvalue > REJECTED
    assert all("SIN" not in one.structure and "ARMA" not in one.structure for one in found.ranking)


FILTERS = {
    "Butterworth 1": signal.butter(1, 0.5),
    "Butterworth 2": signal.butter(2, 0.4),
    "average of 4": (np.ones(4) / 4, [1.0]),
    "FIR": (signal.firwin(9, 0.5), [1.0]),
}


@pytest.mark.slow
@pytest.mark.parametrize("which", list(FILTERS))
def test_a_filter_is_found_with_its_density(which):
    rng, n = np.random.default_rng(3), 200_000
    found = searched(filtered(*FILTERS[which], rng, n) + walk(rng, n))
    recommended = found.ranking.recommended
    assert "RW" in names(found)
    (shape,) = (p for p in recommended.model.processes if p.name.startswith(("AR", "MA")))
    assert found.tried[0] == SLOW
    assert shape.name in found.tried[-1]
    assert recommended.pvalue > REJECTED
    # Of 200 000 samples, N is known to about 0.5 %.
    assert density(found) == pytest.approx(1.0, rel=0.01)


@pytest.mark.slow
def test_a_filter_below_heavy_slow_noise():
    rng, n = np.random.default_rng(3), 200_000
    x = filtered(*signal.butter(2, 0.6), rng, n) + markov(rng, n, 5.0, 3.0) + walk(rng, n, 0.01)
    found = searched(x)
    assert any(name.startswith(("AR", "MA")) for name in names(found))
    assert density(found) == pytest.approx(1.0, rel=0.02)


@pytest.mark.slow
def test_a_resonance():
    rng, n = np.random.default_rng(3), 200_000
    radius, angle = 0.93, 1.2
    back = [1, -2 * radius * np.cos(angle), radius**2]
    found = searched(rng.normal(size=n) + filtered([0.3], back, rng, n) + walk(rng, n))
    (shape,) = (p for p in found.ranking.recommended.fit.model.processes if p.name.startswith("ARMA"))
    numbers = {one.symbol: one.value for one in shape.physical(RATE)}
    assert numbers["f_r"] == pytest.approx(angle / (2 * np.pi) * RATE, rel=0.01)
    assert density(found) == pytest.approx(np.sqrt(1 + 0.09 / np.sum(back) ** 2), rel=0.015)


@pytest.mark.slow
def test_a_first_order_filter_is_not_a_gauss_markov_process():
    """The wavelet variance accepts a fast Gauss-Markov process in its place, with N 0.5 % too large."""
    rng = np.random.default_rng(8)
    wide = filtered(*signal.butter(1, 2 * 0.25 / 4), rng, 1_200_000)[::4]
    found = searched(wide + walk(rng, wide.size))
    assert len(found.tried) == 2
    assert not any(name.startswith("GM") for name in names(found))
    folded = np.abs(signal.freqz(*signal.butter(1, 2 * 0.25 / 4), worN=2 * np.pi * np.arange(4) / 4)[1]) ** 2
    assert density(found) == pytest.approx(np.sqrt(folded.mean()), rel=0.006)


@pytest.mark.slow
@pytest.mark.parametrize("wandering", [False, True])
def test_a_line_is_a_sinusoid_of_known_frequency(wandering):
    rng, n = np.random.default_rng(3), 200_000
    frequency = 17.3 + wandering * 0.01 * np.sin(np.cumsum(rng.normal(size=n)) * 0.01)
    phase = 2 * np.pi * np.cumsum(np.broadcast_to(frequency, n)) / RATE
    found = searched(rng.normal(size=n) + 0.6 * np.sin(phase) + walk(rng, n))
    assert names(found) == ["RW", "SIN", "WN"]
    (line,) = (p for p in found.ranking.recommended.fit.model.processes if p.name == "SIN")
    assert line.is_fixed("frequency")
    assert line.value("frequency") == pytest.approx(17.3, abs=0.02)
    assert line.value("power") == pytest.approx(0.18, rel=0.05)
    assert density(found) == pytest.approx(1.0, rel=0.01)


@pytest.mark.slow
def test_without_a_spectrum_an_autoregression_is_fitted():
    rng, n = np.random.default_rng(3), 200_000
    found = searched(filtered(*FILTERS["Butterworth 2"], rng, n) + walk(rng, n), spectrum=False)
    (shape,) = (p for p in found.ranking.recommended.model.processes if p.name.startswith("AR"))
    assert shape.name == "AR(2)"
    assert shape.is_fixed("phi1")
    assert not shape.is_fixed("sigma2")
    # A Gauss-Markov process describes a part of it; N is the density of both.
    sheet = datasheet(found.ranking.recommended.fit, 0.95)
    assert sheet["N"].value * np.sqrt(RATE) == pytest.approx(1.0, rel=0.06)
    # The shape is that of a part of the noise only: white and quantization noise may be beside it.
    assert found.tried[-1] == f"{SLOW} + AR(2)"


@pytest.mark.slow
def test_weak_lines_are_left_out_and_only_the_strongest_has_a_free_power():
    rng, n = np.random.default_rng(5), 200_000
    t, x = np.arange(n) / RATE, np.random.default_rng(5).normal(size=200_000)
    for frequency, amplitude in ((7.3, 0.3), (21.1, 0.2), (33.7, 0.25), (12.9, 0.035)):
        x = x + amplitude * np.sin(2 * np.pi * frequency * t + rng.random())
    spectrum, wv = gmwm.psd(x, RATE), wavelet_variance(x, rate=RATE)
    assert len(spectrum.lines) == 4
    lines = _lines(spectrum, wv)
    assert len(lines) == 3
    assert [line.is_fixed("power") for line in lines] == [k >= MOST_FREE for k in range(3)]
    assert all(line.is_fixed("frequency") for line in lines)
    curve = [line.wavelet_variance(wv.levels, RATE) for line in lines[MOST_FREE:]]
    assert all((one / wv.variance).max() >= FELT for one in curve)


# --- parts --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def curve():
    rng, n = np.random.default_rng(1), 20_000
    return wavelet_variance(rng.normal(size=n) + walk(rng, n, 0.02), rate=RATE)


def test_required_terms_are_in_every_candidate(curve):
    line = SIN(frequency=gmwm.fixed(17.3))
    ranking = select_within("GM + WN + RW", curve, OPTIONS, required=(line,))
    assert len(ranking) == 2**3
    assert all(any(p.name == "SIN" for p in one.model.processes) for one in ranking)
    assert all(p.is_fixed("frequency") for one in ranking for p in one.model.processes if p.name == "SIN")
    assert len({one.structure for one in ranking}) == len(ranking)
    without = select_within("GM + WN + RW", curve, OPTIONS)
    assert len(without) == 2**3 - 1


@pytest.mark.slow
def test_a_line_whose_power_is_zero_is_left_out(curve):
    one, other = (SIN(frequency=gmwm.fixed(f)) for f in (11.1, 23.4567))
    zero = select_within("GM + WN + RW", curve, OPTIONS, required=[one]).recommended.fit
    assert zero.model.processes[-1].scale == 0
    sums = [within_family("GM + WN + RW", curve, OPTIONS, required=lines) for lines in ((one,), (one, other))]
    for found in sums:
        fit = found.ranking.recommended.fit
        assert all(p.scale > 0 for p in fit.model.processes)
        assert found.tried[-1].startswith("GM + WN + RW")
    with_line = wavelet_variance(curve_with_line(17.3, 0.2), rate=RATE)
    found = within_family("WN + RW", with_line, OPTIONS, required=[SIN(frequency=gmwm.fixed(17.3))])
    assert "SIN" in found.ranking.recommended.structure


def curve_with_line(frequency, amplitude):
    rng, n = np.random.default_rng(1), 20_000
    line = amplitude * np.sin(2 * np.pi * frequency * np.arange(n) / RATE)
    return rng.normal(size=n) + walk(rng, n, 0.02) + line


def test_the_largest_sum_has_no_more_parameters_than_levels(curve):
    assert _largest("GM + WN", curve).structure == "GM + WN"
    short = curve.first(5)
    for required in ((), (SIN(frequency=gmwm.fixed(17.3)),)):
        whole = _largest(SLOW, short, required)
        assert freedom(whole) <= 5
        assert freedom(whole) >= 4
        assert all(process in whole.processes for process in required)


def test_a_sum_that_the_user_gives_has_its_model_error():
    rng, n = np.random.default_rng(3), 200_000
    x = filtered(*FILTERS["Butterworth 2"], rng, n) + walk(rng, n)
    found = within_family("WN + RW", wavelet_variance(x, rate=RATE), OPTIONS)
    assert found.error > 0.1
    assert found.with_error.model_error == found.error
    assert found.wavelet_variance.model_error == 0.0
    right = within_family("WN + RW", wavelet_variance(rng.normal(size=n) + walk(rng, n), rate=RATE), OPTIONS)
    assert right.error == 0.0


def test_the_search_can_be_stopped(curve):
    class Stop(Exception):
        pass

    def stop():
        raise Stop

    with pytest.raises(Stop):
        search(curve, None, OPTIONS, check=stop)
    assert Model.parse(SLOW).structure
