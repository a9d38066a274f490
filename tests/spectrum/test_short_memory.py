"""ARMA processes fitted to power spectral densities: filters, moving averages and resonances, with known densities."""

import numpy as np
import pytest
from scipy import optimize, signal

from gmwm import psd
from gmwm.base import _core
from gmwm.measuring.spectrum import short_memory as fits
from gmwm.measuring.spectrum.short_memory import (
    FACTOR_PRIOR,
    LARGEST_BEND,
    LARGEST_ERROR_AT_ZERO,
    LEAST_ORDER_WEIGHT,
    POLE,
    STOP_BAND,
    _add_roots,
    _ArmaPoint,
    _bend,
    _Data,
    _descend,
    _inside,
    _starts,
    short_memory,
)

RATE = 100.0
HALF = RATE / 2
LOWEST = 0.8
"""Hz: below it, slow noise hides the density."""


def resonator(frequency, quality):
    radius, angle = np.exp(-np.pi * frequency / quality / RATE), 2 * np.pi * frequency / RATE
    return [1.0], [1.0, -2 * radius * np.cos(angle), radius**2]


FILTERS = {
    "Butterworth 1, 30 Hz": signal.butter(1, 30 / HALF),
    "Butterworth 1, 10 Hz": signal.butter(1, 10 / HALF),
    "Butterworth 2, 30 Hz": signal.butter(2, 30 / HALF),
    "Butterworth 2, 10 Hz": signal.butter(2, 10 / HALF),
    "Butterworth 4, 20 Hz": signal.butter(4, 20 / HALF),
    "average of 2": (np.ones(2) / 2, [1.0]),
    "average of 4": (np.ones(4) / 4, [1.0]),
    "FIR": (signal.firwin(9, 0.5), [1.0]),
    "resonance 20 Hz": resonator(20.0, 5.0),
    "resonance 7 Hz": resonator(7.0, 10.0),
    "white": ([1.0], [1.0]),
}
"""Numerator and denominator."""


def measured(which, seed, degrees=600, slow=0.0):
    """Frequencies, a density with the scatter of a chi-square average, its truth, and the part of slow noise."""
    rng, frequencies = np.random.default_rng(seed), np.geomspace(LOWEST, HALF * 0.999, 250)
    truth = np.abs(signal.freqz(*FILTERS[which], frequencies, fs=RATE)[1]) ** 2
    known = slow * (LOWEST / frequencies) ** 2
    eta = np.full(frequencies.size, float(degrees))
    return frequencies, (truth + known) * rng.chisquare(degrees, frequencies.size) / degrees, eta, known


def fitted(which, seed, **options):
    frequencies, density, eta, known = measured(which, seed, **options)
    return short_memory(frequencies, density, eta, rate=RATE, known=known)


def true_density(which):
    forward, back = FILTERS[which]
    return (np.sum(forward) / np.sum(back)) ** 2


@pytest.mark.slow
@pytest.mark.parametrize("which", list(FILTERS))
def test_the_density_at_the_frequency_zero_is_right_within_one_per_cent(which):
    found = [fitted(which, seed, degrees=20_000) for seed in range(2)]
    assert [one.density / true_density(which) for one in found] == pytest.approx([1.0, 1.0], abs=0.01)
    assert all(one.misfit < 1.5 for one in found)


@pytest.mark.parametrize("which", ["Butterworth 2, 30 Hz", "average of 2", "resonance 20 Hz"])
def test_slow_noise_that_is_known_does_not_matter(which):
    assert fitted(which, 1, degrees=20_000, slow=0.9).density == pytest.approx(true_density(which), rel=0.015)


@pytest.mark.slow
def test_slow_noise_that_is_known_badly_does_not_matter():
    frequencies, density, eta, known = measured("Butterworth 2, 10 Hz", 1, degrees=2_000, slow=0.9)
    found = short_memory(frequencies, density, eta, rate=RATE, known=known / 3)
    assert found.density == pytest.approx(true_density("Butterworth 2, 10 Hz"), rel=0.05)
    assert found.misfit < 1.5


@pytest.mark.slow
def test_few_degrees_of_freedom_do_not_make_the_density_too_small():
    found = [fitted("white", seed, degrees=20).innovation for seed in range(10)]
    # The mean logarithm of an estimate is 1/η = 5 % too small; the mean of ten fits is known to 0.6 %.
    assert np.mean(found) == pytest.approx(1.0, abs=0.02)


