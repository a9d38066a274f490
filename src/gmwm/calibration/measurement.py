"""The wavelet variance of one axis that is fitted: wrong samples replaced, classical or robust, and with its tails."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from gmwm.calibration.misfit import line_in
from gmwm.calibration.options import CalibrationOptions
from gmwm.calibration.spectrum_measurement import measured_spectrum
from gmwm.errors import DataError
from gmwm.outliers import (
    MATERIAL,
    TOLERANCE,
    Screen,
    Verdict,
    contamination,
    dependence,
    find_spikes,
    other_efficiency,
    repaired,
    screened,
)
from gmwm.signals import Signal
from gmwm.spectrum import PowerSpectrum
from gmwm.variance.api import signal_wavelet_variance
from gmwm.variance.result import WaveletVariance


class Pair(NamedTuple):
    """The two wavelet variances of one axis, and the screen of its samples and its spectrum if they were read."""

    classical: WaveletVariance
    robust: WaveletVariance
    screen: Screen | None = None
    spectrum: PowerSpectrum | None = None

    @property
    def unit(self) -> str:
        """Unit of the axis."""
        return self.classical.unit


Measured = Signal | WaveletVariance | Pair


def measured_axis(
    item: Measured, options: CalibrationOptions, *, comparisons: int = 1
) -> tuple[WaveletVariance, Verdict | None, PowerSpectrum | None]:
    """Return the wavelet variance of an axis to fit, the test for outliers, and the spectrum.

    With robust="auto", the robust curve is used if bursts (knocks, motion) raise the classical one. Isolated wrong
    samples are replaced first if the samples are in memory. In a stream they are only counted; if they raise the
    classical curve, the robust one is used. A classical curve carries the covariance that heavy tails add. A robust
    curve is compared with one of another efficiency, except in a stream.

    Parameters
    ----------
    item : Signal, Pair or WaveletVariance
    options : CalibrationOptions
    comparisons : int
        Number of axes that are tested together.

    Returns
    -------
    wv : WaveletVariance
    verdict : Verdict or None
        None for a WaveletVariance, which is fitted as it is.
    spectrum : PowerSpectrum or None
        Smoothed away from lines; None for a WaveletVariance, and for a recording that is too short.

    Raises
    ------
    DataError
        If the robust curve is required, but `item` is a classical one.
    """
    if isinstance(item, WaveletVariance):
        if options.robust is True and not item.robust:
            raise DataError(
                "the wavelet variance is classical, but a robust one is required",
                advice="Pass the signal instead, or {--robust=auto}.",
            )
        return item, None, None
    signal = None
    if isinstance(item, Signal):
        spikes = find_spikes(item)
        signal = repaired(item, spikes)
        item = _curves(signal, options.efficiency, screened(signal, len(spikes), spikes.largest))
    classical, robust, screen, spectrum = item
    # With a screen, heavy tails raise no alarm, so that a smaller excess counts.
    tolerance = TOLERANCE if screen is None else MATERIAL
    verdict = contamination((classical, robust), comparisons=comparisons, tolerance=tolerance, screen=screen)
    wanted = verdict.contaminated and line_in(options.general) is None if options.robust == "auto" else options.robust
    if wanted:
        if signal is not None:
            other = signal_wavelet_variance(signal, robust=True, efficiency=other_efficiency(options.efficiency))
            verdict = replace(verdict, dependence=dependence(robust, other, verdict))
        return robust, verdict, spectrum
    fitted = replace(classical, excess=None if screen is None else screen.tails.excess(classical))
    return fitted, verdict, spectrum


def _curves(signal: Signal, efficiency: float, screen: Screen) -> Pair:
    """Both curves of a signal, and its spectrum."""
    robust = signal_wavelet_variance(signal, robust=True, efficiency=efficiency)
    return Pair(signal_wavelet_variance(signal), robust, screen, measured_spectrum(signal))
