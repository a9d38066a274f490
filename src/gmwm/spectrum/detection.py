"""The smallest amplitude of a sinusoid that the search for lines can find."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from gmwm._arrays import Vector
from gmwm.errors import DataError, OptionError
from gmwm.spectrum.level import FLANK_SHARE, flanks
from gmwm.spectrum.narrow import FAR, FIRST_BIN, LEAST_FLANK, NEAR
from gmwm.spectrum.peaks import FALSE_ALARMS
from gmwm.spectrum.welch import ENERGY_WIDTH

if TYPE_CHECKING:
    from gmwm.spectrum.result import PowerSpectrum


def detectable_amplitude(spectrum: PowerSpectrum, frequency: ArrayLike, power: float = 0.9) -> Vector:
    """Return the smallest detectable amplitudes (u); see `PowerSpectrum.detectable_amplitude`.

    The density at the nearest frequency of the spectrum is S χ²_ν(ν q) / ν, a noncentral χ² variable, where q is the
    ratio of the line to the level S. The threshold is r times the higher one of both flanks. q is the noncentrality at
    which the threshold is exceeded with the probability `power`.
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
    # The flanks of frequencies close to half the rate are those on the left.
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
    """Power gain of the Hann window for a sinusoid `away` bins from a frequency, at most a half."""
    return np.asarray((np.sinc(away) / (1 - away**2)) ** 2)
