"""Figures of a report as plain data, in every combination of view and units that is available."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from gmwm.base.axis_names import by_sensor
from gmwm.base.errors import OptionError
from gmwm.showing.plots.figure import Mark, Panel, Polyline
from gmwm.showing.plots.fit import fit_panel
from gmwm.showing.plots.labels import sensor_and_letter, sensor_title
from gmwm.showing.plots.overlay import Item, overlay_panel, recordings_figure
from gmwm.showing.plots.ranking import ranking_figure
from gmwm.showing.plots.regression import regression_panel
from gmwm.showing.plots.spectrum import spectrum_panel
from gmwm.showing.plots.style import curve_stroke, letter_stroke
from gmwm.showing.plots.view import UnitSystem, ViewName
from gmwm.showing.reports.plotly import plotly_panel

if TYPE_CHECKING:
    from gmwm.calibration.result import AxisCalibration, Calibration
    from gmwm.choosing.replicates import Replicates
    from gmwm.fitting.estimation.result import Fit
    from gmwm.measuring.regression import Regression
    from gmwm.measuring.spectrum import PowerSpectrum
    from gmwm.theory.processes.model import Model

VIEWS: tuple[ViewName, ...] = ("allan", "wavelet")
"""Views of a curve. The page starts with the first, which users of inertial sensors know best."""
SYSTEMS: tuple[UnitSystem, ...] = ("datasheet", "si")

Variants = dict[str, dict[str, Any]]
"""A figure in several views and units, with keys such as "allan-si"."""


def sensor_pictures(calibration: Calibration) -> dict[str, list[Variants]]:
    """Return a figure of each sensor with the data and models of its axes, one for each unit if the units differ."""
    pictures: dict[str, list[Variants]] = {}
    for sensor, axes in by_sensor(calibration).items():
        for unit in dict.fromkeys(fit.wavelet_variance.unit for fit in axes.values()):
            fits = {axis: fit for axis, fit in axes.items() if fit.wavelet_variance.unit == unit}
            pictures.setdefault(sensor, []).append(_variants(sensor_panel(sensor, fits)))
    return pictures


def sensor_panel(sensor: str, fits: Mapping[str, Fit]) -> Callable[[ViewName, UnitSystem], Panel]:
    """Return a function that draws the data and the models of the axes of a sensor in a view and unit system."""
    letters = {axis: sensor_and_letter(axis)[1] for axis in fits}
    items: dict[str, Item] = {letters[axis].upper() or axis: fit for axis, fit in fits.items()}
    strokes = [letter_stroke(letter) or curve_stroke(k) for k, letter in enumerate(letters.values())]
    title = sensor_title(sensor) if sensor else ""
    return lambda view, units: overlay_panel(items, view=view, units=units, strokes=strokes, title=title)


def axis_pictures(axis: AxisCalibration) -> tuple[Variants, Variants]:
    """Return two figures of one axis: data, model and terms; and the distances of the best models from the data."""

    def distances(view: ViewName, units: UnitSystem) -> Panel:
        panel = ranking_figure(axis.ranking, view=view, units=units).rows[0][1]
        assert panel is not None
        return panel

    return (
        _variants(lambda view, units: fit_panel(axis.fit, view=view, units=units)),
        _variants(distances, systems=("si",)),  # distances have no unit
    )


def spectrum_pictures(spectrum: PowerSpectrum, model: Model) -> Variants:
    """Return the figure of a spectrum with the density of the model, by unit system.

    If the page has no figure in the chosen view, it uses a figure of another view.
    """
    return _variants(lambda view, units: spectrum_panel(spectrum, model=model, units=units), views=("wavelet",))


def regression_pictures(regression: Regression) -> Variants:
    """Return the figure of an axis against a covariate, before and after the removal of its effect, by unit system."""
    return _variants(lambda view, units: regression_panel(regression, units=units), views=("wavelet",))


def recordings_pictures(replicates: Replicates) -> Variants:
    """Return the figure that shows each recording relative to the mean. It does not depend on view or units."""
    (panel,) = recordings_figure(replicates).panels
    return {"wavelet-si": plotly_panel(replace(panel, title=""))}


def _variants(
    panel: Callable[[ViewName, UnitSystem], Panel],
    *,
    views: Sequence[ViewName] = VIEWS,
    systems: Sequence[UnitSystem] = SYSTEMS,
) -> Variants:
    """Return a figure in every view and unit system for which `panel` raises no error."""
    variants: Variants = {}
    for view in views:
        for units in systems:
            try:
                drawn = panel(view, units)
            except OptionError:  # This filter has no Allan deviation, or this signal has no datasheet unit.
                continue
            # The page has headings for the title of the figure and for the structure of the model.
            marks = tuple(map(_without_structure, drawn.marks))
            variants[f"{view}-{units}"] = plotly_panel(replace(drawn, title="", marks=marks))
    return variants


def _without_structure(mark: Mark) -> Mark:
    return replace(mark, label="Model") if isinstance(mark, Polyline) and mark.label.startswith("Model: ") else mark
