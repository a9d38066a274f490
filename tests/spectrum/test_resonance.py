"""Peaks of a spectrum that are damped oscillators, and lines that are not."""

import mpmath
import numpy as np
import pytest

from gmwm import WN, psd
from gmwm.measuring.spectrum.narrow import _hann_lorentz, resonance_of
from gmwm.theory.processes.oscillator import OSC

RATE, SAMPLES = 100.0, 360_000


def _resonances(x):
    spectrum = psd(x, rate=RATE)
    peaks = [*spectrum.lines, *spectrum.bumps]
    return [resonance_of(spectrum, peak, [other for other in peaks if other is not peak]) for peak in peaks]


@pytest.mark.parametrize("damping", [0.01, 0.3, 3.0, 50.0])
def test_the_density_of_a_resonance_over_hann_blocks_is_exact(damping):
    """∫₀¹ e^(−αu) cos(δu) c(u) du, where c(u) = (1 − u)(2/3 + cos(2πu)/3) + sin(2πu)/(2π) is that of the window."""
    distance = np.array([-300.0, -6.3, 0.0, 1.0, 40.0, 299.0])
    with mpmath.workdps(30):
        turn = 2 * mpmath.pi

        def integral(delta: float, power: int) -> complex:
            def at(u):
                hann = (1 - u) * (2 + mpmath.cos(turn * u)) / 3 + mpmath.sin(turn * u) / turn
                return (-u) ** power * mpmath.exp(-mpmath.mpc(damping, -delta) * u) * hann

            return complex(mpmath.quad(at, np.linspace(0, 1, 50).tolist()))

        exact, slopes = ([integral(delta, power) for delta in distance] for power in (0, 1))
    found = _hann_lorentz(damping, distance)
    np.testing.assert_allclose(found[0], np.real(exact), rtol=2e-12)
    np.testing.assert_allclose(found[1], slopes, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frequency", "quality"), [(0.5, 10.0), (0.5, 3000.0), (8.0, 400.0), (30.0, 10.0), (30.0, 3000.0)]
)
def test_the_quality_of_an_oscillator_is_found_below_the_resolution_too(frequency, quality):
    model = WN(sigma2=1.0) + OSC(frequency=frequency, quality=quality, sigma2=9.0)
    (resonance,) = _resonances(model.simulate(SAMPLES, RATE, rng=1))
    periods = frequency * SAMPLES / RATE / quality  # the relative variance of the quality is 1/π times its inverse
    assert resonance.frequency == pytest.approx(frequency, rel=0.02)
    assert abs(np.log(resonance.quality / quality)) < 0.05 + 3 / np.sqrt(np.pi * periods)
    assert abs(np.log(resonance.variance / 9.0)) < 0.05 + 4 / np.sqrt(np.pi * periods)


@pytest.mark.slow
def test_a_sinusoid_in_noise_has_no_width():
    times = np.arange(SAMPLES // 4) / RATE
    for seed in range(40):
        rng = np.random.default_rng(seed)
        line = 10 ** rng.uniform(-1, 1.5) * np.sin(2 * np.pi * rng.uniform(0.1, 45.0) * times + rng.uniform(0, 6.3))
        assert all(item is None for item in _resonances(line + rng.normal(size=times.size)))
