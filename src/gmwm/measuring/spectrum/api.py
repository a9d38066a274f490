"""Estimate the power spectral density of a signal."""

from __future__ import annotations

from typing import Any, cast, overload

from numpy.typing import ArrayLike

from gmwm.base.arrays import Vector, as_rate, as_vector
from gmwm.base.errors import OptionError
from gmwm.base.threads import in_threads
from gmwm.measuring.axis_results import rate_of_array, signals_of
from gmwm.measuring.spectrum.accumulate import SpectrumAccumulator
from gmwm.measuring.spectrum.result import PowerSpectra, PowerSpectrum
from gmwm.measuring.spectrum.welch import Detrend
from gmwm.recording.options import as_confidence
from gmwm.recording.signals import Imu, Signal


@overload
def psd(
    x: Signal | ArrayLike, rate: float | None = None, *, length: int | None = None, detrend: Detrend = "constant",
    confidence: float = 0.95, fill_gaps: bool = True,
) -> PowerSpectrum: ...  # fmt: skip
@overload
def psd(
    x: Imu, rate: float | None = None, *, length: int | None = None, detrend: Detrend = "constant",
    confidence: float = 0.95, fill_gaps: bool = True,
) -> PowerSpectra: ...  # fmt: skip
def psd(
    x: Imu | Signal | ArrayLike, rate: float | None = None, *, length: int | None = None, detrend: Detrend = "constant",
    confidence: float = 0.95, fill_gaps: bool = True,
) -> PowerSpectrum | PowerSpectra:  # fmt: skip
    """Estimate the power spectral density of a signal, or of each axis of a recording, and find lines and bumps in it.

    The method is Welch's. The recording is divided into K blocks of L samples that overlap by one half. The mean is
    subtracted from each block k, and the density is the mean of the periodograms with a Hann window w,

    Ŝ(f) = 2 / (K f_s Σ w_t²) Σ_k |Σ_t w_t x_{k,t} e^{−2πi f t / f_s}|²,

    at the sampling rate f_s. It has about 1.9 K degrees of freedom. Values at neighbouring frequencies are nearly
    independent, so their mean, which plots and the summary show, is as precise as the density from shorter blocks.

    A **line** is a significant peak that is a few frequencies wide, or whose frequency is at least 60 times its width.
    A **bump** is a wider significant peak, such as a resonance. A peak is significant if it is significantly above the
    medians of the densities on both of its sides. The probability of any false line or bump in a recording of noise
    with a monotone spectrum is at most 1 %. `PowerSpectrum.detectable_amplitude` is the smallest amplitude of a line
    that is found. Lines below 12 times the frequency spacing f_s / L are not found, and a resonance that is narrower
    than twice the spacing cannot be distinguished from a line.

    Parameters
    ----------
    x : Imu, Signal, or (N,) array in any unit
        Finite samples, at least 64 without a gap. No block extends across a gap that is not filled.
    rate : float
        Sampling rate (Hz); leave it out for an Imu or a Signal.
    length : int, optional
        Length L of the blocks (samples), an even number from 8. By default it is the largest power of two, up to 65536,
        for which there are at least 15 blocks.
    detrend : "constant" or "linear"
        Trend that is subtracted from each block: its mean, or a straight line.
    confidence : float
        Confidence level of the limits, from 0.5 to below 1.
    fill_gaps : bool
        Whether to fill the gaps of a Signal that are short compared with the samples around them, see
        `Signal.fill_gaps`.

    Returns
    -------
    PowerSpectrum, or PowerSpectra for an Imu
        Frequencies, density (unit²/Hz, one-sided), limits, lines and bumps; for an Imu a mapping of axis to
        PowerSpectrum.

    Raises
    ------
    DataError
        If the signal contains NaN or infinities, or its longest segment has fewer than 64 samples, or fewer than
        `length`.
    OptionError
        If an option has an invalid value, or `rate` contradicts the rate of the Signal.

    References
    ----------
    Welch (1967), The use of fast Fourier transform for the estimation of power spectra, IEEE Transactions on Audio and
    Electroacoustics 15, 70-73. Harris (1978), On the use of windows for harmonic analysis with the discrete Fourier
    transform, Proceedings of the IEEE 66, 51-83.

    Examples
    --------
    >>> import numpy as np
    >>> rng, t = np.random.default_rng(1), np.arange(2**17) / 100.0
    >>> spectrum = psd(rng.normal(size=t.size) + 0.1 * np.sin(2 * np.pi * 7.3 * t), rate=100.0)
    >>> [line.described() for line in spectrum.lines]
    ['7.30036 ± 0.0003 Hz, amplitude 0.0964 ± 0.004 u']
    >>> bool(abs(np.sum(spectrum.density) * 100.0 / spectrum.length - 1.005) < 0.01)  # the variance
    True
    """
    as_confidence(confidence)
    if (signals := signals_of(x)) is not None:
        options: Any = {"length": length, "detrend": detrend, "confidence": confidence, "fill_gaps": fill_gaps}
        return PowerSpectra(spectra=in_threads(lambda _, signal: psd(signal, rate, **options), signals))
    segments: list[Vector]
    if isinstance(x, Signal):
        if rate is not None and as_rate(rate) != x.rate:
            raise OptionError(
                f"the rate of the signal is {x.rate:g} Hz; got {rate:g} Hz", argument="rate", got=rate,
                advice="Leave {--rate} out.",
            )  # fmt: skip
        signal = x.fill_gaps() if fill_gaps else x
        segments, rate, unit, axis = signal.segment_values(), x.rate, x.unit, x.axis
    else:
        segments, unit, axis = [as_vector(cast(ArrayLike, x), "x")], "", ""
    accumulator = SpectrumAccumulator(rate_of_array(rate), length=length, detrend=detrend, unit=unit, axis=axis)
    for segment in segments:
        accumulator.gap()
        accumulator.update(segment)
    return accumulator.result(confidence)
