"""Narrow peaks of a spectrum, and resonances that are resolved."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.lazy import scipy
from gmwm.measuring.spectrum.line import LEAST_QUALITY, Bump, Line, flanks, lorentz_fit, measured_line, p_values
from gmwm.measuring.spectrum.result import PowerSpectrum
from gmwm.measuring.spectrum.welch import HALF_POWER_WIDTH

FIRST_BIN = 2
"""First bin that is used. The subtraction of the mean affects the bins 0 and 1, because of the Hann window."""
NEAR, FAR = 4, 19  # distances (bins) of the flanks of a line: 16 bins outside the four of the Hann window
LEAST_FLANK = 6  # smallest number of bins of a flank; with fewer, the frequency is too close to zero for the test
INNER, OUTER = 2, 8
"""A peak is narrow if the excess at 3 to 8 bins from it is less than half of the excess within 2 bins."""


def narrow_lines(
    spectrum: PowerSpectrum, freedom: Vector, testable: NDArray[np.bool_], *, level: float
) -> tuple[list[Line], list[Bump], NDArray[np.bool_]]:
    """Return significant narrow lines and bumps (peaks with the shape of a resonance), and the bins without them;
    `level` holds for all `testable` bins (Bonferroni)."""
    density, size = spectrum.density, spectrum.density.size - 1
    free = testable.copy()
    # The spectrum of a sampled signal is symmetric about half the rate, so a line close to it has flanks on both sides.
    # The density at half the rate is not doubled in a one-sided spectrum and is left out.
    shown = np.concatenate([density[FIRST_BIN:size], density[size - 1 : size - 1 - FAR : -1]])
    of_each = np.concatenate([freedom[FIRST_BIN:size], freedom[size - 1 : size - 1 - FAR : -1]])
    surroundings = flanks(shown, of_each, NEAR, FAR, least=LEAST_FLANK)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = shown / surroundings.level
    tested = ~np.isnan(ratios) & (surroundings.level > 0)
    tested[size - FIRST_BIN :] = False
    tested[: size - FIRST_BIN] &= testable[FIRST_BIN:size]
    level /= max(int(np.count_nonzero(tested)), 1)
    p = p_values(ratios, of_each, level)
    (hits,) = np.nonzero(tested & (p < level))
    lines: list[Line] = []
    bumps: list[Bump] = []
    for k in sorted(hits.tolist(), key=lambda k: -shown[k]):
        if not free[k + FIRST_BIN]:
            continue
        between = float(surroundings.between[k])
        half = _half_width(shown, k, between, between * math.sqrt(2 / float(of_each[k])))
        if half is None:
            continue
        ratio = float(shown[k] / between)
        center = k + FIRST_BIN
        first, last = max(center - half, FIRST_BIN), min(center + half, size - 1)
        line = measured_line(
            spectrum, first, last, level=between, freedom=float(of_each[k]), height=ratio, p_value=float(p[k])
        )
        width = _resonance_width(spectrum, line, freedom)
        if width is not None:
            bumps.append(
                Bump(frequency=line.frequency, width=width, height=ratio, density=float(shown[k]), p_value=line.p_value)
            )
            # No further peak is searched within the resonance.
            free[max(center - OUTER, 0) : center + OUTER + 1] = False
            continue
        lines.append(line)
        # Outside `skirt` bins, the side lobes of the line are below a tenth of the level. They fall as 1 / π² x⁶.
        skirt = max(half, math.ceil((10 * ratio / math.pi**2) ** (1 / 6)))
        free[max(center - skirt, 0) : center + skirt + 1] = False
    return lines, bumps, free


def _resonance_width(spectrum: PowerSpectrum, line: Line, freedom: Vector) -> float | None:
    """Return the width (Hz) of a resonance of few bins; None if too narrow. A Hann window of width v makes it a Voigt
    shape, fitted by 0.5346 w + √(0.2166 w² + v²) (Olivero and Longbothum)."""
    if line.narrow or line.frequency >= LEAST_QUALITY * line.width:
        return None
    spacing = spectrum.rate / spectrum.length
    part = np.abs(spectrum.frequencies - line.frequency) <= FAR * spacing
    part[:FIRST_BIN] = part[-1] = False
    fit = lorentz_fit(
        spectrum.frequencies[part], spectrum.density[part], freedom[part], center=line.frequency, width=line.width
    )
    if fit is None:
        return None
    seen, window = fit[1], HALF_POWER_WIDTH * spacing
    a = 0.5346**2 - 0.2166
    b = 2 * 0.5346 * seen
    width = (b - math.sqrt(max(b**2 - 4 * a * (seen**2 - window**2), 0.0))) / (2 * a)
    return width if width > spacing and line.frequency < LEAST_QUALITY * width else None


def _half_width(density: Vector, k: int, level: float, noise: float) -> int | None:
    """Return the bins on each side with the power of the peak at k, or None; `noise`: standard error of a density."""
    # Number of bins on each side of a line, which contain all of its power except a share of 7e-5.
    core = 3
    # Standard error of the summed excess at 3 to 8 bins on both sides, relative to one density: √12 for 12 bins, √1.94
    # for the correlation of neighbours, and 12 times 0.3 for the error of the level.
    outside_noise = 6.0
    excess = density[max(k - OUTER, 0) : k + OUTER + 1] - level
    distance = np.abs(np.arange(excess.size) - min(k, OUTER))
    inside, outside = float(excess[distance <= INNER].sum()), float(excess[distance > INNER].sum())
    if outside > inside / 2 + outside_noise * noise:
        return None
    # The peak is wider than the core if the power outside the core exceeds what the window and the noise explain.
    beyond = float(excess[distance > core].sum())
    return OUTER if beyond > inside / 10 + outside_noise * noise else core


_BINS, _WIDTHS = 40, 6.0
"""Distance from the peak up to which the density is fitted: at least in bins, and in widths of the peak."""
_MOST = 200  # number of densities from which neighbours are averaged
_SINUSOID = 0.01  # damping times the length of a block of a line that is indistinguishable from a sinusoid
_GAIN = 25.0
"""Gain of deviance by a width that < 1 of 200 sinusoids in noise exceeds (tests/spectrum/test_resonance.py)."""


class Resonance(NamedTuple):
    """A damped oscillator with its natural frequency (Hz), its quality and its variance (u²)."""

    frequency: float
    quality: float
    variance: float


def resonance_of(spectrum: PowerSpectrum, peak: Line | Bump, others: Iterable[Line | Bump]) -> Resonance | None:
    """Return the oscillator that a peak shows; None for a sinusoid, or a failed fit. The Lorentz density over Hann
    blocks has a closed form, also below the resolution: a sinusoid has no far flanks."""
    spacing = spectrum.rate / spectrum.length
    reach = min(max(_BINS * spacing, _WIDTHS * peak.width), 0.8 * peak.frequency)
    used = np.abs(spectrum.frequencies - peak.frequency) <= reach
    used[:FIRST_BIN] = used[-1] = False
    for other in others:
        apart = abs(other.frequency - peak.frequency)
        if apart > max(4 * spacing, peak.width):
            used &= np.abs(spectrum.frequencies - other.frequency) > min(max(6 * spacing, 2 * other.width), apart / 2)
    used &= spectrum.density > 0
    size = max(1, int(np.count_nonzero(used)) // _MOST)
    frequencies, density = (_means(values[used], size) for values in (spectrum.frequencies, spectrum.density))
    # Neighbouring densities of a Hann window are correlated: 1.94 of them have the freedom of one.
    freedom = _means(spectrum.degrees_of_freedom[used], size) * max(size / 1.94, 1.0)
    if density.size < 12:
        return None
    block, logs = spectrum.length / spectrum.rate, np.log(frequencies / peak.frequency)
    level = float(np.median(density))
    weights = np.sqrt(freedom)
    # Density of an oscillator relative to a Lorentz peak, which is symmetric.
    bend = (2 * peak.frequency / (peak.frequency + frequencies)) ** 2

    @lru_cache(maxsize=1)
    def at(values: bytes) -> tuple[Vector, Matrix]:
        """Return the residuals of a model and their derivatives (n, q) by its parameters."""
        parameters = np.frombuffer(values)
        a, slope, height, shift, *width = np.clip(parameters, -200, 200)
        wide = math.exp(min(width[0], 25.0)) if width else 0.0
        shape, slopes = _hann_lorentz(wide + _SINUSOID, 2 * math.pi * block * (frequencies - peak.frequency) - shift)
        smooth, factor = np.exp(np.clip(a + slope * logs, -200, 200)), np.exp(height) * bend
        ratio = density / (smooth + factor * shape)
        root = np.sqrt(np.maximum(ratio - 1 - np.log(ratio), 0.0))
        steep = np.divide(np.abs(ratio - 1), root, out=np.full(ratio.size, math.sqrt(2)), where=root > 0)
        columns = [smooth, smooth * logs, factor * shape, -factor * slopes.imag, factor * slopes.real * wide]
        derivatives = (-0.5 * weights * steep * ratio / density * np.array(columns[: parameters.size])).T
        return weights * np.sign(ratio - 1) * root, derivatives * (np.abs(parameters) < 200)

    def residuals(parameters: Vector) -> Vector:
        return at(parameters.tobytes())[0]

    def jacobian(parameters: Vector) -> Matrix:
        return at(parameters.tobytes())[1]

    top = float(density.max())
    damping = max(math.pi * peak.width * block, 0.3)
    start = np.array([math.log(level), 0.0, math.log(max(top, 2 * level) * (1 + damping)), 0.0])
    sinusoid, fit = (
        scipy.optimize.least_squares(residuals, first, jacobian, method="lm", max_nfev=300)
        for first in (start, np.append(start, math.log(damping)))
    )
    if not fit.success or 2 * float(sinusoid.cost - fit.cost) < _GAIN:
        return None
    damping = math.exp(min(fit.x[4], 25.0)) + _SINUSOID
    frequency = peak.frequency + float(fit.x[3]) / (2 * math.pi * block)
    if abs(frequency - peak.frequency) > max(2 * spacing, peak.width):
        return None
    return Resonance(frequency, math.pi * frequency * block / damping, math.exp(fit.x[2]) / (2 * block))


def _hann_lorentz(damping: float, distance: Vector) -> tuple[Vector, NDArray[np.complex128]]:
    """Return f = ∫₀¹ e^(−αu) cos(δu) c(u) du, autocorrelation c of the Hann window, α = πwT, δ in rad per block, and
    ∂f/∂α + i ∂f/∂δ."""
    s = damping - 1j * distance
    turn, part = 2j * math.pi, 1j / (4 * math.pi)
    total, slope = np.zeros_like(s), np.zeros_like(s)
    # ∫₀¹ e^(−zu) du = (1 − e^(−z)) / z for z = s and s ± 2πi, whose e^(−z) is the same, and ∫₀¹ (1 − u) e^(−zu) du.
    fallen = -np.expm1(-s)
    for z, triangle, plain in ((s, 2 / 3, 0.0), (s + turn, 1 / 6, part), (s - turn, 1 / 6, -part)):
        mean = fallen / z
        taper, mean_slope = (1 - mean) / z, (1 - fallen - mean) / z
        total += triangle * taper + plain * mean
        slope += plain * mean_slope - triangle * (taper + mean_slope) / z
    return np.maximum(total.real, 1e-300), slope


def _means(values: Vector, size: int) -> Vector:
    """Return the means of groups of neighbours."""
    count = values.size - values.size % size
    return np.asarray(values[:count].reshape(-1, size).mean(axis=1))