def test_other_orders_are_reported_with_their_weights():
    found = fitted("FIR", 2, degrees=2_000)
    assert found.alternatives
    assert all(LEAST_ORDER_WEIGHT <= other.weight < 1 for other in found.alternatives)
    assert sum(other.weight for other in found.alternatives) < 1
    orders = {(other.phi.size, other.theta.size) for other in found.alternatives}
    assert (found.phi.size, found.theta.size) not in orders
    assert all(other.density == pytest.approx(true_density("FIR"), rel=0.1) for other in found.alternatives)


@pytest.mark.slow
def test_if_no_order_near_the_best_is_sure_a_smaller_one_is_used(monkeypatch):
    # The best orders of this filter have 4 coefficients or more.
    monkeypatch.setattr(fits, "_error_at_zero", lambda point, data: 0.01 if point.order <= 2 else 1.0)
    found = fitted("Butterworth 4, 20 Hz", 1, degrees=20_000)
    assert 1 <= found.phi.size + found.theta.size <= 2


@pytest.mark.slow
def test_white_noise_has_no_roots():
    found = [fitted("white", seed) for seed in range(10)]
    # log(250) = 5.5 for a coefficient; one or two more roots by chance are rare.
    assert sum(one.phi.size + one.theta.size == 0 for one in found) >= 9
    one = next(one for one in found if one.phi.size + one.theta.size == 0)
    assert one.innovation == pytest.approx(1.0, rel=0.02)
    assert one.covariance.shape == (0, 0)


def test_orders_are_those_of_the_filter():
    first = fitted("Butterworth 1, 30 Hz", 3, degrees=20_000)
    assert (first.phi.size, first.theta.size) == (1, 1)
    assert first.phi[0] == pytest.approx(-FILTERS["Butterworth 1, 30 Hz"][1][1], abs=0.01)
    peak = fitted("resonance 20 Hz", 3)
    assert (peak.phi.size, peak.theta.size) == (2, 0)
    np.testing.assert_allclose(-peak.phi, FILTERS["resonance 20 Hz"][1][1:], atol=0.02)


@pytest.mark.slow
def test_the_covariance_is_the_scatter_of_the_coefficients():
    found = [fitted("resonance 20 Hz", seed) for seed in range(20)]
    found = [one for one in found if (one.phi.size, one.theta.size) == (2, 0)]
    assert len(found) >= 15
    scatter = np.cov([one.phi for one in found], rowvar=False)
    stated = np.mean([one.covariance for one in found], axis=0)
    # 0.005 is assumed beside the scatter, so that the stated errors are slightly larger.
    assert np.sqrt(np.diag(scatter) / np.diag(stated)) == pytest.approx([0.95, 0.95], abs=0.4)


@pytest.mark.slow
def test_a_recording_through_a_low_pass():
    rng = np.random.default_rng(8)
    x = signal.lfilter(*FILTERS["Butterworth 2, 30 Hz"], rng.normal(size=401_000))[1000:]
    found = psd(x, RATE).smoothed()
    used = found.frequencies > LOWEST
    shape = short_memory(
        found.frequencies[used], found.density[used] * RATE / 2, found.degrees_of_freedom[used], rate=RATE,
        known=np.zeros(int(used.sum())),
    )  # fmt: skip
    assert shape.density == pytest.approx(1.0, rel=0.01)
    assert shape.misfit < 1.5


# --- parts --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tail", [[-2.5], [0.3, 1.7], [-1.2, 3.0, 0.5, -0.2]])
def test_roots_inside_the_unit_circle_keep_the_size_on_it(tail):
    inner, gain = _inside(np.array(tail), 1.0)
    assert np.abs(np.roots([1.0, *inner])).max() < 1
    waves = np.exp(-1j * np.outer(np.linspace(0, np.pi, 50), np.arange(len(tail) + 1)))
    before, after = (np.abs(waves @ np.concatenate([[1.0], some])) ** 2 for some in (tail, inner))
    np.testing.assert_allclose(np.exp(gain) * after, before, rtol=1e-9)


def test_roots_near_the_unit_circle_are_moved_to_the_limit():
    inner, gain = _inside(np.array([-2 * 0.999 * np.cos(0.3), 0.999**2]), POLE)
    np.testing.assert_allclose(np.abs(np.roots([1.0, *inner])), POLE)
    assert gain == 0
    np.testing.assert_allclose(np.abs(np.angle(np.roots([1.0, *inner]))), 0.3)


