"""Power spectral densities of all axes of a recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

from gmwm.base.errors import DataError
from gmwm.base.plotting import Plotted
from gmwm.base.text import Summarised
from gmwm.measuring.spectrum.result import PowerSpectrum


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class PowerSpectra(Summarised, Plotted, Mapping[str, PowerSpectrum]):
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

    def __post_init__(self) -> None:
        if not self.spectra:
            raise DataError(argument="spectra", expected="the spectrum of at least one axis", got=self.spectra)
        object.__setattr__(self, "spectra", MappingProxyType(dict(self.spectra)))

    def __reduce__(self) -> tuple[Any, ...]:
        # A mapping proxy cannot be pickled, so the copy is rebuilt from a plain dict.
        return partial(PowerSpectra, spectra=dict(self.spectra)), ()

    def __getitem__(self, axis: str) -> PowerSpectrum:
        try:
            return self.spectra[axis]
        except KeyError:
            raise DataError(argument="axis", expected=f"one of {', '.join(self.spectra)}", got=axis) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.spectra)

    def __len__(self) -> int:
        return len(self.spectra)

    def __contains__(self, axis: object) -> bool:
        return axis in self.spectra

    def get(self, axis: str, default: Any = None) -> Any:
        """Return the spectrum of an axis, or `default` if there is none."""
        return self.spectra.get(axis, default)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields of each axis as plain numbers, lists and strings, by axis."""
        return {axis: spectrum.to_dict() for axis, spectrum in self.spectra.items()}

    def summary(self) -> str:
        """Format, for every axis, the root density in each octave, the lines and the bumps."""
        return "\n\n".join(spectrum.summary() for spectrum in self.spectra.values())

    def __repr__(self) -> str:
        return f"PowerSpectra({', '.join(self)}: {next(iter(self.spectra.values())).extent})"
