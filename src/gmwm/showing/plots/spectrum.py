"""Plot of a power spectral density with its lines and bumps, and with the density of a model."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.errors import OptionError
from gmwm.base.units import datasheet_units, noise_unit
from gmwm.measuring.spectrum.welch import ENERGY_WIDTH
from gmwm.showing.plots.axes import limits_near, limits_of, power_ticks, value_axis
from gmwm.showing.plots.curves import ABOVE, FRONT, MIDDLE, confidence_band
from gmwm.showing.plots.figure import Axis, Figure, Mark, Panel, Polyline, Stroke, drawable, drawing, single_panel
from gmwm.showing.plots.fit import MOST_SINUSOIDS
from gmwm.showing.plots.imu import grid_figure
from gmwm.showing.plots.labels import OSCILLATIONS, UnitSystem, axis_title, model_text, shared_name
from gmwm.showing.plots.style import BLUE, IMPLIED, OSCILLATING, SOLID, VERMILLION, term_strokes
from gmwm.theory.processes.model import ModelLike, as_model
from gmwm.theory.processes.ordered import Ordered
from gmwm.theory.processes.oscillator import name_in_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gmwm.measuring.spectrum import PowerSpectrum

FOUND = Stroke(VERMILLION, 0.0, SOLID, "down")  # stroke of the symbol that marks a line in the spectrum
BROAD = Stroke(VERMILLION, 0.0, SOLID, "diamond", filled=False)
"""Stroke of the symbol that marks a bump in the spectrum."""


def density_unit(unit: str, units: UnitSystem) -> tuple[str, float]:
    """Return the unit of the root density of data in `unit`, and the conversion factor to this unit."""
    if units not in ("si", "datasheet", "auto"):
        raise OptionError(argument="units", expected='"si" or "datasheet" (deg/s/√Hz, µg/√Hz)', got=units)
    si, factor = noise_unit(0.5, unit)
    densities = [(name, size) for name, size in datasheet_units(si).items() if name.endswith("/√Hz")]
    if units == "si" or (units == "auto" and not densities):
        return si, factor
    if not densities:
        raise OptionError(
            f"datasheet units need data in a unit of angular rate or acceleration; got {unit or 'no unit'}",
            argument="units", got=units, advice="Use {--units=si}, or give the signal a unit such as rad/s.",
        )  # fmt: skip
    return densities[0][0], factor * densities[0][1]


def spectrum_panel(
    spectrum: PowerSpectrum, *, model: ModelLike | None = None, units: UnitSystem = "si", alone: bool = True
) -> Panel:
    """Return `plot_spectrum`'s panel; if not `alone`, the shared legend names neither frequencies nor the model."""
    shown = spectrum.smoothed() if spectrum.frequencies[0] == 0 else spectrum
    unit, factor = density_unit(shown.unit, units)
    f, y = shown.frequencies, drawable(factor * np.sqrt(shown.density))
    lower, upper = (np.where(np.isfinite(y), factor * np.sqrt(limit), np.nan) for limit in (shown.lower, shown.upper))
    marks: list[Mark] = [
        Polyline(f, y, stroke=Stroke(BLUE, 0.9), label="Spectrum", layer=FRONT),
        confidence_band(f, lower, upper, colour=BLUE, label=f"{100 * shown.confidence:g} % limits"),
    ]
    curves: list[Polyline] = []
    if model is not None:
        curves = _model_lines(shown, model, factor=factor, alone=alone)
    marks += [*curves, *_peak_marks(shown, y, alone=alone)]
    symbols = [mark.y for mark in marks[2 + len(curves) :] if isinstance(mark, Polyline)]
    tops = [line.y[:1] for line in curves[:1]]
    # Limits and models extend the axis by a factor of 5 at most (tests/plots/test_plot_limits.py).
    limits = limits_near(y, [lower, upper, *tops, *symbols], reach=5.0)
    return Panel(
        _frequency_axis(f), value_axis(limits, f"One-sided root density ({unit})"), marks=tuple(marks),
        title=axis_title(shown.axis),
    )  # fmt: skip


def _frequency_axis(frequencies: Vector) -> Axis:
    limits = limits_of(frequencies, margin=0.03)
    ticks, minor = power_ticks(limits)
    return Axis("Frequency (Hz)", limits, ticks, minor, grid=tuple(tick.value for tick in ticks))


