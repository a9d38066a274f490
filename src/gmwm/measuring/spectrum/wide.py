"""Search for wide peaks on grids of constant relative resolution: bumps, and lines of varying frequency."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix, Vector
from gmwm.measuring.spectrum.line import (
    LEAST_QUALITY,
    Bump,
    Line,
    flanks,
    lorentz_fit,
    measured_line,
    p_values,
    pooled_freedom,
)
from gmwm.measuring.spectrum.narrow import FIRST_BIN

if TYPE_CHECKING:
    from gmwm.measuring.spectrum.result import PowerSpectrum

RESOLUTIONS = tuple(6 * 2**k for k in range(9, -1, -1))
"""Number of bins per octave of each grid, the finest first, for widths from 0.02 % to 50 % of the frequency."""
NEAR, FAR = 4, 11  # Distances, in bins of the grid, at which the flanks begin and end. A flank has 8 bins
INNER, OUTER = 1, 5
"""Distances (bins): the excess at 2 to 5 bins must be below half of that within one, so flanks are outside the peak."""
AROUND, PER_WIDTH = 3.0, 6.0
"""The fit uses the frequencies within three widths on each side, and bins of at most a sixth of the width."""


class DensityGrid(NamedTuple):
    """Means of the density over bins of a constant relative width; NaN in bins that contain only lines."""

    frequencies: Vector
    density: Vector
    freedom: Vector
    per_octave: int


class WidePeak(NamedTuple):
    """Significant peak on a grid. `compact` tells whether the grid is coarse enough; the others are as in `Bump`."""

    frequency: float
    width: float
    density: float
    level: float
    freedom: float
    p_value: float
    compact: bool

    @property
    def height(self) -> float:
        """Ratio of the density at the peak to the level on both sides of it."""
        return self.density / self.level


def grid_of(values: Matrix, per_octave: int) -> DensityGrid:
    """Return the means of densities, frequencies and freedoms over bins of 1 / per_octave octaves, each with at least
    two frequencies; the last row of `values` (4, n) is 1, and all are 0 where a narrow peak is left out."""
    size = values.shape[1] - 1
    lowest = max(FIRST_BIN, math.ceil(2 * per_octave / math.log(2)))
    count = int(per_octave * math.log2(size / lowest)) + 1 if lowest < size else 0
    edges = np.round(lowest * 2.0 ** (np.arange(count + 1) / per_octave)).astype(np.int64)
    edges = edges[(np.diff(edges, prepend=0) > 0) & (edges <= size)]
    if edges.size < 2:
        empty = np.empty(0)
        return DensityGrid(empty, empty, empty, per_octave)
    sums = np.add.reduceat(values[:, : edges[-1]], edges[:-1], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        density, frequencies, freedom = sums[:3] / sums[3]
        freedom = pooled_freedom(freedom, sums[3])
    return DensityGrid(frequencies, density, freedom, per_octave)


def wide_peaks(
    spectrum: PowerSpectrum, freedom: Vector, free: NDArray[np.bool_], *, narrow: tuple[Sequence[Line], Sequence[Bump]],
    level: float,
) -> tuple[list[Line], list[Bump]]:  # fmt: skip
    """Return significant wide lines and bumps (Bonferroni over all bins of all grids), without broad bases of those in
    `narrow`; `free` marks bins without a narrow peak."""
    values = np.where(free, [spectrum.density, spectrum.frequencies, freedom, np.ones(free.size)], 0.0)
    grids = [grid_of(values, resolution) for resolution in RESOLUTIONS]
    tests = max(1, sum(grid.density.size for grid in grids))
    peaks: list[WidePeak] = []
    wider: list[WidePeak] = []
    for grid in grids:
        for peak in _peaks(grid, level / tests):
            if _is_known(peak, *narrow) or any(_overlap(peak, other, grid) for other in peaks):
                continue
            (peaks if peak.compact else wider).append(peak)
    # The remaining peaks are so close to an end of the spectrum that no coarser grid can measure them.
    for peak in reversed(wider):
        if not any(_overlap(peak, other, None) for other in peaks):
            peaks.append(peak)
    peaks = [_fit_shape(peak, grids) for peak in peaks]
    lines = [_line(spectrum, peak) for peak in peaks if peak.frequency >= LEAST_QUALITY * peak.width]
    bumps = [
        Bump(
            frequency=peak.frequency, width=peak.width, height=peak.height, density=peak.density, p_value=peak.p_value
        )
        for peak in peaks
        if peak.frequency < LEAST_QUALITY * peak.width
    ]  # fmt: skip
    return lines, bumps


def _peaks(grid: DensityGrid, level: float) -> list[WidePeak]:
    """Return the significant peaks of one grid, the most significant first."""
    if grid.density.size < 2 * NEAR:
        return []
    with np.errstate(invalid="ignore", divide="ignore"):
        surroundings = flanks(grid.density, grid.freedom, NEAR, FAR, least=3)
        ratio = grid.density / surroundings.level
        p = p_values(ratio, grid.freedom, level)
    top = np.ones(ratio.size, dtype=bool)
    top[1:] &= ~(grid.density[1:] < grid.density[:-1])
    top[:-1] &= ~(grid.density[:-1] < grid.density[1:])
    # Smallest ratio of a bump to both sides; ripples of a filter's response are smaller.
    (hits,) = np.nonzero(top & np.isfinite(p) & (p < level) & (ratio >= 1.25))
    peaks = []
    for k in sorted(hits.tolist(), key=lambda k: -ratio[k]):
        between = float(surroundings.between[k])
        width = _width(grid, k, (float(grid.density[k]) + between) / 2)
        if width is not None:
            peaks.append(
                WidePeak(
                    frequency=_summit(grid, k), width=width, density=float(grid.density[k]), level=between,
                    freedom=float(grid.freedom[k]), p_value=float(p[k]), compact=_is_compact(grid, k, between),
                )
            )  # fmt: skip
    return peaks


def _fit_shape(peak: WidePeak, grids: Sequence[DensityGrid]) -> WidePeak:
    """Return the peak with the frequency and the width of a fitted Lorentz shape; a peak with a low Q is unchanged."""
    if peak.frequency < 3.0 * peak.width:
        return peak
    fine = [grid for grid in grids if peak.frequency * math.log(2) / grid.per_octave <= peak.width / PER_WIDTH]
    # The coarsest of the fine grids that reach down to the peak is used, or else the finest grid that reaches it.
    reaching = [grid for grid in grids if grid.density.size and grid.frequencies[0] < peak.frequency - peak.width]
    usable = [grid for grid in fine if any(grid is other for other in reaching)] or reaching[:1]
    if not usable:
        return peak
    grid = usable[-1]
    part = (np.abs(grid.frequencies - peak.frequency) < AROUND * peak.width) & (grid.density > 0)
    fit = lorentz_fit(
        grid.frequencies[part], grid.density[part], grid.freedom[part], center=peak.frequency, width=peak.width
    )
    return peak if fit is None else peak._replace(frequency=fit[0], width=fit[1])


def _width(grid: DensityGrid, k: int, half: float) -> float | None:
    """Return the width (Hz) at which the peak falls to `half`, minus bin widths in quadrature; None without a side."""
    ends = []
    for step in (-1, 1):
        j = k
        while 0 <= j + step < grid.density.size and not grid.density[j + step] < half:
            j += step
        if not 0 <= j + step < grid.density.size or math.isnan(grid.density[j]):
            return None
        inside, outside = grid.density[j], grid.density[j + step]
        share = (inside - half) / (inside - outside)
        ends.append(grid.frequencies[j] + share * (grid.frequencies[j + step] - grid.frequencies[j]))
    width, bin_width = ends[1] - ends[0], grid.frequencies[k] * math.log(2) / grid.per_octave
    return float(math.sqrt(max(width**2 - bin_width**2, bin_width**2 / 4)))


def _summit(grid: DensityGrid, k: int) -> float:
    """Return the frequency (Hz) of the peak at bin k, by a parabola through the logarithms of three bins."""
    with np.errstate(divide="ignore"):
        before, top, after = np.log(grid.density[k - 1 : k + 2])
    curve = before - 2 * top + after
    shift = 0.5 * (before - after) / curve if np.isfinite(curve) and curve < 0 else 0.0
    return float(grid.frequencies[k] * 2 ** (np.clip(shift, -0.5, 0.5) / grid.per_octave))


def _is_compact(grid: DensityGrid, k: int, level: float) -> bool:
    """Return whether most of the excess of the peak at bin k over `level` is within one bin."""
    first = max(k - OUTER, 0)
    excess = np.nan_to_num(grid.density[first : k + OUTER + 1] - level)
    near = np.abs(np.arange(excess.size) - (k - first)) <= INNER
    return float(excess[~near].sum()) <= float(excess[near].sum()) / 2


def _overlap(peak: WidePeak, other: WidePeak, grid: DensityGrid | None) -> bool:
    """Return whether two peaks are the same: closer than the wider one, or than two bins of `grid`."""
    bin_width = 0.0 if grid is None else 2 * other.frequency * math.log(2) / grid.per_octave
    return abs(peak.frequency - other.frequency) <= max(peak.width, other.width, bin_width)


def _is_known(peak: WidePeak, lines: Sequence[Line], bumps: Sequence[Bump]) -> bool:
    """Return whether a peak is a narrow bump's flank, or the broad base (< half the power) of an unsteady line."""
    if any(abs(bump.frequency - peak.frequency) <= 4 * bump.width + peak.width for bump in bumps):
        return True
    # The power of a Lorentz shape is π/2 times its height and its width.
    power = np.pi / 2 * (peak.density - peak.level) * peak.width
    return any(abs(line.frequency - peak.frequency) <= peak.width and power < line.amplitude**2 / 4 for line in lines)


def _line(spectrum: PowerSpectrum, peak: WidePeak) -> Line:
    """Measure a wide peak that is narrow enough to be a line."""
    spacing = spectrum.rate / spectrum.length
    reach = 1.5 * peak.width
    first = max(FIRST_BIN, round((peak.frequency - reach) / spacing))
    last = min(spectrum.density.size - 2, round((peak.frequency + reach) / spacing))
    line = measured_line(
        spectrum, first, last, level=peak.level, freedom=float(spectrum.degrees_of_freedom[first]),
        height=peak.height, p_value=peak.p_value,
    )  # fmt: skip
    return replace(line, width=peak.width)