def test_more_roots_are_where_they_are_asked_for():
    whole = np.concatenate([[1.0], _add_roots(np.array([-0.5]), 3, 1.0, 0.8)])
    expected = [0.5, 0.8 * np.exp(1j), 0.8 * np.exp(-1j), 0.8]
    for root in expected:
        assert abs(np.polyval(whole, root)) < 1e-12


def some_data():
    frequencies, density, eta, known = measured("resonance 20 Hz", 4, slow=0.3)
    angles, weights = 2 * np.pi * frequencies / RATE, 1 / (2 / eta + 25e-6)
    return _Data.of(angles, known=known, floor=STOP_BAND, logs=np.log(density), weights=weights)


def test_the_jacobian_is_that_of_finite_differences():
    data, step = some_data(), 1e-6
    at = np.array([0.1, -0.4, 0.5, 0.3, 0.2])

    def point(at):
        return _ArmaPoint(data=data, a=at[1:3], b=at[3:4], scale=at[0], slow=at[4])

    here = point(at)
    for k in range(5):
        moved = at.copy()
        moved[k] += step
        there = point(moved)
        # `left` is data minus model.
        np.testing.assert_allclose((here.residuals - there.residuals) / step, here.jacobian[:, k], atol=1e-4)


def test_every_descent_ends_no_higher_and_with_stable_roots():
    data = some_data()
    white = _descend(data, np.zeros(0), np.zeros(0), 0.0)
    starts = list(_starts(data, white, (2, 2)))
    assert len(starts) >= 5
    for start in starts:
        end = _descend(data, *start, white.scale)
        assert np.abs(np.roots([1.0, *end.a])).max() <= POLE + 1e-9
        assert np.abs(np.roots([1.0, *end.b])).max() <= 1
    assert min(_descend(data, *start, white.scale).loss for start in starts) < white.loss / 10


@pytest.mark.parametrize("free", [False, True])
def test_the_descent_ends_at_the_optimum_of_another_program(free):
    data = some_data()
    start = np.array([0.0, -0.4, 0.6, 0.1, 0.0])

    def residuals(at):
        point = _ArmaPoint(data=data, a=at[1:3], b=at[3:4], scale=at[0], slow=at[4] if free else 0.0)
        return np.append(np.sqrt(data.weights) * point.residuals, point.slow / FACTOR_PRIOR)

    best = optimize.least_squares(residuals, start, method="lm", xtol=1e-12, ftol=1e-12)
    at = start.copy()
    loss = _core.spectral_descent(
        data.waves, data.rows, floor=data.floor, prior=FACTOR_PRIOR, p=2, free=free, steps=100, near=0.0, parameters=at
    )
    assert loss == pytest.approx(2 * best.cost, rel=1e-9)
    assert loss == pytest.approx(_ArmaPoint(data=data, a=at[1:3], b=at[3:4], scale=at[0], slow=at[4]).loss, rel=1e-12)
    assert (at[4] != 0) == free


@pytest.mark.parametrize("tail", [[0.5], [-1.01], [-1.6, 0.8], [0.3, 1.7], [-1.2, 3.0, 0.5, -0.2], [0.1, 0, 0, 0.9]])
def test_whether_roots_are_inside_a_circle(tail):
    size = np.abs(np.roots([1.0, *tail])).max()
    for most in (0.8 * size, 0.999 * size, 1.001 * size, 1.2 * size):
        assert _core.roots_inside(np.array(tail), most) == (size < most)


@pytest.mark.slow
def test_a_rise_below_the_data_is_not_used():
    # A slow pole below the lowest frequency: the data show only its tail, and do not support a plateau below.
    frequencies = np.geomspace(LOWEST, HALF * 0.999, 250)
    density = 1 + (1.0 / frequencies) ** 2 * 3
    eta = np.full(250, 20_000.0)
    found = short_memory(frequencies, density, eta, rate=RATE, known=np.zeros(250))
    angles = 2 * np.pi * frequencies / RATE
    data = _Data.of(angles, known=np.zeros(250), floor=0.0, logs=np.log(density), weights=eta / 2)
    point = _ArmaPoint(data=data, a=-found.phi, b=found.theta, scale=np.log(found.innovation), slow=0.0)
    assert abs(_bend(data, point)) <= LARGEST_BEND
    assert LARGEST_ERROR_AT_ZERO < LARGEST_BEND
