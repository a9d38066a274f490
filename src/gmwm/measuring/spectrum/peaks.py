"""Search for lines and bumps in a power spectral density, which are peaks above both of their flanks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gmwm.measuring.spectrum.harmonics import grouped
from gmwm.measuring.spectrum.level import effective_freedom
from gmwm.measuring.spectrum.line import Bump, Line
from gmwm.measuring.spectrum.narrow import FAR, FIRST_BIN, narrow_lines
from gmwm.measuring.spectrum.welch import nominal_freedom
from gmwm.measuring.spectrum.wide import wide_peaks

if TYPE_CHECKING:
    from gmwm.measuring.spectrum.result import PowerSpectrum

FALSE_ALARMS = 0.01
"""Largest probability of a false line or bump in a spectrum of noise with a monotone density, by Bonferroni's
inequality: one half for narrow lines and one half for wide peaks."""

STATIONARY = 0.5
"""Smallest degrees of freedom, relative to stationary noise, at which peaks are searched. The spectrum of a short knock
has bumps, because it correlates neighbouring frequencies."""


def find_peaks(spectrum: PowerSpectrum) -> tuple[tuple[Line, ...], tuple[Bump, ...]]:
    """Return the lines and the bumps of a spectrum, sorted by frequency.

    A line is a peak of a few bins whose density is significantly above the medians of 16 bins on both of its sides.
    Wider peaks are found in the same way on grids of constant relative resolution, from 1/3072 to 1/6 octave. They are
    lines of varying frequency if their frequency is at least 60 times their width, and bumps otherwise.
    """
    if spectrum.density.size < FIRST_BIN + 2 * FAR or not np.any(spectrum.density[FIRST_BIN:] > 0):
        return (), ()
    freedom = effective_freedom(spectrum.density, spectrum.degrees_of_freedom)
    testable = freedom > STATIONARY * nominal_freedom(spectrum.blocks, spectrum.blocks - 1)
    testable[:FIRST_BIN] = testable[-1] = False
    lines, sharp, free = narrow_lines(spectrum, freedom, testable, level=FALSE_ALARMS / 2)
    wandering, broad = wide_peaks(spectrum, freedom, free, narrow=(lines, sharp), level=FALSE_ALARMS / 2)
    bumps = sorted([*sharp, *broad], key=lambda bump: bump.frequency)
    return grouped([*lines, *wandering], spectrum.resolution), tuple(bumps)