def _model_lines(spectrum: PowerSpectrum, given: ModelLike, *, factor: float, alone: bool) -> list[Polyline]:
    """Return the one-sided root density of a model and its terms; a sinusoid is a symbol at its peak here."""
    f, rate = spectrum.frequencies, spectrum.rate
    model = as_model(given)
    strokes = term_strokes(model.terms, model.processes)
    total, terms, oscillations = np.zeros(f.size), [], np.zeros(f.size)
    lines = [term for term, process in model.by_term.items() if process.line(rate) is not None]
    many = len(lines) > MOST_SINUSOIDS
    for term, process in model.by_term.items():
        line = process.line(rate)
        if line is not None:
            # A sinusoid of power P has the density P / (b Δf), bin width Δf and noise bandwidth b of the window.
            power, cycles = line
            height = np.array([factor * np.sqrt(power / (ENERGY_WIDTH * rate / spectrum.length))])
            symbol = Stroke(strokes[lines[0] if many else term].colour, 0.0, SOLID, "cross")
            label = "" if many and term != lines[0] else f"{len(lines)} lines" if many else name_in_text(term, process)
            terms.append(Polyline(np.array([cycles * rate]), drawable(height), stroke=symbol, label=label, layer=ABOVE))
        elif process.has("psd"):
            density = 2 * process.psd(f, rate)
            total += density
            if not alone and shared_name(process, rate):
                oscillations += density
            elif np.any(density > 0):
                y = drawable(factor * np.sqrt(density))
                shown = name_in_text(term, process)
                label = "Sensor filter" if isinstance(process, Ordered) and not alone else shown
                terms.append(Polyline(f, y, stroke=strokes[term], label=label, layer=ABOVE))
    if np.any(oscillations > 0):
        y = drawable(factor * np.sqrt(oscillations))
        terms.append(Polyline(f, y, stroke=OSCILLATING, label=OSCILLATIONS, layer=ABOVE))
    name = f"Model: {model_text(model.terms)}" if alone else "Model"
    return [Polyline(f, drawable(factor * np.sqrt(total)), stroke=IMPLIED, label=name, layer=MIDDLE), *terms]


def _peak_marks(spectrum: PowerSpectrum, heights: Vector, *, alone: bool) -> list[Polyline]:
    """Return the symbols that mark the lines and the bumps of a spectrum."""
    marks = []
    lines = {line.frequency: line.height for line in spectrum.lines}
    bumps = {bump.frequency: bump.height for bump in spectrum.bumps}
    for ratios, stroke, noun in ((lines, FOUND, "Lines"), (bumps, BROAD, "Broad peaks")):
        if not ratios:
            continue
        x = np.array(list(ratios))
        y = np.array([_top(spectrum, heights, frequency) for frequency in ratios]) * 1.35  # above the peak
        strongest = sorted(ratios, key=lambda frequency: -ratios[frequency])[:3]
        more = ", …" if len(ratios) > len(strongest) else ""
        name = f"{noun}: {', '.join(f'{frequency:.4g}' for frequency in strongest)}{more} Hz" if alone else noun
        marks.append(Polyline(x, y, stroke=stroke, label=name, layer=FRONT))
    return marks


def _top(spectrum: PowerSpectrum, heights: Vector, frequency: float) -> float:
    """Return the largest value of `heights` at most two bins or 2 %, whichever is more, away from a frequency."""
    near = np.abs(spectrum.frequencies - frequency) <= max(2 * spectrum.resolution, 0.02 * frequency)
    values = heights[near & np.isfinite(heights)]
    return float(values.max()) if values.size else float("nan")


@drawing
def plot_spectrum(
    spectrum: PowerSpectrum, *, model: ModelLike | None = None, units: UnitSystem = "si", ax: Axes | None = None,
    path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw the root density over the frequency, with its confidence band, lines and bumps, on logarithmic axes.

    The density is averaged over 1/24 octave, except around lines. It is one-sided, so white noise with the
    two-sided density N of a datasheet is drawn at √2 N.

    Parameters
    ----------
    model : Model, Process or str, optional
        Model with values, such as `fit.model`. Its density and the densities of its terms are drawn on top of the
        spectrum. A cross marks the height of a sinusoid of the model in this spectrum.
    units : "si" or "datasheet"
        Units of the plot: rad/s/√Hz and m/s²/√Hz, or deg/s/√Hz and µg/√Hz.

    Raises
    ------
    OptionError
        If `units` is unknown, or is "datasheet" and the signal is neither an angular rate nor an acceleration.
    """
    panel = spectrum_panel(spectrum, model=model, units=units)
    return single_panel(panel)


@drawing
def plot_spectra(
    spectra: Mapping[str, PowerSpectrum], *, models: Mapping[str, ModelLike] | None = None, units: UnitSystem = "si",
    path: str | os.PathLike[str] | None = None,
) -> Figure:  # fmt: skip
    """Draw the spectrum of every axis, with one row for each sensor; see `PowerSpectrum.plot`.

    Parameters
    ----------
    models : mapping of axis to Model, Process or str, optional
        Models with values, whose densities are drawn on top of the spectra.
    units : "si" or "datasheet"
        Units of the plot: rad/s/√Hz and m/s²/√Hz, or deg/s/√Hz and µg/√Hz.

    Raises
    ------
    OptionError
        If `units` is unknown, or is "datasheet" and an axis is neither an angular rate nor an acceleration.
    """
    return grid_figure(
        {
            axis: spectrum_panel(spectrum, model=(models or {}).get(axis), units=units, alone=False)
            for axis, spectrum in spectra.items()
        }
    )
