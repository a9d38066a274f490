"""Lines and bumps, which are the two kinds of peaks in a spectrum, and the level on both sides of each frequency."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from gmwm.base import _core
from gmwm.base.arrays import Matrix, Vector, row_medians
from gmwm.base.documents import Documented
from gmwm.base.text import round_text

if TYPE_CHECKING:
    from gmwm.measuring.spectrum.result import PowerSpectrum


LEAST_QUALITY = 60.0  # smallest ratio of frequency to width of a line, twice the Q factor of a sharp resonance, 30


@dataclass(frozen=True, kw_only=True)
class Line:
    """Line in a spectrum, caused by a sinusoid or by a disturbance whose frequency varies by less than 1/60.

    Attributes
    ----------
    frequency, frequency_error : float
        Frequency of the line (Hz) and its standard error. For a line whose frequency varies, it is the mean frequency.
    amplitude, amplitude_error : float
        Amplitude of the sinusoid (u), which is √2 times its root mean square, and its standard error.
    width : float
        Width of the line at half the power (Hz), without the width of the window; 0 if it is too small to be measured.
    height : float
        Ratio of the density of the line to the level of the spectrum on both sides of it.
    p_value : float
        Probability that noise alone gives at least the density of the line at this frequency.
    harmonic, fundamental : int or None, float or None
        The numbers k and f₀ (Hz) if the frequency is k f₀ and there are other lines at multiples of f₀. The fundamental
        has k = 1.
    """

    frequency: float
    frequency_error: float
    amplitude: float
    amplitude_error: float
    width: float
    height: float
    p_value: float
    harmonic: int | None = None
    fundamental: float | None = None

    @property
    def narrow(self) -> bool:
        """Whether the width of the line is too small to be measured."""
        return self.width == 0

    @property
    def multiple(self) -> str:
        """The harmonic as text, such as "3 × 0.56514 Hz", the fundamental as "0.56514 Hz", and "" for other lines."""
        times = "" if self.harmonic == 1 else f"{self.harmonic} × "
        return "" if self.harmonic is None else f"{times}{self.fundamental:.5g} Hz"

    def described(self, unit: str = "u") -> str:
        """Format the frequency and the amplitude (in `unit`) with their standard errors, the width and the harmonic."""
        width = "" if self.narrow else f", width {self.width:.3g} Hz"
        number = f", {self.multiple}" if self.multiple and self.harmonic != 1 else ""
        return (
            f"{self.frequency:.6g} ± {self.frequency_error:.2g} Hz, amplitude {self.amplitude:.3g} ± "
            f"{self.amplitude_error:.1g} {unit}{width}{number}"
        )


@dataclass(frozen=True, kw_only=True)
class Bump(Documented):
    """Bump in a spectrum, which is a broad peak such as a mechanical resonance of the sensor or its mounting.

    Attributes
    ----------
    frequency : float
        Frequency of the peak (Hz).
    width : float
        Width (Hz) at half the height above the level of the spectrum on both sides of the peak.
    height : float
        Ratio of the density at the peak to the level on both sides of it.
    density : float
        Power spectral density at the peak (u²/Hz, one-sided).
    p_value : float
        Probability that noise gives a peak at this frequency that is as high.
    """

    frequency: float
    width: float
    height: float
    density: float
    p_value: float

    document_keys = ("frequency", "width", "height", "density", "p_value", "quality")

    @property
    def quality(self) -> float:
        """Q factor, which is the frequency divided by the width."""
        return self.frequency / self.width

    def described(self) -> str:
        """Format the frequency, the height, the width and the Q factor."""
        size = f"{round_text(self.height, 3)} × its surroundings, width {self.width:.2g} Hz"
        return f"{self.frequency:.3g} Hz, {size}, Q {round_text(self.quality)}"


CORRELATIONS = (1.0, 2 / 3, 1 / 6)
"""Absolute correlations of the Fourier coefficients of a block with a Hann window that are 0, 1 and 2 bins apart."""


def measured_line(
    spectrum: PowerSpectrum, first: int, last: int, *, level: float, freedom: float, height: float, p_value: float
) -> Line:
    """Measure the line in bins `first` to `last` from the excess over `level`: its sum is A²/2, its mean the frequency,
    its second moment the width, with the density's errors (sinusoid if narrow, else narrow-band noise)."""
    spacing = spectrum.rate / spectrum.length
    excess = spectrum.density[first : last + 1] - level
    if excess.sum() <= 0:  # the nulls of a filter beside the peak are deeper than the peak is high
        excess = np.maximum(excess, 0.0)
    place = np.arange(first, last + 1, dtype=np.float64)
    total = float(excess.sum())
    middle = float(np.clip(place @ excess / total, first, last))
    # Side lobes of the Hann window outside these bins move the mean by up to 3e-4 bins.
    lobes = sum(w * np.sinc(place - middle - k) for k, w in ((0, 1.0), (-1, 0.5), (1, 0.5))) ** 2
    middle = float(np.clip(2 * middle - place @ lobes / np.sum(lobes), first, last))
    away = place - middle
    moment = float(away**2 @ excess) / total
    # Second moment (bins²) of a line with a Hann window: −r''(0) / 4π², autocorrelation r of the window.
    spread = moment - (1 / 3)
    error = math.sqrt(_variance((away**2 - moment) / total, excess, level=level, freedom=freedom, wandering=False))
    wandering = spread > 2 * error
    # Variance of the mean frequency over half-overlapping blocks, relative to independent blocks. The noise is weighted
    # by the window times its derivative, whose overlapping halves have the correlation −3/10: 1 − 2 · 3/10.
    scatter = {
        name: math.sqrt(
            _variance(weights, excess, level=level, freedom=freedom, wandering=wandering, overlap=overlap)
        )
        for name, weights, overlap in (
            ("power", np.ones(place.size), 1.0), ("frequency", away / total, 0.4)
        )
    }  # fmt: skip
    power = total * spacing
    amplitude = math.sqrt(2 * power)
    return Line(
        frequency=middle * spacing, frequency_error=spacing * scatter["frequency"],
        amplitude=amplitude, amplitude_error=scatter["power"] * spacing / amplitude,
        width=2 * math.sqrt(2 * math.log(2)) * math.sqrt(spread) * spacing if wandering else 0.0, height=height,
        p_value=p_value,
    )  # fmt: skip


