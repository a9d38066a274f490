"""Tables of the lines and the broad peaks in the spectrum of an axis."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gmwm.base.units import find_unit, parse_unit
from gmwm.choosing.datasheets.entry import significant
from gmwm.showing.plots.view import DATASHEET_UNIT

if TYPE_CHECKING:
    from gmwm.measuring.spectrum import PowerSpectrum

Rows = list[list[str]]
"""Rows of a table below a row of headings; empty if there is nothing to show."""


def spectrum_tables(spectrum: PowerSpectrum | None) -> dict[str, Rows]:
    """Return the tables "lines" and "bumps" of a spectrum. Amplitudes are in datasheet units if the signal has such."""
    if spectrum is None:
        return {"lines": [], "bumps": []}
    unit, factor = _amplitude_unit(spectrum.unit)
    lines = [
        [
            f"{line.frequency:.5g}", f"{significant(line.frequency_error, 1)}", significant(factor * line.amplitude, 3),
            significant(factor * line.amplitude_error, 1),
            "below the resolution" if line.narrow else significant(line.width, 2), significant(line.height, 3),
            "" if line.harmonic is None else f"{line.harmonic} × {line.fundamental:.5g} Hz",
        ]
        for line in spectrum.lines
    ]  # fmt: skip
    bumps = [
        [f"{bump.frequency:.4g}", significant(bump.width, 2), significant(bump.quality, 2), significant(bump.height, 3)]
        for bump in spectrum.bumps
    ]
    heads = ["Frequency (Hz)", "Standard error (Hz)", f"Amplitude{unit}", "Standard error", "Width (Hz)"]
    return {
        "lines": [[*heads, "Height above the level", "Harmonic"], *lines] if lines else [],
        "bumps": [["Frequency (Hz)", "Width (Hz)", "Q", "Height above the level"], *bumps] if bumps else [],
    }


def _amplitude_unit(unit: str) -> tuple[str, float]:
    """Return the unit of amplitudes in parentheses, and the conversion factor to it from the unit of the signal."""
    definition = find_unit(unit)
    if definition is None:
        return f" ({unit})" if unit else "", 1.0
    shown = parse_unit(DATASHEET_UNIT[definition.quantity], definition.quantity)
    return f" ({shown.name})", definition.factor / shown.factor
