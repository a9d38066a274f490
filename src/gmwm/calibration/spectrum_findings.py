"""Remarks on the lines and resonances in the spectrum of an axis."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.remarks import Quantity, Remark
from gmwm.calibration.misfit import line_in, line_process
from gmwm.theory.filters import find_filter

if TYPE_CHECKING:
    from gmwm.calibration.result import AxisCalibration
    from gmwm.measuring.spectrum import Line
    from gmwm.measuring.variance import WaveletVariance

SHARE = 0.05
"""Smallest share of the wavelet variance of any level for which a remark says that lines affect the numbers. It changes
a density such as N, which is the square root of a variance, by 2.5 %."""


def spectrum_remarks(axis: str, found: AxisCalibration) -> Iterator[Remark]:
    """Yield remarks on the lines and bumps in the spectrum of an axis, if it has a spectrum."""
    spectrum = found.spectrum
    if spectrum is None:
        return
    if spectrum.lines:
        yield _lines(axis, found, spectrum.lines)
    if spectrum.bumps:
        yield Remark.of(
            "resonance-found",
            axis,
            frequencies=tuple(Quantity(bump.frequency, "Hz") for bump in spectrum.bumps),
            widths=tuple(Quantity(bump.width, "Hz") for bump in spectrum.bumps),
            heights=tuple(bump.height for bump in spectrum.bumps),
        )


def _lines(axis: str, found: AxisCalibration, lines: tuple[Line, ...]) -> Remark:
    wv = found.fit.wavelet_variance
    strongest = sorted(lines, key=lambda line: -line.amplitude)
    share, tau = line_share(wv, lines)
    modelled = line_in(found.fit.model) is not None
    return Remark.of(
        "lines-found" if share >= SHARE and not modelled else "lines-known",
        axis,
        frequencies=tuple(Quantity(line.frequency, "Hz") for line in strongest),
        amplitudes=tuple(Quantity(line.amplitude, wv.unit) for line in strongest),
        widths=tuple(Quantity(line.width, "Hz") for line in strongest),
        share=share,
        tau=Quantity(tau, "s"),
        modelled="yes" if modelled else "no",
        sinusoid=line_process() or "",
    )


def line_share(wv: WaveletVariance, lines: tuple[Line, ...]) -> tuple[float, float]:
    """Return the largest share A² |H_j(f)|² / 2 that lines have in the wavelet variance of a level j, and its scale
    (s). |H_j|² is the squared gain of the filter."""
    wavelet = find_filter(wv.filter)
    cycles = np.array([line.frequency for line in lines]) / wv.rate
    powers = np.array([line.amplitude for line in lines]) ** 2 / 2
    added = np.array([float(powers @ wavelet.squared_gain(cycles, int(level))) for level in wv.levels])
    share = np.divide(added, wv.variance, out=np.zeros(len(wv)), where=wv.variance > 0)
    worst = int(np.argmax(share))
    return min(float(share[worst]), 1.0), float(wv.tau[worst])
