"""Sinusoids and oscillators for the peaks of a spectrum that the wavelet variance shows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gmwm.base.arrays import Matrix, Vector
from gmwm.fitting.estimation.weighting import precision, square_root
from gmwm.measuring.spectrum.line import Bump, Line
from gmwm.measuring.spectrum.resonance import resonance_of
from gmwm.measuring.spectrum.result import PowerSpectrum
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.oscillator import CRITICAL, OSC, SHARPEST
from gmwm.theory.processes.parameter import Fixed
from gmwm.theory.processes.sinusoid import SIN

FELT = 0.003
"""Smallest share of the wavelet variance at some level with which a peak is measured. For comparison, the relative
standard error at the first levels is 0.2 % for 10^6 samples (tests/selection/test_peaks.py)."""
UNSEEN_DISTANCE = 1.0
"""Peaks are left out if together they change the wavelet variance by at most this distance in standard errors, after
the powers of the other peaks are fitted. No parameter then changes by more than one standard error
(tests/selection/test_peaks.py)."""
MOST_OSCILLATORS = 8
"""Largest number of oscillators. More bumps are those of a comb filter, which belong to the shape."""
NARROW = 0.002
"""A bump that is narrower than this, relative to the sampling rate, cannot be a part of an ARMA process. The value is
half the width of the narrowest peak that these can have; see `gmwm.spectrum.short_memory.POLE`."""


class _Peak(NamedTuple):
    """The process of a peak with its power, and its share of the wavelet variance at each level."""

    process: Process
    share: Vector


def oscillating(bumps: Sequence[Bump]) -> list[Bump]:
    """Return the bumps that an oscillator can describe."""
    return [bump for bump in bumps if CRITICAL < bump.quality < SHARPEST]


def narrow_bumps(spectrum: PowerSpectrum) -> list[Bump]:
    """Return the bumps that are too narrow for an ARMA process."""
    return [bump for bump in oscillating(spectrum.bumps) if bump.width < NARROW * spectrum.rate]


def peak_terms(spectrum: PowerSpectrum, wv: WaveletVariance, bumps: Sequence[Bump]) -> tuple[Process, ...]:
    """Return sinusoids for the lines and oscillators for these bumps that change the wavelet variance, the strongest
    first. A line with a width is an oscillator.

    Their frequency and quality are fixed, and so is the power of most. The power is fitted of the strongest of each
    kind, and of those that the wavelet variance determines well. A peak near a stronger one of similar frequency
    changes the curve little: its power is added to the stronger one.
    """
    peaks = sorted(_visible(spectrum, wv, bumps), key=lambda peak: -peak.share.max())
    scatter = np.diag(2 / wv.degrees_of_freedom)
    for process, share in peaks:
        if isinstance(process, OSC):  # its mean square over the recording varies
            damping = math.pi * process.value("frequency") / process.value("quality")
            scatter += np.outer(share, share) * wv.rate / (damping * float(wv.samples))
    root = square_root(precision(scatter))
    terms, absent = list[_Peak](), np.zeros(len(wv))
    columns = np.zeros((len(wv), 0))
    for peak in peaks:
        together = absent + root @ peak.share
        residual = together - columns @ _coefficients(columns, together)
        # 5 % of the wavelet variance is 2.5 % of a density such as N.
        if np.linalg.norm(residual) <= UNSEEN_DISTANCE and peak.share.max() < 0.05:
            absent = together
        else:
            terms.append(peak)
            columns = np.column_stack([columns, root @ peak.share])
    powers = 1 + np.maximum(_coefficients(columns, absent), 0)
    terms = [peak._replace(process=_scaled(peak.process, power)) for peak, power in zip(terms, powers, strict=True)]
    free = {id(next((peak for peak in terms if isinstance(peak.process, kind)), None)) for kind in (SIN, OSC)}
    errors = np.sqrt(2 / wv.degrees_of_freedom)
    # From 20 standard errors on, an error of 5 % of the power from the spectrum is one standard error of the curve.
    free |= {id(peak) for peak in terms if np.linalg.norm(peak.share / errors) > 20.0}
    processes = [_with_free_power(peak.process) if id(peak) in free else peak.process for peak in terms]
    oscillators = [process for process in processes if isinstance(process, OSC)]
    return (*(process for process in processes if isinstance(process, SIN)), *oscillators[:MOST_OSCILLATORS])


def _visible(spectrum: PowerSpectrum, wv: WaveletVariance, bumps: Sequence[Bump]) -> list[_Peak]:
    """Return the processes of the lines and bumps that are large enough at some level."""
    peaks: list[Line | Bump] = [*spectrum.lines, *bumps]
    below = np.where(wv.variance > 0, wv.variance, np.inf)
    visible = []
    for peak in peaks:
        process = _of_peak(peak)
        share = process.wavelet_variance(wv.levels, wv.rate, wv.filter) / below
        if share.max() < FELT:
            continue
        resonance = resonance_of(spectrum, peak, [other for other in peaks if other is not peak])
        if resonance is not None and CRITICAL < resonance.quality < SHARPEST:
            process = OSC(*map(Fixed, resonance))
            share = process.wavelet_variance(wv.levels, wv.rate, wv.filter) / below
        visible.append(_Peak(process, share))
    return visible


def _of_peak(peak: Line | Bump) -> Process:
    """Return a sinusoid for a line, and an oscillator for a bump."""
    if isinstance(peak, Line):
        return SIN(frequency=Fixed(peak.frequency), power=Fixed(peak.amplitude**2 / 2))
    # The power is the integral of a Lorentz peak above the surrounding density.
    power = math.pi / 2 * peak.density * (1 - 1 / peak.height) * peak.width
    return OSC(frequency=Fixed(peak.frequency), quality=Fixed(peak.quality), sigma2=Fixed(power))


def _coefficients(columns: Matrix, curve: Vector) -> Vector:
    """Return the coefficients of the sum of columns (J, n) that is nearest to a curve (J,)."""
    return np.asarray(np.linalg.lstsq(columns, curve, rcond=None)[0])


def _scaled(process: Process, factor: float) -> Process:
    return process.with_values(**{process.scale_parameter().name: Fixed(factor * process.scale)})


def _with_free_power(process: Process) -> Process:
    return process.with_values(**{process.scale_parameter().name: None})
