"""Lines and bumps, which are the two kinds of peaks in a spectrum."""

from __future__ import annotations

from dataclasses import dataclass

LEAST_QUALITY = 60.0
"""Smallest ratio of frequency to width of a line, twice the Q factor of a sharp resonance, 30."""


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

    def described(self, unit: str = "u") -> str:
        """Format the frequency and the amplitude (in `unit`) with their standard errors, the width and the harmonic."""
        width = "" if self.narrow else f", width {self.width:.3g} Hz"
        number = "" if self.harmonic is None else f", {self.harmonic} × {self.fundamental:.6g} Hz"
        return (
            f"{self.frequency:.6g} ± {self.frequency_error:.2g} Hz, amplitude {self.amplitude:.3g} ± "
            f"{self.amplitude_error:.1g} {unit}{width}{number}"
        )


@dataclass(frozen=True, kw_only=True)
class Bump:
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

    @property
    def quality(self) -> float:
        """Q factor, which is the frequency divided by the width."""
        return self.frequency / self.width

    def described(self) -> str:
        """Format the frequency, the height, the width and the Q factor."""
        size = f"{self.height:.3g} × its surroundings, width {self.width:.2g} Hz, Q {self.quality:.2g}"
        return f"{self.frequency:.3g} Hz, {size}"
