"""Peaks in a spectrum: lines and bumps."""

from __future__ import annotations

from dataclasses import dataclass

LEAST_QUALITY = 60.0
"""Smallest ratio of frequency to width for which a peak is a line: twice the Q factor of a sharp resonance, 30."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """A line in a spectrum: a sinusoid, or a disturbance whose frequency wanders by less than 1/60 of itself.

    Attributes
    ----------
    frequency, frequency_error : float
        Frequency of the line (Hz) and its standard error. For a wandering line, it is the mean frequency.
    amplitude, amplitude_error : float
        Amplitude A of the sinusoid (u), √2 times its root mean square, and its standard error.
    width : float
        Width at half the power (Hz) without the width of the window; 0 if the line is narrower than can be measured.
    height : float
        Ratio of the density of the line to the local level.
    p_value : float
        Probability that noise gives so high a density at this frequency.
    harmonic, fundamental : int or None, float or None
        k and f₀ (Hz) if the frequency is k f₀ and other lines are at multiples of f₀ too. The fundamental itself has
        k = 1.
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
        """Whether the line is narrower than can be measured."""
        return self.width == 0

    def described(self, unit: str = "u") -> str:
        """Format frequency and amplitude with their standard errors, width and harmonic.

        Parameters
        ----------
        unit : str
            Unit of the amplitude.
        """
        width = "" if self.narrow else f", width {self.width:.3g} Hz"
        number = "" if self.harmonic is None else f", {self.harmonic} × {self.fundamental:.6g} Hz"
        return (
            f"{self.frequency:.6g} ± {self.frequency_error:.2g} Hz, amplitude {self.amplitude:.3g} ± "
            f"{self.amplitude_error:.1g} {unit}{width}{number}"
        )


@dataclass(frozen=True, kw_only=True)
class Bump:
    """A bump in a spectrum: a broad peak, such as a mechanical resonance of the sensor or its mounting.

    Attributes
    ----------
    frequency : float
        Frequency of the peak (Hz).
    width : float
        Width at half the power above the level beside it (Hz).
    height : float
        Ratio of the density at the peak to the level beside it.
    density : float
        Power spectral density at the peak (u²/Hz, one-sided).
    p_value : float
        Probability that noise gives so high a peak at this frequency.
    """

    frequency: float
    width: float
    height: float
    density: float
    p_value: float

    @property
    def quality(self) -> float:
        """Q factor: frequency divided by width."""
        return self.frequency / self.width

    def described(self) -> str:
        """Format frequency, height, width and Q."""
        size = f"{self.height:.3g} × its surroundings, width {self.width:.2g} Hz, Q {self.quality:.2g}"
        return f"{self.frequency:.3g} Hz, {size}"
