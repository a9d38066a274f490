"""Search for lines and bumps in a power spectral density, which are peaks above both of their flanks."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Vector
from gmwm.base.errors import DataError, OptionError
from gmwm.measuring.spectrum.line import FLANK_SHARE, Bump, Line, effective_freedom, flanks
from gmwm.measuring.spectrum.narrow import FAR, FIRST_BIN, LEAST_FLANK, NEAR, narrow_lines
from gmwm.measuring.spectrum.welch import ENERGY_WIDTH, nominal_freedom
from gmwm.measuring.spectrum.wide import wide_peaks

if TYPE_CHECKING:
    from gmwm.measuring.spectrum.result import PowerSpectrum

FALSE_ALARMS = 0.01
"""Largest probability of a false line or bump (Bonferroni): half for narrow lines, half for wide peaks."""


def find_peaks(spectrum: PowerSpectrum) -> tuple[tuple[Line, ...], tuple[Bump, ...]]:
    """Return lines and bumps by frequency. A line has a density significantly above the medians of 16 bins on both
    sides. Wider ones, on grids from 1/3072 to 1/6 octave, are lines if the frequency is ≥ 60 widths, else bumps."""
    if spectrum.density.size < FIRST_BIN + 2 * FAR or not np.any(spectrum.density[FIRST_BIN:] > 0):
        return (), ()
    gain = _average_gain(spectrum)
    spectrum = replace(spectrum, density=spectrum.density / gain)
    freedom = effective_freedom(spectrum.density, spectrum.degrees_of_freedom)
    # Relative degrees of freedom for peaks: a short knock correlates frequencies, which makes bumps.
    testable = freedom > 0.5 * nominal_freedom(spectrum.blocks, spectrum.blocks - 1)
    testable[:FIRST_BIN] = testable[-1] = False
    lines, sharp, free = narrow_lines(spectrum, freedom, testable, level=FALSE_ALARMS / 2)
    wandering, broad = wide_peaks(spectrum, freedom, free, narrow=(lines, sharp), level=FALSE_ALARMS / 2)
    bumps = sorted([*sharp, *broad], key=lambda bump: bump.frequency)
    passed = [
        replace(line, amplitude=factor * line.amplitude, amplitude_error=factor * line.amplitude_error)
        for line in (*lines, *wandering)
        for factor in (float(np.sqrt(np.interp(line.frequency, spectrum.frequencies, gain))),)
    ]
    bumps = [
        replace(bump, density=bump.density * float(np.interp(bump.frequency, spectrum.frequencies, gain)))
        for bump in bumps
    ]
    return group_harmonics(distinct(passed, spectrum.resolution), spectrum.resolution), tuple(bumps)


def _average_gain(spectrum: PowerSpectrum) -> Vector:
    """Return the factor (n,) by which the noise passes an average of samples, whose side lobes are no peaks; else 1."""
    average = spectrum.average
    if average is None:
        return np.ones(spectrum.density.size)
    # The Hann window averages over frequencies: at a zero of the gain, its second moment is 1/3 bin².
    gain = np.convolve(np.pad(average.gain(spectrum.frequencies / spectrum.rate), 1, "reflect"), [1 / 6, 2 / 3, 1 / 6])
    return gain[2:-2] + average.floor


def distinct(lines: Iterable[Line], resolution: float) -> list[Line]:
    """Return lines farther than the resolution (Hz) or half a width from stronger ones: one can be in two bins."""
    strongest: list[Line] = []
    for line in sorted(lines, key=lambda line: -line.amplitude):
        if all(abs(line.frequency - other.frequency) > max(resolution, other.width / 2) for other in strongest):
            strongest.append(line)
    return strongest


def group_harmonics(lines: Iterable[Line], resolution: float) -> tuple[Line, ...]:
    """Return sorted lines with harmonic k and fundamental f₀, the one with most harmonics first. They differ from k f₀
    by at most the resolution (Hz) plus three standard errors."""
    waiting = sorted(lines, key=lambda line: line.frequency)
    done: list[Line] = []
    while waiting:
        first, members = max(
            ((line, _multiples(line, waiting, resolution)) for line in waiting), key=lambda group: len(group[1])
        )
        if len(members) < 2:
            break
        done += [replace(line, harmonic=k, fundamental=first.frequency) for line, k in members]
        taken = [id(line) for line, _ in members]
        waiting = [line for line in waiting if id(line) not in taken]
    return tuple(sorted([*done, *waiting], key=lambda line: line.frequency))


def _multiples(first: Line, lines: Iterable[Line], resolution: float) -> list[tuple[Line, int]]:
    """Return the lines at multiples of the frequency of `first`, including `first`, each with its multiple k."""
    multiples = []
    for line in lines:
        k = round(line.frequency / first.frequency)
        tolerance = resolution + 3 * (line.frequency_error + k * first.frequency_error)
        # A tolerance above a quarter of f₀ would find a multiple for any line.
        if 1 <= k <= 40 and abs(line.frequency - k * first.frequency) <= tolerance < first.frequency / 4:
            multiples.append((line, k))
    return multiples


def detectable_amplitude(spectrum: PowerSpectrum, frequency: ArrayLike, power: float = 0.9) -> Vector:
    """Return the smallest detectable amplitudes (u): the density S χ²_ν(ν q) / ν, noncentral, at q times the level S
    must exceed a multiple of the higher flank median with probability `power`."""
    from scipy.special import chndtrinc, fdtri

    if not 0.5 <= power < 1:
        raise OptionError(argument="power", expected="a probability from 0.5 to below 1", got=power)
    if spectrum.frequencies[0] != 0:
        raise DataError("the amplitude needs the whole spectrum, not a smoothed one", argument="spectrum", got=spectrum)
    size, spacing = spectrum.density.size - 1, spectrum.rate / spectrum.length
    hertz = np.asarray(frequency, dtype=np.float64)
    place = hertz / spacing
    nearest = np.clip(np.round(place), 0, size - 1).astype(np.int64)
    surroundings = flanks(
        spectrum.density[FIRST_BIN:size], spectrum.degrees_of_freedom[FIRST_BIN:size], NEAR, FAR, least=LEAST_FLANK
    )
    tests = size - 2 * FIRST_BIN - NEAR - LEAST_FLANK + 1
    # Frequencies close to half the rate have only a left flank, which is used for both sides.
    before, after = surroundings.left, np.where(np.isnan(surroundings.right), surroundings.left, surroundings.right)
    level, higher = np.full((2, size), np.nan)
    level[FIRST_BIN:], higher[FIRST_BIN:] = np.sqrt(before * after), np.maximum(before, after)
    with np.errstate(invalid="ignore", divide="ignore"):
        excess = higher / level
    freedom = spectrum.degrees_of_freedom[nearest]
    threshold = fdtri(freedom, FLANK_SHARE * freedom, 1 - FALSE_ALARMS / 2 / tests) * excess[nearest]
    ratio = chndtrinc(freedom * threshold, freedom, 1 - power) / freedom
    away = place - nearest
    amplitude = np.sqrt(2 * ENERGY_WIDTH * spacing * ratio * level[nearest] / _gain(away))
    return np.asarray(np.where((hertz > 0) & (place <= size), amplitude, np.nan))


def _gain(away: Vector) -> Vector:
    """Return the power gain of the Hann window at a distance of `away` bins (at most ½) from a sinusoid."""
    return np.asarray((np.sinc(away) / (1 - away**2)) ** 2)
