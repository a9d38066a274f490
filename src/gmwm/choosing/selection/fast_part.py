"""Terms of the fast part of the noise that the spectrum shows: peaks, a shape, and their uncertainty."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import GmwmError
from gmwm.choosing.selection.ranking import RankingOptions
from gmwm.choosing.selection.structure import largest_within
from gmwm.fitting.estimation.model_error import nearly_fitted
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.weighting import precision, square_root
from gmwm.measuring.spectrum.line import Bump, Line
from gmwm.measuring.spectrum.narrow import resonance_of
from gmwm.measuring.spectrum.result import PowerSpectrum
from gmwm.measuring.spectrum.short_memory import HIGHEST_ORDER, Alternative, SpectralShape, short_memory
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.repairs.moving_average import MovingAverage
from gmwm.theory.filters import HAAR, find_filter
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model
from gmwm.theory.processes.noise import WN
from gmwm.theory.processes.ordered import find_class
from gmwm.theory.processes.oscillator import CRITICAL, OSC, SHARPEST
from gmwm.theory.processes.parameter import Fixed
from gmwm.theory.processes.power import FN
from gmwm.theory.processes.sinusoid import SIN

FELT = 0.003
"""Smallest share of the wavelet variance at some level with which a peak is measured. For comparison, the relative
standard error at the first levels is 0.2 % for 10^6 samples (tests/selection/test_peaks.py)."""
UNSEEN_DISTANCE = 1.0
"""Distance (standard errors) by which peaks left out may change the variance (tests/selection/test_peaks.py)."""
MOST_OSCILLATORS = 8  # Largest number of oscillators. More bumps are those of a comb filter, which belong to the shape.
NARROW = 0.002
"""Width over rate below which a bump is no part of an ARMA process, half its narrowest; see `short_memory.POLE`."""


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
    """Return sinusoids for lines and oscillators for bumps (and wide lines) that change the variance, strongest first.

    Frequency, quality and most powers are fixed. Fitted are the strongest of each kind and well determined ones; a peak
    near a stronger one changes the curve little, so its power is added to it."""
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
    terms = [peak._replace(process=_with_power(peak.process, power)) for peak, power in zip(terms, powers, strict=True)]
    free = {id(next((peak for peak in terms if isinstance(peak.process, kind)), None)) for kind in (SIN, OSC)}
    errors = np.sqrt(2 / wv.degrees_of_freedom)
    # From 20 standard errors on, an error of 5 % of the power from the spectrum is one standard error of the curve.
    free |= {id(peak) for peak in terms if np.linalg.norm(peak.share / errors) > 20.0}
    processes = [_with_power(peak.process, None) if id(peak) in free else peak.process for peak in terms]
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


def _with_power(process: Process, factor: float | None) -> Process:
    power = None if factor is None else Fixed(factor * process.scale)
    return process.with_values(**{process.scale_parameter().name: power})


SAMPLED = (0.4427, 0.1542, 0.0500, 0.0154, 0.0046, 0.0013)
"""Relative difference of Haar variances of discrete flicker noise (white noise integrated by 1/2, Kasdin 1995, density
π/sin(πf)) and of averaged 1/f noise, from level 1 on (tests/selection/test_shape_error.py)."""

FLICKER_SPREAD = 0.75
"""Standard deviation of sampled from continuous flicker noise, relative to `SAMPLED`: 0 if averaged over intervals,
0.45 for 1/f up to half the rate, 1 for discrete flicker noise."""
BAND = ("f_b", "f_r", "Q_r")  # symbols of the physical parameters of a shape that do not depend on its scale
SELECTION_FACTOR = 2.0
"""Factor of a shape's covariance, as the same spectrum selected its order. With 1.5, 95 % intervals of N cover in 89 %
of recordings with an FIR filter (docs/validation/sensors.md)."""

FILTER_TIME_SAMPLES = 3.0
"""Correlation time (samples) up to which GM describes the sensor's low-pass filter; its other form makes N 0.5 % wrong
although tests accept it (docs/validation/sensors.md)."""


def process_of(shape: SpectralShape | Alternative) -> Process:
    """Return the ARMA process of a shape, with fixed coefficients and a free variance."""
    p, q = shape.phi.size, shape.theta.size
    if p + q == 0:
        return WN()
    kind = find_class(f"ARMA({p},{q})" if p and q else f"AR({p})" if p else f"MA({q})")
    assert kind is not None
    names = [parameter.name for parameter in kind.nonlinear_parameters()]
    values = np.concatenate([shape.phi, shape.theta]).tolist()
    return kind(**{name: Fixed(value) for name, value in zip(names, values, strict=True)})


def with_average_error(wv: WaveletVariance, average: MovingAverage, fit: Fit) -> WaveletVariance:
    """Add the change of slow noise by the average to the covariance, because slow terms do not pass it, and leave out
    levels that change by a tenth. `fit` has the most flicker noise, which is fastest."""
    cycles = np.geomspace(1e-4 / average.length, 0.5, 4000)
    slow = _density([p for p in fit.model.processes if _is_slow(p, wv.rate)], cycles * wv.rate, wv.rate)
    lost = slow * (1 - average.gain(cycles))
    half = np.ldexp(1.0, wv.levels - 1)[:, None]
    haar = (np.sin(np.pi * cycles * half) ** 2 / (half * np.sin(np.pi * cycles))) ** 2
    apart = 2 * np.trapezoid(haar * lost, cycles, axis=1) / wv.variance
    used = apart < 0.1
    apart = apart[used]
    # The change by other slow noise differs by about 30 %, at each level.
    return _with(wv.only(wv.levels[used]), np.outer(apart, apart) + np.diag((0.3 * apart) ** 2))


def acts_as_filter(process: Process, fit: Fit) -> bool:
    """Return whether a Gauss-Markov process is so fast that it may describe the low-pass filter of the sensor."""
    time = process.correlation_time(fit.wavelet_variance.rate)
    return time is not None and 0 < time * fit.wavelet_variance.rate <= FILTER_TIME_SAMPLES


def with_shape_error(wv: WaveletVariance, fit: Fit, shape: SpectralShape, process: Process) -> WaveletVariance:
    """Add a shape's uncertainty to the covariance: that of coefficients, and differences of other good ARMA orders, at
    constant density at 0, which the fit estimates. `fit` gives the share of `process` by level."""
    if not shape.covariance.size:
        return wv
    nonlinear = np.concatenate([shape.phi, shape.theta]).reshape(1, -1)
    slopes = type(process).shape_jacobian(nonlinear, wv.levels, wv.rate)[0]
    slopes /= type(process).shape(nonlinear, wv.levels, wv.rate)[0][:, None]
    slopes[:, : shape.phi.size] -= 2 / (1 - shape.phi.sum())
    slopes[:, shape.phi.size :] -= 2 / (1 + shape.theta.sum())
    relative: Matrix = slopes @ shape.covariance @ slopes.T
    curve = _unit_curve(shape, wv)
    for other in shape.alternatives:
        apart = _unit_curve(other, wv) / curve - 1
        relative = relative + other.weight * np.outer(apart, apart)
    # A fast Gauss-Markov term can take the place of the shape, or of a part of it.
    fast = [
        fit.decomposition[term]
        for term, part in fit.model.by_term.items()
        if type(part) is type(process) or acts_as_filter(part, fit)
    ]
    share = np.sum(fast, axis=0) / fit.implied
    return _with(wv, SELECTION_FACTOR * relative * np.outer(share, share))


def with_oscillator_error(wv: WaveletVariance, fit: Fit, terms: Sequence[Process]) -> WaveletVariance:
    """Add the uncertainty of oscillators' frequency and quality to the covariance, with shares of `fit` by level. A
    Lorentz peak with damping a = πf₀/Q over T has the variances a/T of ω and 1/aT of ln a (Whittle's likelihood)."""
    duration = float(wv.samples) / wv.rate
    for process in terms:
        if not isinstance(process, OSC):
            continue
        frequency, quality = process.value("frequency"), process.value("quality")
        shape = OSC.standard((frequency, quality))
        slopes = OSC.shape_jacobian(np.array([[frequency, quality]]), wv.levels, wv.rate)[0] * [frequency, quality]
        slopes /= shape.wavelet_variance(wv.levels, wv.rate)[:, None]
        # ln a = ln f₀ − ln Q + …, and the errors of ω₀ and a are uncorrelated.
        damping = math.pi * frequency / quality
        frequency_square, decay_square = damping / duration / (2 * math.pi * frequency) ** 2, 1 / (damping * duration)
        relative = frequency_square * np.outer(slopes.sum(axis=1), slopes.sum(axis=1))
        relative = relative + decay_square * np.outer(slopes[:, 1], slopes[:, 1])
        share = (
            sum(
                fit.decomposition[term]
                for term, part in fit.model.by_term.items()
                if isinstance(part, OSC) and np.allclose(part.nonlinear, process.nonlinear, rtol=1e-9, atol=0.0)
            )
            / fit.implied
        )
        wv = _with(wv, SELECTION_FACTOR * relative * np.outer(share, share))
    return wv


def band_errors(shape: SpectralShape, rate: float) -> dict[str, float]:
    """Return relative standard errors of f_b, f_r and Q_r (delta method), with other good ARMA orders."""
    values = np.concatenate([shape.phi, shape.theta])
    if not values.size:
        return {}
    names = [parameter.name for parameter in process_of(shape).nonlinear_parameters()]
    others = [(other.weight, _band(process_of(other), rate)) for other in shape.alternatives]
    errors = {}
    free: dict[str, Any] = {**dict(zip(names, values.tolist(), strict=True)), "sigma2": shape.innovation}
    for number in type(process_of(shape))(**free).physical(rate):
        if number.signal_power or number.symbol not in BAND:
            continue
        slopes = np.array([number.slopes.get(name, 0.0) for name in names]) / values
        square = float(slopes @ shape.covariance @ slopes)
        square += sum(w * math.log(b[number.symbol] / number.value) ** 2 for w, b in others if number.symbol in b)
        errors[number.symbol] = math.sqrt(max(square, 0.0))
    return errors


def _band(process: Process, rate: float) -> dict[str, float]:
    numbers = process.with_scale(1.0).physical(rate)
    return {number.symbol: number.value for number in numbers if number.symbol in BAND}


def _unit_curve(shape: SpectralShape | Alternative, wv: WaveletVariance) -> Vector:
    """Return the wavelet variance (J,) of a shape, scaled to the spectral density 1 at frequency 0."""
    nonlinear = np.concatenate([shape.phi, shape.theta]).reshape(1, -1)
    curve = type(process_of(shape)).shape(nonlinear, wv.levels, wv.rate)[0]
    return np.asarray(curve * ((1 - shape.phi.sum()) / (1 + shape.theta.sum())) ** 2)


def with_sampling_error(wv: WaveletVariance, fit: Fit) -> WaveletVariance:
    """Add the uncertainty of flicker noise near half the rate, modelled as interval averages. Flicker of output stages,
    or aliased noise, has more power there, which a fit would attribute to white noise."""
    flicker = [t for t, p in fit.model.by_term.items() if isinstance(p, FN) and p.scale]
    if not flicker or find_filter(wv.filter) is not HAAR:
        return wv
    places = np.minimum(wv.levels, len(SAMPLED) + 1) - 1
    apart = FLICKER_SPREAD * np.append(SAMPLED, 0.0)[places]
    apart *= sum(fit.decomposition[term] for term in flicker) / fit.implied
    return _with(wv, np.outer(apart, apart))


def _with(wv: WaveletVariance, added: Matrix) -> WaveletVariance:
    return replace(wv, excess=added if wv.excess is None else wv.excess + added)


BESIDE = "4*GM + FN + RW + DR"
"""General model that is combined with a shape at high frequencies. The shape includes white and quantization noise."""
FEWEST = 24
"""Smallest number of frequencies to which a shape at high frequencies is fitted. With fewer, no shape is fitted."""
MIXED = 0.5
"""Share of slow noise in the density up to which frequencies count for the shape."""
FAST = 20.0
"""Correlation time (samples) up to which GM is fast noise; above its corner, 1/126 of the rate, the shape is fitted."""
MEMORY = 2000.0
"""Correlation time (samples) from which an AR(2) describes a spectral line, not a shape."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FastPart:
    """Terms that the spectrum shows, with their `shape`, and the data with its uncertainty. `is_largest` tells whether
    there is no shape with more coefficients."""

    wavelet_variance: WaveletVariance
    terms: tuple[Process, ...]
    shape: SpectralShape | None = None
    is_largest: bool = True


def fast_parts(
    general: Fit, wv: WaveletVariance, spectrum: PowerSpectrum, peaks: tuple[Process, ...], *, order: int,
    check: Callable[[], None],
) -> Iterator[FastPart]:  # fmt: skip
    """Yield the peaks with each visible shape up to `order` beside slow terms, fewest coefficients first, best last."""
    check()
    average = spectrum.average
    if average is not None and find_filter(wv.filter) is HAAR:
        white = Alternative(phi=np.empty(0), theta=average.taps, density=1.0, weight=1.0)  # through the average
        terms = (process_of(white), *peaks)
        longer = wv.only(wv.levels[np.ldexp(1.0, wv.levels - 1) >= average.passes * average.length])
        fit = nearly_fitted(largest_within("FN + RW", longer, terms), longer, general.weighting)
        yield FastPart(wavelet_variance=with_average_error(wv, average, fit), terms=terms)
        check()
    best = _shape(spectrum, general, wv.rate, before=None, order=order)
    if best is not None:  # the slow terms that the shape was fitted beside did not know the shape
        check()
        process = process_of(best)
        slow = nearly_fitted(largest_within(BESIDE, wv, (process, *peaks)), wv, general.weighting)
        best = _shape(spectrum, slow, wv.rate, before=process, order=order)
    if best is None:
        if peaks:
            yield FastPart(wavelet_variance=wv, terms=(WN(), *peaks))
        return
    for shape in (*best.simpler, best):
        process = process_of(shape)
        fit = nearly_fitted(largest_within(BESIDE, wv, (process, *peaks)), wv, general.weighting)
        yield FastPart(
            wavelet_variance=with_shape_error(wv, fit, shape, process), terms=(process, *peaks), shape=shape,
            is_largest=shape is best and order == HIGHEST_ORDER,
        )  # fmt: skip


def autoregression(wv: WaveletVariance, options: RankingOptions) -> FastPart:
    """Return the shape without a spectrum, an AR(2) fitted beside slow noise; no term if it is no fast shape."""
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
    spectrum: PowerSpectrum, known: Fit, rate: float, *, before: Process | None, order: int
) -> SpectralShape | None:
    """Fit a shape to the high frequencies that slow terms do not explain; None if too few frequencies can be used."""
    smooth = spectrum.smoothed() if spectrum.frequencies[0] == 0 else spectrum
    frequencies, density = smooth.frequencies, smooth.density * rate / 2
    processes = [process for process in known.model.processes if type(process) is not type(before)]
    oscillators = _density([process for process in processes if isinstance(process, OSC)], frequencies, rate)
    slow = oscillators + _density([process for process in processes if _is_slow(process, rate)], frequencies, rate)
    # Up to this share of oscillators in the density, an error of 10 % of their flanks changes the shape by 1.5 %.
    used = (frequencies > rate / (2 * math.pi * FAST)) & (density > 0) & (oscillators <= 0.15 * density)
    peaks: list[Line | Bump] = [*spectrum.lines, *narrow_bumps(spectrum)]
    for peak in peaks:
        # Frequencies near a line, in resolutions, are not used for the shape (tests/selection/test_search.py).
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
