"""Terms of the fast part of the noise that the spectrum shows: peaks, and a shape at high frequencies."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.errors import GmwmError
from gmwm.choosing.selection.peaks import narrow_bumps
from gmwm.choosing.selection.ranking import RankingOptions
from gmwm.choosing.selection.shape_error import band_errors, process_of, with_shape_error
from gmwm.choosing.selection.structure import largest_within
from gmwm.fitting.estimation.model_error import nearly_fitted
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.spectrum.line import Bump, Line
from gmwm.measuring.spectrum.result import PowerSpectrum
from gmwm.measuring.spectrum.short_memory import HIGHEST_ORDER, SpectralShape, short_memory
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model
from gmwm.theory.processes.noise import WN
from gmwm.theory.processes.oscillator import OSC
from gmwm.theory.processes.parameter import Fixed

BESIDE = "4*GM + FN + RW + DR"
"""General model that is combined with a shape at high frequencies. The shape includes white and quantization noise."""
FEWEST = 24
"""Smallest number of frequencies to which a shape at high frequencies is fitted. With fewer, no shape is fitted."""
MIXED = 0.5
"""The shape at high frequencies is fitted above the first frequency at which slow noise is at most this share of the
spectral density."""
FLANK_SHARE = 0.15
"""The shape is fitted where oscillators are at most this share of the spectral density. An error of 10 % of their
flanks then changes it by 1.5 %."""
FAST = 20.0
"""A Gauss-Markov term with a correlation time up to this value (samples) counts as noise at high frequencies. With this
value, the corner frequency of its spectral density is 1/126 of the sampling rate. The shape is fitted to the density
above this frequency."""
MEMORY = 2000.0
"""An AR(2) process with a longer correlation time (samples) describes a spectral line, not a shape at high
frequencies."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FastPart:
    """Terms that the spectrum shows, the data with the uncertainty of the shape, and the errors of its band.
    `is_largest` tells whether there is no shape with more coefficients."""

    wavelet_variance: WaveletVariance
    terms: tuple[Process, ...]
    band: Mapping[str, float] = field(default_factory=dict)
    is_largest: bool = True


def fast_parts(
    general: Fit, wv: WaveletVariance, spectrum: PowerSpectrum, peaks: tuple[Process, ...], *, order: int,
    check: Callable[[], None],
) -> Iterator[FastPart]:  # fmt: skip
    """Yield the peaks with each shape of at most this `order` that the spectrum shows beside the slow terms of a fit,
    the one with the fewest coefficients first, and the best one last."""
    check()
    best = _shape(spectrum, general, wv.rate, None, order)
    if best is not None:  # the slow terms that the shape was fitted beside did not know the shape
        check()
        process = process_of(best)
        slow = nearly_fitted(largest_within(BESIDE, wv, (process, *peaks)), wv, general.weighting)
        best = _shape(spectrum, slow, wv.rate, process, order)
    if best is None:
        if peaks:
            yield FastPart(wavelet_variance=wv, terms=(WN(), *peaks))
        return
    for shape in (*best.simpler, best):
        process = process_of(shape)
        fit = nearly_fitted(largest_within(BESIDE, wv, (process, *peaks)), wv, general.weighting)
        yield FastPart(
            wavelet_variance=with_shape_error(wv, fit, shape, process), terms=(process, *peaks),
            band=band_errors(shape, wv.rate), is_largest=shape is best and order == HIGHEST_ORDER,
        )  # fmt: skip


def autoregression(wv: WaveletVariance, options: RankingOptions) -> FastPart:
    """Return the shape without a spectrum: an AR(2) with fixed coefficients, fitted to the wavelet variance beside slow
    noise; no term if it is no shape at high frequencies."""
    none = FastPart(wavelet_variance=wv, terms=())
    try:
        fit = nearly_fitted(Model.parse("AR(2) + 2*GM + QN + RW"), wv, options.weighting)
    except GmwmError:
        return none
    process = next(p for p in fit.model.processes if p.name == "AR(2)")
    memory = process.correlation_time(wv.rate)
    if process.scale == 0 or memory is None or memory * wv.rate > MEMORY:
        return none
    names = [p.name for p in process.nonlinear_parameters()]
    held = {name: Fixed(process.value(name)) for name in names}
    shape = process.with_values(**held, **{process.scale_parameter().name: None})
    return FastPart(wavelet_variance=wv, terms=(shape,))


def _shape(
    spectrum: PowerSpectrum, known: Fit, rate: float, before: Process | None, order: int
) -> SpectralShape | None:
    """Fit a shape to the high frequencies that slow terms do not explain; None if too few frequencies can be used."""
    smooth = spectrum.smoothed() if spectrum.frequencies[0] == 0 else spectrum
    frequencies, density = smooth.frequencies, smooth.density * rate / 2
    processes = [process for process in known.model.processes if type(process) is not type(before)]
    oscillators = _density([process for process in processes if isinstance(process, OSC)], frequencies, rate)
    slow = oscillators + _density([process for process in processes if _is_slow(process, rate)], frequencies, rate)
    used = (frequencies > rate / (2 * math.pi * FAST)) & (density > 0) & (oscillators <= FLANK_SHARE * density)
    peaks: list[Line | Bump] = [*spectrum.lines, *narrow_bumps(spectrum)]
    for peak in peaks:
        # Frequencies within this distance from a line, in units of the frequency resolution, are not used for the shape
        # (tests/selection/test_search.py).
        used &= np.abs(frequencies - peak.frequency) > max(8 * spectrum.resolution, 4 * peak.width)
    mixed = np.flatnonzero(used & (slow <= MIXED * density))
    used &= frequencies >= frequencies[mixed[0]] if mixed.size else False
    if np.count_nonzero(used) < FEWEST:
        return None
    return short_memory(
        frequencies[used], density[used], smooth.degrees_of_freedom[used], rate=rate, known=slow[used], order=order
    )


def _is_slow(process: Process, rate: float) -> bool:
    """Return whether a process is slow noise, not an oscillation."""
    time = process.correlation_time(rate)
    oscillates = isinstance(process, OSC) or process.line(rate) is not None
    return not oscillates and (time is None or time * rate > FAST)


def _density(processes: Sequence[Process], frequencies: Vector, rate: float) -> Vector:
    """Return the spectral density (n,) of processes together, multiplied by the sampling rate."""
    total = np.zeros(frequencies.size)
    for process in processes:
        with np.errstate(divide="ignore"):
            if process.scale > 0 and process.has("psd"):
                total += process.psd(frequencies, rate) * rate
    return total
