"""Smallest amplitude of a sinusoid that the search for lines can detect."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Vector
from gmwm.base.errors import DataError, OptionError
from gmwm.measuring.spectrum.level import FLANK_SHARE, flanks
from gmwm.measuring.spectrum.narrow import FAR, FIRST_BIN, LEAST_FLANK, NEAR
from gmwm.measuring.spectrum.peaks import FALSE_ALARMS
from gmwm.measuring.spectrum.welch import ENERGY_WIDTH

if TYPE_CHECKING:
    from gmwm.measuring.spectrum.result import PowerSpectrum


def detectable_amplitude(spectrum: PowerSpectrum, frequency: ArrayLike, power: float = 0.9) -> Vector:
    """Return the smallest detectable amplitudes (u); see `PowerSpectrum.detectable_amplitude`.

    At the frequency nearest to a line, the density is S χ²_ν(ν q) / ν, with the level S of the noise, the ratio q of
    the density of the line to S, and a noncentral chi-square variable with ν degrees of freedom. The line is detected
    if the density exceeds a multiple of the higher flank median. q is the ratio at which this has the probability
    `power`.
    """
    from scipy.special import chndtrinc, fdtri

    if not 0.5 <= power < 1:
        raise OptionError(argument="power", expected="a probability from 0.5 to below 1", got=power)
    if spectrum.frequencies[0] != 0:
        raise DataError("the amplitude needs the whole spectrum, not a smoothed one", argument="spectrum", got=spectrum)
    size, spacing = spectrum.density.size - 1, spectrum.rate / spectrum.length
    wanted = np.asarray(frequency, dtype=np.float64)
    place = wanted / spacing
    nearest = np.clip(np.round(place), 0, size - 1).astype(np.int64)
    beside = flanks(
        spectrum.density[FIRST_BIN:size], spectrum.degrees_of_freedom[FIRST_BIN:size], NEAR, FAR, least=LEAST_FLANK
    )
    tests = size - 2 * FIRST_BIN - NEAR - LEAST_FLANK + 1
    # Frequencies close to half the rate have only a left flank, which is used for both sides.
    left, right = beside.left, np.where(np.isnan(beside.right), beside.left, beside.right)
    level, higher = np.full((2, size), np.nan)
    level[FIRST_BIN:], higher[FIRST_BIN:] = np.sqrt(left * right), np.maximum(left, right)
    with np.errstate(invalid="ignore", divide="ignore"):
        excess = higher / level
    freedom = spectrum.degrees_of_freedom[nearest]
    threshold = fdtri(freedom, FLANK_SHARE * freedom, 1 - FALSE_ALARMS / 2 / tests) * excess[nearest]
    ratio = chndtrinc(freedom * threshold, freedom, 1 - power) / freedom
    away = place - nearest
    found = np.sqrt(2 * ENERGY_WIDTH * spacing * ratio * level[nearest] / _gain(away))
    return np.asarray(np.where((wanted > 0) & (place <= size), found, np.nan))


def _gain(away: Vector) -> Vector:
    """Return the power gain of the Hann window at a distance of `away` bins (at most ½) from a sinusoid."""
    return np.asarray((np.sinc(away) / (1 - away**2)) ** 2)
