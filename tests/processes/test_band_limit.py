"""N, bandwidth and resonance of noise with a short memory, by closed forms and brute force."""

from dataclasses import replace

import numpy as np
import pytest

from gmwm import AR, ARMA, MA, fixed
from gmwm.choosing.datasheets import Entry
from gmwm.theory.processes.rational import RESONANCE_RATIO, WHITE_TIME_S

RATE = 50.0


def numbers(process, rate=RATE):
    return {one.symbol: one for one in process.physical(rate)}


def resonator(frequency, quality, sigma2=2.0):
    radius, angle = np.exp(-np.pi * frequency / quality / RATE), 2 * np.pi * frequency / RATE
    return AR(phi=[2 * radius * np.cos(angle), -(radius**2)], sigma2=sigma2)


def density(process, frequencies):
    """By the definition, without the package's rational functions."""
    z = np.exp(-2j * np.pi * np.asarray(frequencies, dtype=float)[..., None] / RATE)
    values = process.values
    phi = np.array([v for name, v in values.items() if name.startswith("phi")])
    theta = np.array([v for name, v in values.items() if name.startswith("theta")])
    above = 1 + (z ** np.arange(1, theta.size + 1)) @ theta
    below = 1 - (z ** np.arange(1, phi.size + 1)) @ phi
    return values["sigma2"] / RATE * np.abs(above) ** 2 / np.abs(below) ** 2


CASES = {
    "AR(1)": AR(phi=[0.6], sigma2=3.0),
    "resonance": resonator(12.0, 6.0),
    "MA(1)": MA(theta=[0.8], sigma2=1.5),
    "MA(3)": MA(theta=[0.9, 0.8, 0.7], sigma2=1.0),
    "ARMA(1,1)": ARMA(phi=[0.5], theta=[0.9], sigma2=1.0),
    "ARMA(2,2)": ARMA(phi=[0.37, -0.195], theta=[1.6, 0.7], sigma2=0.2),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_numbers_are_those_of_a_fine_grid(case):
    process, grid = CASES[case], np.linspace(0.0, RATE / 2, 1_000_001)
    found, curve = numbers(process), density(process, grid)
    assert found["N"].value == pytest.approx(np.sqrt(curve[0]), rel=1e-12)
    above = np.flatnonzero(curve >= curve[0] / 2)[-1]
    if above == grid.size - 1:
        assert "f_b" not in found
    else:
        assert found["f_b"].value == pytest.approx(grid[above], abs=2 * grid[1])
    top = int(np.argmax(curve))
    assert ("f_r" in found) == (curve[top] >= RESONANCE_RATIO * curve[0])
    if "f_r" in found:
        assert found["f_r"].value == pytest.approx(grid[top], rel=1e-4)
        wide = grid[curve >= curve[top] / 2]
        assert found["Q_r"].value == pytest.approx(grid[top] / (wide[-1] - wide[0]), rel=1e-3)


def test_closed_forms():
    # (1 - φ)² / |1 - φ z|² = ½: cos ω = 1 - (1 - φ)² / 2φ.
    phi = 0.6
    found = numbers(AR(phi=[phi], sigma2=3.0))
    assert found["N"].value == pytest.approx(np.sqrt(3.0 / RATE) / (1 - phi))
    assert found["f_b"].value == pytest.approx(RATE / (2 * np.pi) * np.arccos(1 - (1 - phi) ** 2 / (2 * phi)))
    # The average of two: cos²(πf/f_s) = ½ at a quarter of the rate.
    assert numbers(MA(theta=[1 - 1e-9], sigma2=1.0))["f_b"].value == pytest.approx(RATE / 4, rel=1e-6)
    # A pole pair: cos ω_r = φ₁(φ₂ - 1) / 4φ₂ (Box and Jenkins).
    peak = resonator(12.0, 6.0)
    one, two = peak.values["phi1"], peak.values["phi2"]
    exact = RATE / (2 * np.pi) * np.arccos(one * (two - 1) / (4 * two))
    assert numbers(peak)["f_r"].value == pytest.approx(exact, rel=1e-10)
    assert numbers(replace(peak, sigma2=1e-9))["f_r"].value == numbers(peak)["f_r"].value


@pytest.mark.parametrize("quality", [5.0, 20.0, 35.0])
def test_the_quality_of_a_narrow_resonance(quality):
    assert numbers(resonator(12.0, quality))["Q_r"].value == pytest.approx(quality, rel=0.03)


def test_a_resonance_at_half_the_rate_or_a_small_maximum_is_none():
    assert "f_r" not in numbers(AR(phi=[-0.9], sigma2=1.0))
    assert "f_r" not in numbers(resonator(12.0, 0.8))


@pytest.mark.parametrize("case", [case for case in CASES if case != "AR(1)"])
def test_slopes_are_those_of_differences(case):
    process, step = CASES[case], 1e-4
    for symbol, number in numbers(process).items():
        expected = {}
        for name in process.values:
            sides = [
                numbers(process.with_values(**{name: process.values[name] * (1 + sign * step)}))[symbol].value
                for sign in (1, -1)
            ]
            expected[name] = np.log(sides[0] / sides[1]) / (2 * step)
        for name, slope in expected.items():
            assert number.slopes.get(name, 0.0) == pytest.approx(slope, rel=5e-3, abs=2e-3), (symbol, name)


def test_held_coefficients_have_no_slope_in_a_frequency():
    held = ARMA(phi=[fixed(0.37), fixed(-0.195)], theta=[fixed(1.6), fixed(0.7)], sigma2=0.2)
    found, free = numbers(held), numbers(CASES["ARMA(2,2)"])
    assert found["f_b"].slopes == {}
    assert found["f_b"].value == free["f_b"].value
    assert found["N"].slopes["sigma2"] == 0.5


def test_units():
    found = numbers(resonator(5.0, 6.0))
    assert {symbol: (one.signal_power, one.time_power) for symbol, one in found.items()} == {
        "N": (1, 0.5), "f_b": (0, -1.0), "f_r": (0, -1.0), "Q_r": (0, 0.0),
    }  # fmt: skip
    # N does not depend on the rate at which the same noise is sampled: σ² is proportional to the rate.
    slow, fast = (numbers(MA(theta=[0.5], sigma2=rate), rate)["N"].value for rate in (50.0, 200.0))
    assert slow == pytest.approx(fast)


def test_slow_noise_and_no_noise_have_no_numbers():
    slow = AR(phi=[np.exp(-1 / (RATE * WHITE_TIME_S * 1.01))], sigma2=1.0)
    assert slow.physical(RATE) == ()
    assert "N" in numbers(AR(phi=[np.exp(-1 / (RATE * WHITE_TIME_S * 0.99))], sigma2=1.0))
    assert AR(phi=[0.5], sigma2=0.0).physical(RATE) == ()
    assert AR(2).physical(RATE) == ()


def test_a_quality_factor_has_no_unit():
    entry = Entry(symbol="Q_r", title="quality factor of the resonance", value=7.48, low=7.0, high=8.0, unit="1")
    assert entry.text() == "7.48 (7.00 … 8.00)"
    assert replace(entry, held=True).text("si") == "7.480 (fixed)"
    assert str(replace(entry, upper_only=True)) == "Q_r ≤ 8.00"
