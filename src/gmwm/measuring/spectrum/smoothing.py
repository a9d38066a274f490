"""Average a spectrum over bins of constant relative width, but keep the full resolution around lines."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.errors import DataError
from gmwm.measuring.spectrum.level import pooled_freedom
from gmwm.recording.options import as_whole_number

if TYPE_CHECKING:
    from gmwm.measuring.spectrum.result import PowerSpectrum

AROUND = 6
"""Number of bins on each side of a line that are not averaged: four that the window affects, and some of the level."""


def smoothed(spectrum: PowerSpectrum, per_octave: int = 24) -> PowerSpectrum:
    """Average the densities over 1 / per_octave octaves, except around lines; see `PowerSpectrum.smoothed`."""
    as_whole_number(per_octave, "per_octave", 1)
    if spectrum.frequencies[0] != 0:
        raise DataError("the spectrum is already smoothed", argument="spectrum", got=spectrum)
    last, spacing = spectrum.density.size - 1, spectrum.rate / spectrum.length
    # Up to this frequency, 1 / per_octave octaves contain fewer than two frequencies, so each frequency is one bin.
    single = min(last, math.ceil(per_octave / math.log(2)))
    steps = math.ceil(per_octave * math.log2(last / single)) + 1
    edges = {*range(1, single + 1), last}
    edges |= {round(single * 2 ** (step / per_octave)) for step in range(steps)}
    for line in spectrum.lines:
        center = round(line.frequency / spacing)
        # Around a line of varying frequency, there are four bins per width of the line.
        step = max(1, round(line.width / spacing / 4))
        edges |= set(range(center - AROUND * step, center + AROUND * step + 2, step))
    begins = np.array(sorted(edge for edge in edges if 1 <= edge < last), dtype=np.int64)
    count = np.diff(np.append(begins, last)).astype(np.float64)
    density, frequencies, freedom = (
        np.add.reduceat(values[:last], begins) / count
        for values in (spectrum.density, spectrum.frequencies, spectrum.degrees_of_freedom)
    )
    return replace(
        spectrum,
        frequencies=frequencies,
        density=density,
        degrees_of_freedom=pooled_freedom(freedom, count),
    )
