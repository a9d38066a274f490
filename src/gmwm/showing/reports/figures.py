"""Figures of a report as plain data, in every combination of view and units that is available."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from gmwm.base.axis_names import by_sensor
from gmwm.base.errors import OptionError
from gmwm.showing.plots.figure import Panel
from gmwm.showing.plots.fit import fit_panel
from gmwm.showing.plots.labels import sensor_and_letter, sensor_title
from gmwm.showing.plots.overlay import overlay_panel
from gmwm.showing.plots.ranking import ranking_figure
from gmwm.showing.plots.recordings import recordings_figure
from gmwm.showing.plots.regression import regression_panel
from gmwm.showing.plots.spectrum import spectrum_panel
from gmwm.showing.plots.style import curve_stroke, letter_stroke
from gmwm.showing.plots.view import UnitSystem, ViewName
from gmwm.showing.reports.plotly import plotly_panel

if TYPE_CHECKING:
    from gmwm.calibration.result import AxisCalibration, Calibration
    from gmwm.choosing.replicates import Replicates
    from gmwm.measuring.regression import Regression

VIEWS: tuple[ViewName, ...] = ("allan", "wavelet")
"""Views of a curve. The page starts with the first, which users of inertial sensors know best."""
SYSTEMS: tuple[UnitSystem, ...] = ("datasheet", "si")

Variants = dict[str, dict[str, Any]]
"""A figure in several views and units, with keys such as "allan-si"."""


def sensor_pictures(calibration: Calibration) -> dict[str, Variants]:
    """Return one figure for each sensor, with the data and models of its axes.

    If the axes of a sensor have different units, there is one figure for each unit.
    """
    pictures = {}
    for sensor, axes in by_sensor(calibration.axes).items():
        units = dict.fromkeys(found.fit.wavelet_variance.unit for found in axes.values())
        for unit in units:
            members = {axis: found for axis, found in axes.items() if found.fit.wavelet_variance.unit == unit}
            name = sensor or "Axes"
            pictures[name if len(units) == 1 else f"{name} ({unit})"] = _variants(_overlay(sensor, members))
    return pictures


def _overlay(sensor: str, axes: Mapping[str, AxisCalibration]) -> Callable[[ViewName, UnitSystem], Panel]:
    letters = {axis: sensor_and_letter(axis)[1] for axis in axes}
    items = {letters[axis].upper() or axis: found.fit for axis, found in axes.items()}
    strokes = [letter_stroke(letter) or curve_stroke(k) for k, letter in enumerate(letters.values())]
    title = sensor_title(sensor) if sensor else ""

    def panel(view: ViewName, units: UnitSystem) -> Panel:
        return overlay_panel(items, view=view, units=units, strokes=strokes, title=title)

    return panel


def axis_pictures(found: AxisCalibration) -> tuple[Variants, Variants]:
    """Return two figures of one axis: data, model and terms; and the distances of the best models from the data."""

    def distances(view: ViewName, units: UnitSystem) -> Panel:
        panel = ranking_figure(found.ranking, view=view, units=units).rows[0][1]
        assert panel is not None
        return panel

    return (
        _variants(lambda view, units: fit_panel(found.fit, view=view, units=units)),
        _variants(distances, systems=("si",)),  # distances have no unit
    )


def spectrum_pictures(found: AxisCalibration) -> Variants:
    """Return the figure of the spectrum of one axis with the density of the model; empty without a spectrum.

    A spectrum does not depend on the view, so there is only one figure for each unit system. If the page has no figure
    in the chosen view, it uses a figure of another view.
    """
    spectrum, model = found.spectrum, found.fit.model
    if spectrum is None:
        return {}

    def panel(view: ViewName, units: UnitSystem) -> Panel:
        return spectrum_panel(spectrum, model=model, units=units)

    return _variants(panel, views=("wavelet",))


def regression_pictures(found: Regression) -> Variants:
    """Return the figure of an axis against a covariate, before and after the removal of its effect, by unit system."""

    def panel(view: ViewName, units: UnitSystem) -> Panel:
        return regression_panel(found, units=units)

    return _variants(panel, views=("wavelet",))


def recordings_pictures(found: Replicates) -> Variants:
    """Return the figure that shows each recording relative to the mean. It does not depend on view or units."""
    (panel,) = recordings_figure(found).panels
    return {"wavelet-si": plotly_panel(replace(panel, title=""))}


def _variants(
    panel: Callable[[ViewName, UnitSystem], Panel],
    *,
    views: Sequence[ViewName] = VIEWS,
    systems: Sequence[UnitSystem] = SYSTEMS,
) -> Variants:
    """Return a figure in every view and unit system for which `panel` raises no error."""
    found: Variants = {}
    for view in views:
        for units in systems:
            try:
                drawn = panel(view, units)
            except OptionError:  # This filter has no Allan deviation, or this signal has no datasheet unit.
                continue
            # The figure has no title, because the page has a heading for it.
            found[f"{view}-{units}"] = plotly_panel(replace(drawn, title=""))
    return found