def _variance(
    weights: Vector, excess: Vector, *, level: float, freedom: float, wandering: bool, overlap: float = 1.0
) -> float:
    """Compute the variance of Σ weights · excess, with the error of the level, for narrow-band noise (`wandering`) or a
    sinusoid; `overlap` is the factor of overlapping blocks on its product with noise."""
    line = np.maximum(excess, 0.0)
    # The level is the mean of two medians of 16 bins each, so it has ten times the degrees of freedom of a bin.
    total = (float(weights.sum()) * level) ** 2 / 10
    for lag, correlation in enumerate(CORRELATIONS):
        heads, tails = slice(0, weights.size - lag), slice(lag, None)
        if wandering:
            values = weights * (level + line)
            part = correlation**2 * float(values[heads] @ values[tails])
        else:
            noise = correlation**2 * level**2 * float(weights[heads] @ weights[tails])
            root = weights * np.sqrt(line)
            part = noise + overlap * 2 * correlation * level * float(root[heads] @ root[tails])
        total += part if lag == 0 else 2 * part
    return max(2 / freedom * total, 0.0)


def lorentz_fit(
    frequencies: Vector, density: Vector, freedom: Vector, *, center: float, width: float
) -> tuple[float, float] | None:
    """Fit S(f) = a (f/c)^b + h / (1 + ((f − f₀) / (w/2))²) to gamma-distributed densities by deviance residuals; c =
    `center` starts f₀. Returns f₀ and w (Hz), or None."""
    from scipy.optimize import least_squares

    # Largest factor by which a fit may change the width; beyond, it describes another feature of the spectrum.
    largest_factor = 3.0
    positive = density > 0
    frequencies, density, freedom = frequencies[positive], density[positive], freedom[positive]
    # The shape has five parameters.
    if density.size < 8:
        return None
    level, top = float(np.median(density[np.argsort(density)[: density.size // 2]])), float(density.max())
    start = np.array([math.log(level), 0.0, math.log(max(top - level, level / 10)), 0.0, math.log(width)])
    weights, away = np.sqrt(freedom), frequencies - center
    logs = np.log(frequencies / center)

    def residuals(parameters: Vector) -> Vector:
        a, slope, height, shift, size = np.clip(parameters, -200, 200)
        shape = math.exp(height) / (1 + ((away - shift * width) / (math.exp(size) / 2)) ** 2)
        ratio = density / (np.exp(np.clip(a + slope * logs, -300, 300)) + shape)
        deviance = np.maximum(ratio - 1 - np.log(ratio), 0.0)
        return np.asarray(weights * np.sign(ratio - 1) * np.sqrt(deviance))

    fit = least_squares(residuals, start, method="lm", max_nfev=400)
    shift, size = float(fit.x[3]), math.exp(float(np.clip(fit.x[4], -200, 200)))
    if not fit.success or abs(shift) > 1 or not width / largest_factor <= size <= width * largest_factor:
        return None
    return center + shift * width, size


NEIGHBOURS = (4 / 9, 1 / 36)
"""Correlations (2/3)² and (1/6)² of the values of a periodogram with a Hann window that are one and two bins apart."""
FLANK_SHARE = 5.0
"""Freedom of a flank's median per value: 16 frequencies have 8 independent values, and a median the efficiency 2/π."""


class Flanks(NamedTuple):
    """Medians of the values to the left and to the right of each value; NaN if there are too few values."""

    left: Vector
    right: Vector

    @property
    def level(self) -> Vector:
        """Higher one of the two medians, which is at least the level between them for every monotone spectrum."""
        return np.maximum(self.left, self.right)

    @property
    def between(self) -> Vector:
        """Geometric mean of the two medians, which is the level between them for a power law."""
        return np.sqrt(self.left * self.right)


def flanks(values: Vector, freedom: Vector, nearest: int, farthest: int, *, least: int) -> Flanks:
    """Compute medians of the values `nearest` to `farthest` positions away on each side, divided by that of χ²_ν / ν to
    estimate the level; NaN with fewer than `least` values."""
    width = farthest - nearest + 1
    padded = np.concatenate([np.full(farthest, np.nan), values, np.full(farthest, np.nan)])
    finite_before = np.concatenate([[0], np.cumsum(~np.isnan(padded))])
    counts = finite_before[width:] - finite_before[:-width]
    medians = np.where(counts == width, _core.window_medians(padded, width), np.nan)
    partial = np.flatnonzero((counts >= least) & (counts < width))
    # NaN are last in sorted rows.
    ordered, number = np.sort(sliding_window_view(padded, width)[partial], axis=1), counts[partial]
    rows = np.arange(partial.size)
    medians[partial] = (ordered[rows, (number - 1) // 2] + ordered[rows, number // 2]) / 2
    shift = farthest + nearest
    before, after = medians[: values.size], medians[shift : shift + values.size]
    factor = (1 - 2 / (9 * freedom)) ** 3  # median of χ²_ν / ν (Wilson and Hilferty 1931)
    return Flanks(before / factor, after / factor)


def p_values(ratio: Vector, freedom: Vector, below: float) -> Vector:
    """Return the probability (F distribution) of a larger ratio to the flank's level in noise; 1 above `below`."""
    from scipy.special import fdtrc, fdtri

    # With fewer degrees of freedom, a ratio of the same significance is larger.
    most = float(np.nanmax(freedom, initial=1.0))
    large = ratio >= (1 - 1e-6) * float(fdtri(most, FLANK_SHARE * most, 1 - below))
    p = np.where(np.isnan(ratio), np.nan, 1.0)
    p[large] = fdtrc(freedom[large], FLANK_SHARE * freedom[large], ratio[large])
    return np.asarray(p)


def effective_freedom(density: Vector, freedom: Vector) -> Vector:
    """Return the degrees of freedom of each density, reduced where neighbours scatter more than in stationary noise."""
    from scipy.special import polygamma

    # Number of neighbouring frequencies whose scatter checks the degrees of freedom, with a standard error of 7 %.
    size = 256
    reduced = freedom.copy()
    with np.errstate(divide="ignore"):
        logs = np.log(density)
    firsts = np.arange(2, density.size - size // 4, size)
    expected = np.sqrt(polygamma(1, freedom[firsts + 1] / 2))
    complete = np.count_nonzero(firsts + size <= density.size)
    scatter = _scatter(logs[2 : 2 + complete * size].reshape(complete, size))
    if complete < firsts.size:
        scatter = np.append(scatter, _scatter(logs[None, firsts[-1] :]))
    for first, spread, usual in zip(firsts.tolist(), scatter.tolist(), expected.tolist(), strict=True):
        part = reduced[first : first + size]
        excess = spread / usual / (1 + 3 * 1.6 / np.sqrt(part.size))
        if part.size >= 16 and excess > 1:  # not where the scatter is NaN
            part /= excess**2
    return np.maximum(reduced, 1.0)


def _scatter(logs: Matrix) -> Vector:
    """Return the robust standard deviation (m,) of each group of logarithms (m, n); NaN if one is not finite."""
    # Values three bins apart are nearly independent, and their second differences remove a smooth spectrum.
    good = np.isfinite(logs).all(axis=1)
    scatter = np.full(len(logs), np.nan)
    if logs.shape[1] > 6:
        rows = logs[good]
        differences = np.abs(rows[:, 6:] - 2 * rows[:, 3:-3] + rows[:, :-6])
        scatter[good] = row_medians(differences) / 0.6745 / np.sqrt(6.0)
    return scatter


def pooled_freedom(freedom: Vector, count: Vector) -> Vector:
    """Return the freedom of the mean of `count` neighbouring densities, for a Hann window."""
    first, second = NEIGHBOURS
    return freedom * count / (1 + 2 * first * (1 - 1 / count) + 2 * second * np.maximum(1 - 2 / count, 0))
