"""Lines and bumps in a power spectral density: peaks above both of their flanks, from narrow to wide."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gmwm.spectrum.harmonics import grouped
from gmwm.spectrum.level import effective_freedom
from gmwm.spectrum.line import Bump, Line
from gmwm.spectrum.narrow import FAR, FIRST_BIN, narrow_lines
from gmwm.spectrum.welch import nominal_freedom
from gmwm.spectrum.wide import wide_peaks

if TYPE_CHECKING:
    from gmwm.spectrum.result import PowerSpectrum

FALSE_ALARMS = 0.01
"""Probability of a false line or bump in a spectrum of noise whose density is monotone, by Bonferroni's inequality: one
half for narrow lines, one half for wide peaks. Pinned by tests/spectrum/test_false_alarms.py."""

STATIONARY = 0.5
"""Smallest degrees of freedom, relative to stationary noise, at which peaks are tested. If knocks have most of the
power, densities at neighbouring frequencies are not independent: a short knock has a random spectrum with bumps."""


def find_peaks(spectrum: PowerSpectrum) -> tuple[tuple[Line, ...], tuple[Bump, ...]]:
    """Return the lines and the bumps of a spectrum, by frequency.

    A line is a peak whose density is significantly above the medians of 16 bins on both of its sides and that is a few
    bins wide. Wider peaks are found in the same way on grids of constant relative resolution, from 1/3072 to 1/6
    octave. A peak whose frequency is at least 60 times its width is a line that wanders, and any other peak is a bump.
    Frequencies at which the power of the noise differs much between the blocks are not searched.
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
