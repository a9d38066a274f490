"""Power spectral density of one signal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Vector, as_whole_number, freeze
from gmwm.base.documents import Documented
from gmwm.base.errors import DataError
from gmwm.base.results import Plotted, Tabular
from gmwm.base.text import Summarised, counted
from gmwm.measuring.axis_results import AxisResults, chi_square_limits
from gmwm.measuring.spectrum.line import Bump, Line, pooled_freedom
from gmwm.measuring.spectrum.welch import HALF_POWER_WIDTH
from gmwm.recording.options import as_confidence
from gmwm.recording.repairs.moving_average import MovingAverage

if TYPE_CHECKING:
    from polars import DataFrame


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PowerSpectrum(Documented, Summarised, Plotted, Tabular):
    """Power spectral density of a signal by Welch's method, with confidence limits, lines and bumps.

    Attributes
    ----------
    frequencies : (n,) array
        Frequencies (Hz), ascending, from 0 to half the rate.
    density : (n,) array, in unit²/Hz
        One-sided power spectral density, whose integral over the frequencies is the variance of the signal. The `psd`
        of a model is two-sided and therefore half as large.
    degrees_of_freedom : (n,) array
        Equivalent degrees of freedom of each density.
    rate, samples : float, int
        Sampling rate (Hz), and length of the signal, without the missing samples in gaps.
    length, blocks : int
        Length of the blocks (samples), and number of blocks.
    unit, axis, confidence : str, str, float
        Unit and name of the signal ("" if they are unknown), and confidence level of the limits.
    lines : tuple of Line
        Lines, sorted by frequency. The probability of any false line or bump in a recording of noise is at most 1 %.
    bumps : tuple of Bump
        Broad peaks, sorted by frequency.
    average : MovingAverage, optional
        Average of the last samples that the noise passed, if the zeros of the density show one.

    Examples
    --------
    >>> from gmwm import SIN, WN, psd
    >>> model = WN(sigma2=1.0) + SIN(frequency=12.5, power=0.02)
    >>> spectrum = psd(model.simulate(2**17, 100.0, rng=1), rate=100.0)
    >>> spectrum
    PowerSpectrum(unnamed, 15 blocks of 16384 samples, 131072 samples at 100 Hz, 1 line, 0 bumps)
    >>> line = spectrum.lines[0]
    >>> f"{line.frequency:.3f} Hz, {line.amplitude:.2f}"
    '12.500 Hz, 0.20'
    """

    frequencies: Vector
    density: Vector
    degrees_of_freedom: Vector
    rate: float
    samples: int
    length: int
    blocks: int
    unit: str = ""
    axis: str = ""
    confidence: float = 0.95
    lines: tuple[Line, ...] = ()
    bumps: tuple[Bump, ...] = ()
    average: MovingAverage | None = None

    document_keys = (
        "frequencies", "density", "degrees_of_freedom", "rate", "samples", "length", "blocks", "resolution", "unit",
        "axis", "confidence", "lines", "bumps",
    )  # fmt: skip

    def __post_init__(self) -> None:
        as_confidence(self.confidence)
        for name in ("frequencies", "density", "degrees_of_freedom"):
            freeze(getattr(self, name))
        if not self.frequencies.shape == self.density.shape == self.degrees_of_freedom.shape:
            raise DataError(
                argument="density", expected=f"one value for each of {len(self)} frequencies", got=self.density
            )

    @cached_property
    def _limits(self) -> tuple[Vector, Vector]:
        return chi_square_limits(self.density, self.degrees_of_freedom, self.confidence)

    @property
    def lower(self) -> Vector:
        """Lower confidence limits (n,), in unit²/Hz, by the chi-square distribution."""
        return self._limits[0]

    @property
    def upper(self) -> Vector:
        """Upper confidence limits (n,), in unit²/Hz."""
        return self._limits[1]

    @property
    def resolution(self) -> float:
        """Width (Hz), at half its power, of a sinusoid in this spectrum. Lines closer than this are not separated."""
        return HALF_POWER_WIDTH * self.rate / self.length

    @property
    def extent(self) -> str:
        """Number of blocks and samples, and the rate, as text."""
        return f"{self.blocks} blocks of {self.length} samples, {self.samples} samples at {self.rate:g} Hz"

    def __len__(self) -> int:
        return int(self.frequencies.size)

    def smoothed(self, per_octave: int = 24) -> PowerSpectrum:
        """Return the spectrum with densities averaged over bins of constant relative width, except around peaks.

        At low frequencies, and within six bins of a line, every frequency is kept. A bump has eight bins per width. The
        frequency 0, which contains the mean of the signal, and the last frequency are left out. `Calibration` stores
        this spectrum, and plots show it. `per_octave` is the number of bins per octave, at least 1."""
        as_whole_number(per_octave, "per_octave", 1)
        if self.frequencies[0] != 0:
            raise DataError("the spectrum is already smoothed", argument="spectrum", got=self)
        last, spacing = self.density.size - 1, self.rate / self.length
        # Up to this frequency, 1 / per_octave octaves contain fewer than two frequencies, so each frequency is one bin.
        single = min(last, math.ceil(per_octave / math.log(2)))
        steps = math.ceil(per_octave * math.log2(last / single)) + 1
        edges = {*range(1, single + 1), last}
        edges |= {round(single * 2 ** (step / per_octave)) for step in range(steps)}
        for line in self.lines:
            center = round(line.frequency / spacing)
            # Around a line of varying frequency, there are four bins per width of the line.
            step = max(1, round(line.width / spacing / 4))
            edges |= set(range(center - 6 * step, center + 6 * step + 2, step))
        for bump in self.bumps:
            step, center = max(1, round(bump.width / spacing / 8)), round(bump.frequency / spacing)
            edges |= set(range(center - 24 * step, center + 24 * step + 1, step))
        begins = np.array(sorted(edge for edge in edges if 1 <= edge < last), dtype=np.int64)
        count = np.diff(np.append(begins, last)).astype(np.float64)
        density, frequencies, freedom = (
            np.add.reduceat(values[:last], begins) / count
            for values in (self.density, self.frequencies, self.degrees_of_freedom)
        )
        return replace(
            self, frequencies=frequencies, density=density, degrees_of_freedom=pooled_freedom(freedom, count),
        )  # fmt: skip

    def detectable_amplitude(self, frequency: ArrayLike, power: float = 0.9) -> Vector:
        """Return the smallest amplitude (u) of a sinusoid that is found as a line with a given probability.

        `frequency` (Hz) may be an array. `power` is the probability of detection, from 0.5 to below 1. The amplitude is
        NaN if a frequency is too close to 0 or above half the rate. Raises DataError if the spectrum is smoothed.

        >>> from gmwm import psd
        >>> x = np.random.default_rng(1).normal(size=2**17)
        >>> psd(x, rate=100.0).detectable_amplitude([1.0, 30.0]).round(3)
        array([0.035, 0.036])
        """
        from gmwm.measuring.spectrum.peaks import detectable_amplitude

        return detectable_amplitude(self, frequency, power)

    coordinates = ("frequency",)

    def to_polars(self) -> DataFrame:
        """Return a Polars data frame with the columns frequency, density, lower, upper and degrees_of_freedom."""
        from polars import DataFrame

        return DataFrame(
            {
                "frequency": self.frequencies, "density": self.density, "lower": self.lower, "upper": self.upper,
                "degrees_of_freedom": self.degrees_of_freedom,
            }
        )  # fmt: skip

    def summary(self) -> str:
        """Format the root density in each octave, the lines and the bumps."""
        unit = self.unit or "u"
        lines = [
            f"Power spectral density{' of ' + self.axis if self.axis else ''}: {self.extent}, "
            f"resolution {self.resolution:.3g} Hz",
            f"{'frequency [Hz]':>14} {f'root density [{unit}/√Hz]':>26} {'lower':>12} {'upper':>12}",
        ]
        octaves = self.smoothed(1) if self.frequencies[0] == 0 else self
        rows = zip(octaves.frequencies, octaves.density, octaves.lower, octaves.upper, strict=True)
        lines += [
            f"{f:14.5g} {math.sqrt(d):26.4e} {math.sqrt(low):12.4e} {math.sqrt(high):12.4e}" for f, d, low, high in rows
        ]
        lines.append(f"limits: {100 * self.confidence:g} % chi-square")
        lines += [f"line: {line.described(unit)}" for line in self.lines]
        lines += [f"bump: {bump.described()}" for bump in self.bumps]
        return "\n".join(lines)

    def __repr__(self) -> str:
        peaks = f"{counted(len(self.lines), 'line')}, {counted(len(self.bumps), 'bump')}"
        return f"PowerSpectrum({self.axis or 'unnamed'}, {self.extent}, {peaks})"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class PowerSpectra(AxisResults[PowerSpectrum]):
    """Power spectral densities of the axes of one recording, as a mapping of axis to `PowerSpectrum`.

    Parameters
    ----------
    spectra : mapping of axis to PowerSpectrum
        The spectrum of each axis, at least one.

    Examples
    --------
    >>> from gmwm import psd, simulate
    >>> spectra = psd(simulate("WN(sigma2=4e-8)", rate=100.0, samples=1000, rng=1)["gyro"])
    >>> spectra
    PowerSpectra(gyro_x, gyro_y, gyro_z: 30 blocks of 64 samples, 1000 samples at 100 Hz)
    """

    spectra: Mapping[str, PowerSpectrum]
    noun = "spectrum"

    def summary(self) -> str:
        """Format, for every axis, the root density in each octave, the lines and the bumps."""
        return "\n\n".join(spectrum.summary() for spectrum in self.spectra.values())

    def __repr__(self) -> str:
        return f"PowerSpectra({', '.join(self)}: {next(iter(self.spectra.values())).extent})"
