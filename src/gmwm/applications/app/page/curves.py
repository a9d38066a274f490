"""The tab "Curves": Allan deviation or wavelet variance, and the spectrum, of all axes."""

from __future__ import annotations

from typing import Any

from dash import Dash, Input, html

from gmwm.applications.app.figures import curves, half_of, plotly_figure, spectra
from gmwm.applications.app.page.widgets import changes, choices, draws, graph, group, of_job, restores
from gmwm.applications.app.session import Session
from gmwm.applications.app.workspace import Desk, Workspace
from gmwm.base.units import by_sensor
from gmwm.calibration.tables import SENSORS
from gmwm.measuring.spectrum.result import PowerSpectra
from gmwm.measuring.variance.result import WaveletVariances
from gmwm.showing.plots.labels import axis_title


def panel() -> list[Any]:
    """Return the components of the tab."""
    return [
        group(
            "controls",
            choices("view", {"allan": "Allan deviation", "wavelet": "Wavelet variance"}, "allan", "View"),
            choices("curve", {kind: kind for kind in ("classical", "robust", "both")}, "classical", "Estimate"),
        ),
        html.P(id="error-view", className="error", role="alert"),
        html.H2("Curves", className="unseen"),
        html.Div(id="curves", className="grid"),
        html.H2("Spectrum"),
        html.Div(id="spectra", className="grid"),
    ]


def register(app: Dash, desk: Desk) -> None:
    """Register the callbacks of the tab."""

    def change(session: Session, view: Any, curve: Any) -> Session:
        return session.with_(view=view, curve=curve)

    changes(app, desk, [Input("view", "value"), Input("curve", "value")], change, errors=("view",))
    restores(app, desk, ("view", "curve"), lambda session: [session.view, session.curve])
    draws(app, desk, tab="curves", place="curves", draw=_curves)
    draws(app, desk, tab="curves", place="spectra", draw=_spectra)


def _curves(session: Session, workspace: Workspace, width: float) -> Any:
    estimators = {"classical": (False,), "robust": (True,), "both": (False, True)}[session.curve]
    jobs = {robust: workspace.curves(session, robust=robust) for robust in estimators}
    first, last = jobs[estimators[0]], jobs[estimators[-1]]
    return of_job(
        first,
        lambda one: of_job(last, lambda other: _curve_sections(session, (one, other)[: len(estimators)], width)),
        comes="the Allan deviation or wavelet variance of each sensor, and its spectrum",
    )


def _curve_sections(session: Session, found: tuple[WaveletVariances, ...], width: float) -> list[Any]:
    sections = []
    for sensor, axes in by_sensor(found[0]).items():
        of = {", robust" if k else "": {axis: curve[axis] for axis in axes} for k, curve in enumerate(found)}
        title = SENSORS.get(sensor, sensor or "Axes")
        figure = plotly_figure(curves(of, session.view, session.units), half_of(width))
        sections.append(html.Div([html.H3(title), graph(figure, f"curve-{sensor}", f"{title}: curves")]))
    return sections


def _spectra(session: Session, workspace: Workspace, width: float) -> Any:
    def show(found: PowerSpectra) -> list[Any]:
        sections = []
        for sensor, axes in by_sensor(found).items():
            title = SENSORS.get(sensor, sensor or "Axes")
            figure = plotly_figure(spectra(axes, session.units), half_of(width))
            place = graph(figure, f"spectrum-{sensor}", f"{title}: spectrum")
            sections.append(html.Div([html.H3(title), place, _peaks(axes)]))
        return sections

    return of_job(workspace.spectrum(session), show)


def _peaks(axes: Any) -> Any:
    """Return a list that describes the lines and the broad peaks of all axes in words."""
    peaks = [
        html.Li(f"{axis_title(axis)}: {text}")
        for axis, spectrum in axes.items()
        for text in (*(p.described(spectrum.unit) for p in spectrum.lines), *(p.described() for p in spectrum.bumps))
    ]
    return html.Ul(peaks, className="peaks") if peaks else html.P("No line is found.", className="hint")
