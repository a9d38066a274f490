"""The search for a model: simple noise, the filters of sensors, resonances and lines, made with NumPy and SciPy."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal

import gmwm
from gmwm import Model, wavelet_variance
from gmwm.choosing.datasheets import datasheet
from gmwm.choosing.selection.api import select_within
from gmwm.choosing.selection.ranking import SEARCH_PVALUE, SLOW, RankingOptions, SearchStep
from gmwm.choosing.selection.search import LOW_ORDER, _is_accepted, search, within_family
from gmwm.choosing.selection.structure import freedom, largest_within
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


def density_of_all(found):
    """The root of the density per sample at low frequencies of all terms without the walk and the oscillators."""
    processes = found.ranking.recommended.fit.model.processes
    return np.sqrt(sum(p.psd([1e-3], RATE)[0] * RATE for p in processes if p.scale > 0 and p.name not in ("OSC", "RW")))


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
    assert found.ranking.recommended.pvalue > SEARCH_PVALUE
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
    assert recommended.pvalue > SEARCH_PVALUE
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
    (oscillator,) = (p for p in found.ranking.recommended.fit.model.processes if p.name == "OSC")
    assert oscillator.value("frequency") == pytest.approx(angle / (2 * np.pi) * RATE, rel=0.01)
    assert not any(name.startswith("ARMA") for name in names(found))
    total = np.hypot(density(found), np.sqrt(oscillator.psd([1e-6], RATE)[0] * RATE))
    assert total == pytest.approx(np.sqrt(1 + 0.09 / np.sum(back) ** 2), rel=0.015)


def resonance(rng, n, frequency, quality, deviation):
    angle, radius = 2 * np.pi * frequency / RATE, np.exp(-np.pi * frequency / quality / RATE)
    x = filtered([1.0], [1, -2 * radius * np.cos(angle), radius**2], rng, n)
    return deviation * x / x.std()


SIMPLE_FILTERS = {"two samples": ([0.85, 0.15], [1.0]), "one pole": ([0.8], [1, -0.2])}


@pytest.mark.slow
@pytest.mark.parametrize("which", list(SIMPLE_FILTERS))
@pytest.mark.parametrize("frequencies", [(12.0,), (0.6, 12.0), (0.6, 1.8, 23.0)])
def test_a_simple_filter_with_resonances_has_a_simple_shape_and_oscillators(which, frequencies):
    rng, n = np.random.default_rng(7), 300_000
    x = filtered(*SIMPLE_FILTERS[which], rng, n) + walk(rng, n)
    for frequency in frequencies:
        x = x + resonance(rng, n, frequency, 14.0, 0.3)
    found = searched(x)
    model = found.ranking.recommended.fit.model
    oscillators = [p for p in model.processes if p.name == "OSC"]
    assert sorted(p.value("frequency") for p in oscillators) == pytest.approx(frequencies, rel=0.05)
    shapes = [p for p in model.processes if p.name.startswith(("AR", "MA"))]
    assert all(len(shape.nonlinear) <= 2 * LOW_ORDER for shape in shapes)
    assert density_of_all(found) == pytest.approx(1.0, rel=0.02)


@pytest.mark.slow
def test_a_shape_of_high_order_contains_the_wide_peaks():
    rng, n = np.random.default_rng(7), 300_000
    x = filtered(np.array([1, 2, 2, 2, 2, 1]) / 10, [1.0], rng, n) + walk(rng, n) + resonance(rng, n, 6.0, 9.0, 0.2)
    found = searched(x)
    (shape,) = (p for p in found.ranking.recommended.fit.model.processes if p.name.startswith(("AR", "MA")))
    assert max(int(order) for order in shape.name.strip("ARM()").split(",")) > LOW_ORDER
    assert "OSC" not in names(found)
    assert density_of_all(found) == pytest.approx(1.0, rel=0.02)


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
def test_a_line_is_a_sinusoid_or_an_oscillator_of_known_frequency(wandering):
    rng, n = np.random.default_rng(3), 200_000
    frequency = 17.3 + wandering * 0.01 * np.sin(np.cumsum(rng.normal(size=n)) * 0.01)
    phase = 2 * np.pi * np.cumsum(np.broadcast_to(frequency, n)) / RATE
    found = searched(rng.normal(size=n) + 0.6 * np.sin(phase) + walk(rng, n))
    assert names(found) == (["OSC", "RW", "WN"] if wandering else ["RW", "SIN", "WN"])
    (line,) = (p for p in found.ranking.recommended.fit.model.processes if p.name in ("OSC", "SIN"))
    assert line.is_fixed("frequency")
    assert line.value("frequency") == pytest.approx(17.3, abs=0.02)
    assert line.scale == pytest.approx(0.18, rel=0.1 if wandering else 0.05)
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


# --- the steps ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("pvalue", "accepted"), [(0.0022, True), (0.0018, False), (None, True)])
def test_the_level_at_which_the_search_goes_on(pvalue, accepted):
    assert _is_accepted(SimpleNamespace(recommended=SimpleNamespace(pvalue=pvalue))) is accepted


def test_a_true_model_with_a_small_p_value_ends_the_search():
    """p = 0.018 occurs in 2 % of recordings of the model."""
    rng, n = np.random.default_rng(16), 4000
    found = search(wavelet_variance(rng.normal(size=n) + walk(rng, n, 0.02), rate=RATE), None, OPTIONS)
    (step,) = found.steps
    assert (step.entered, step.left, step.used, step.model_error) == ("slow", "accepted", True, 0.0)
    assert 0.01 < step.pvalue < 0.03
    assert step.bound > step.pvalue
    assert step.recommended == found.ranking.recommended.structure


@pytest.mark.slow
def test_the_steps_say_why_each_family_was_entered_and_left():
    rng, n = np.random.default_rng(3), 100_000
    line = 0.6 * np.sin(2 * np.pi * 17.3 * np.arange(n) / RATE)
    with_line = searched(rng.normal(size=n) + line + walk(rng, n))
    assert [(s.entered, s.left, s.used) for s in with_line.steps] == [
        ("slow", "all-rejected", False), ("lines", "accepted", True),
    ]  # fmt: skip
    assert with_line.steps[0].bound < SEARCH_PVALUE <= with_line.steps[1].bound
    assert with_line.steps[0].recommended is None
    resonant = searched(filtered(*FILTERS["Butterworth 2"], rng, n) + line)
    assert [(s.entered, s.used) for s in resonant.steps] == [("slow", False), ("lines", False), ("shape", True)]
    complex_filter = searched(filtered(np.array([1, 2, 2, 2, 2, 1]) / 10, [1.0], rng, n))
    assert [s.entered for s in complex_filter.steps][-2:] == ["shape", "shape"]
    assert complex_filter.steps[-2].left == "all-rejected"
    assert complex_filter.steps[-1].used
    plain = searched(filtered(*FILTERS["Butterworth 2"], rng, n), spectrum=False)
    assert [s.entered for s in plain.steps] == ["slow", "shape"]
    given = within_family("WN + RW", plain.wavelet_variance, OPTIONS).steps
    assert [(s.entered, s.left, s.family) for s in given] == [("within", "model-error", "WN + RW")]
    assert given[0].model_error > 0.1
    for step in (*with_line.steps, *resonant.steps, *given):
        assert SearchStep.from_dict(json.loads(json.dumps(step.to_dict()))) == step
        assert step.text().startswith(f"{step.family}: ")
        assert ("gives the model of the axis." in step.text()) is step.used


@pytest.mark.slow
def test_a_possible_filter_is_a_step():
    rng = np.random.default_rng(8)
    wide = filtered(*signal.butter(1, 2 * 0.25 / 4), rng, 120_000)[::4]
    found = searched(wide + walk(rng, wide.size))
    assert [(s.entered, s.left, s.used) for s in found.steps] == [
        ("slow", "filter-possible", False), ("filter", "accepted", True),
    ]  # fmt: skip


@pytest.mark.slow
def test_a_step_that_may_have_a_filter_is_not_called_rejected():
    rng, n = np.random.default_rng(1), 60_000
    wide = filtered(*signal.iirpeak(9.0, 3, fs=RATE), rng, n)
    found = searched(rng.normal(size=n) + markov(rng, n, 0.03, 0.8) + walk(rng, n, 1e-3) + 0.3 * wide)
    assert [(s.entered, s.left) for s in found.steps] == [
        ("slow", "filter-possible"), ("filter", "filter-possible"), ("filter", "accepted"),
    ]  # fmt: skip
    assert all(step.pvalue >= SEARCH_PVALUE for step in found.steps)


@pytest.mark.slow
def test_a_family_before_an_oscillation_is_not_called_the_last():
    rng, n = np.random.default_rng(4), 200_000
    slow = 0.12 * np.sin(2 * np.pi * np.arange(n) / RATE / 110)
    found = searched(rng.normal(size=n) + walk(rng, n, 1e-3) + slow, spectrum=False)
    assert [(s.entered, s.left) for s in found.steps] == [
        ("slow", "rejected"), ("nothing-shown", "rejected"), ("oscillation", "accepted"),
    ]  # fmt: skip


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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("truth", "left"),
    [
        # An AR(2) that the largest model estimates as zero was kept, and hid the oscillation.
        (
            "GM(beta=1.3, sigma2=9e-8) + QN(q2=4.6e-7) + RW(gamma2=2.2e-12) "
            "+ OSC(frequency=0.022, quality=5.1, sigma2=4.5e-8)",
            "terms-absent",
        ),
        # Two GM describe flicker noise too badly to find an oscillation beside it.
        ("WN(sigma2=1e-6) + FN(b2=2.4e-8) + OSC(frequency=0.0065, quality=3.2, sigma2=3.5e-8)", "accepted"),
        ("QN(q2=9.4e-8) + FN(b2=1.1e-9) + OSC(frequency=0.0032, quality=11.0, sigma2=9.0e-9)", "accepted"),
    ],
)
def test_a_slow_oscillation_is_found_in_a_curve(truth, left):
    truth = Model.parse(truth)
    values = truth.wavelet_variance(20, RATE)
    wv = gmwm.WaveletVariance.from_values(values, rate=RATE, samples=3_300_000, axis="gyro_x", unit="rad/s")
    found = search(wv, None, OPTIONS)
    recommended = found.ranking.recommended.fit
    assert [p.name for p in recommended.model.processes] == [p.name for p in truth.processes]
    np.testing.assert_allclose(recommended.implied, values, rtol=1e-2)
    assert left in [step.left for step in found.steps]


@pytest.mark.parametrize("seed", [2, 29])
def test_a_ramp_whose_levels_are_off_does_not_hide_the_noise(seed):
    """Beside the small errors of such levels, weights of a poor fit make a ramp without noise the best model."""
    truth = Model.parse("QN(q2=4e-6) + DR(omega=1e-9)")
    values = truth.wavelet_variance(21, 200.0) * np.exp(0.03 * np.random.default_rng(seed).standard_normal(21))
    wv = gmwm.WaveletVariance.from_values(values, rate=200.0, samples=5_000_000, axis="gyro_x", unit="rad/s")
    found = search(wv, None, OPTIONS)
    assert names(found) == ["DR", "QN"]
    assert 0.02 < found.error < 0.04


def test_the_largest_sum_has_no_more_parameters_than_levels(curve):
    assert largest_within("GM + WN", curve).structure == "GM + WN"
    short = curve.first(5)
    for required in ((), (SIN(frequency=gmwm.fixed(17.3)),)):
        whole = largest_within(SLOW, short, required)
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
