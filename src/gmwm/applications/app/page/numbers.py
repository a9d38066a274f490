"""The tab "Numbers": datasheet numbers of all axes, N and K for a filter, error budget, and reference values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

from dash import Dash, Input, State, dcc, html

from gmwm.applications.app.figures import half_of, plotly_figure
from gmwm.applications.app.page.widgets import (
    button,
    by_severity,
    changes,
    choices,
    draws,
    field,
    graph,
    group,
    of_job,
    restores,
    table,
    text_input,
)
from gmwm.applications.app.session import Session, number
from gmwm.applications.app.workspace import Desk, Workspace
from gmwm.applications.navigation.plot import plot_budget
from gmwm.applications.navigation.result import headline
from gmwm.base.errors import GmwmError, OptionError
from gmwm.base.remarks import Dialect
from gmwm.base.time_base import parse_length
from gmwm.base.units import by_sensor
from gmwm.calibration import Calibration
from gmwm.calibration.number_verdicts import MAIN, NumberVerdict, Usability
from gmwm.calibration.result import AxisCalibration
from gmwm.calibration.tables import SENSORS, in_order
from gmwm.choosing.datasheets.effective import Use
from gmwm.files.importers.values import as_reference, parse_reference
from gmwm.showing.exporters.reduction import filter_pair
from gmwm.showing.plots.figure import description
from gmwm.showing.reports.figures import sensor_panel
from gmwm.showing.reports.verdict import filter_tables, state_of

ROBUST: Mapping[str, Literal["auto"] | bool] = {"auto": "auto", "yes": True, "no": False}
HORIZONS = {-2: "10 ms", -1: "0.1 s", 0: "1 s", 1: "10 s", 2: "100 s", 3: "1000 s"}
"""Labels of the slider for the time horizon, by the decimal logarithm of the time (s)."""
INFLATIONS = {1: "1", 5: "5", 10: "10", 20: "20"}


def panel() -> list[Any]:
    """Return the components of the tab."""
    robust = {"auto": "where a test finds outliers", "yes": "everywhere", "no": "nowhere"}
    return [
        group(
            "controls", choices("robust", robust, "auto", "Robust estimate"),
            field("Confidence", text_input("confidence", value="0.95"), "confidence"),
        ),
        html.Div(id="numbers"),
        html.H2("For another horizon of the filter"),
        html.P("N and K that replace the whole model between two corrections from other sensors.", className="hint"),
        group(
            "sliders",
            _slider("Horizon", min=-2, max=3, step=0.05, value=0, marks=HORIZONS),
            _slider("Inflation", min=1, max=20, step=0.5, value=1, marks=INFLATIONS),
        ),
        html.P(id="error-horizon", className="error", role="alert"),
        html.Div(id="effective"),
        html.H2("Unaided navigation"),
        group("span", field("Time without corrections", text_input("duration", value="60s"), "duration")),
        html.Div(id="budget"),
        html.H2("Compare with a datasheet"),
        html.Label("Values of the manufacturer, one a line", htmlFor="reference"),
        dcc.Textarea(id="reference", placeholder="gyro.N = 2.0 deg/√h\naccel.B = 0.2 mg", rows=3),
        button("Compare", "compare"),
        html.P(id="error-reference", className="error", role="alert"),
        html.Div(id="against"),
    ]  # fmt: skip


def _slider(title: str, **scale: Any) -> Any:
    slider = dcc.Slider(id=title.lower(), allow_direct_input=False, **scale)
    return html.Div([html.Span(title, id=f"label-{title.lower()}"), slider])


def register(app: Dash, desk: Desk) -> None:
    """Register the callbacks of the tab."""
    for place, draw in (("numbers", _numbers), ("effective", _effective), ("budget", _budget), ("against", _against)):
        draws(app, desk, tab="numbers", place=place, draw=draw)

    def navigate(session: Session, text: str | None) -> Session:
        return session.with_(duration=parse_length(text or "", "duration"))

    changes(app, desk, [Input("duration", "value")], navigate, errors=("duration",))

    def slide(session: Session, power: float, inflation: float) -> Session:
        return session.with_(horizon=float(f"{10**power:.3g}"), inflation=inflation)

    sliders = [Input("horizon", "value"), Input("inflation", "value")]
    changes(app, desk, sliders, slide, errors=("horizon",))

    def settings(session: Session, robust: str, confidence: str) -> Session:
        try:
            level = float(confidence)
        except (TypeError, ValueError, OverflowError):
            raise OptionError(argument="confidence", expected="a number", got=confidence) from None
        return session.with_(robust=ROBUST.get(robust, session.robust), confidence=level)

    changes(app, desk, [Input("robust", "value"), Input("confidence", "value")], settings, errors=("confidence",))
    fields = ("horizon", "inflation", "robust", "confidence", "duration", "reference")
    restores(app, desk, fields, _field_values)

    def compare(session: Session, _: int, text: str | None) -> Session:
        pairs = dict(_pair(line) for line in (text or "").splitlines() if line.strip())
        return session.with_(reference=pairs)

    changes(
        app, desk, [Input("compare", "n_clicks")], compare, states=[State("reference", "value")], errors=("reference",)
    )  # fmt: skip


def _field_values(session: Session) -> list[Any]:
    robust = next(name for name, value in ROBUST.items() if value == session.robust)
    reference = "\n".join(f"{name} = {text}" for name, text in session.reference.items())
    level, duration = number(session.confidence), f"{number(session.duration)}s"
    return [math.log10(session.horizon), session.inflation, robust, level, duration, reference]


def _pair(line: str) -> tuple[str, str]:
    name, (value, unit) = parse_reference(line)
    return name, f"{value!r} {unit}"


def _numbers(session: Session, workspace: Workspace, width: float) -> Any:
    comes = "N, K and B of each axis with their verdicts, the curves, and the remarks"
    return of_job(workspace.calibration(session), lambda found: _first_screen(found, session, width), comes=comes)


def _first_screen(found: Calibration, session: Session, width: float) -> list[Any]:
    """Return verdict, filter numbers beside curves, remarks, and folded datasheets, as in the report."""
    head = found.verdict
    parts = [html.P(head.text(Dialect.SHELL), className=f"verdict {state_of(head)}")]
    for sensor in filter_tables(found, Dialect.SHELL):
        fits = {row["axis"]: found[row["axis"]] for row in sensor["rows"] if not row["failed"]}
        drawn: list[Any] = []
        if fits:
            panel = sensor_panel(sensor["sensor"], fits)(session.view, session.units)
            title = f"Curves of the {sensor['title']}"
            drawn = [graph(plotly_figure(panel, half_of(width), 240), f"filter-{sensor['sensor']}", title)]
        parts.append(html.Div([html.Div([html.H2(sensor["title"]), *_filter_table(sensor)]), *drawn], className="grid"))
    sheets = [_sensor(sensor, axes, session) for sensor, axes in by_sensor(found.axes).items()]
    return [*parts, by_severity(found.remarks), html.Details([html.Summary("All numbers of each axis"), *sheets])]


def _filter_table(sensor: Mapping[str, Any]) -> list[Any]:
    """Return the table of N, K, B and the model of the axes of a sensor, and the reasons of its limits."""
    rows = [
        [
            row["axis"],
            *(html.Span([cell["text"], html.Span(f" {cell['mark']}", className="mark")], className=cell["state"])
              for cell in row["cells"]),
            row["model"] or f"not calibrated: {row['failed']}",
        ]
        for row in sensor["rows"]
    ]  # fmt: skip
    reasons = [
        html.Li([html.Span(reason["mark"], className="mark"), f" {reason['numbers']}: {reason['text']}"],
                className=reason["state"])
        for reason in sensor["reasons"]
    ]  # fmt: skip
    return [table(["Axis", *sensor["heads"], "Model"], rows, "filter"), html.Ul(reasons, className="reasons")]


def _sensor(sensor: str, axes: Mapping[str, AxisCalibration], session: Session) -> Any:
    rows: list[list[Any]] = [
        ["Model", *(axis_result.fit.model.structure for axis_result in axes.values())],
        [
            "p of the fit",
            *("–" if axis_result.test is None else axis_result.test.pvalue_in_words for axis_result in axes.values()),
        ],
    ]
    for symbol in in_order([list(axis_result.datasheet) for axis_result in axes.values()]):
        entries = [axis_result.datasheet.get(symbol) for axis_result in axes.values()]
        title = next(entry.title for entry in entries if entry is not None)
        cells = ["" if entry is None else entry.text(session.units) for entry in entries]
        rows.append([html.Span([symbol, html.Small(f" {title}")]), *cells])
    head = [SENSORS.get(sensor, sensor or "Axes"), *axes]
    return table(head, rows, "numbers datasheet")


def _effective(session: Session, workspace: Workspace, width: float) -> Any:
    def show(found: Calibration) -> Any:
        head = ["Axis", f"N at {session.horizon:g} s", f"K at {session.horizon:g} s"]
        rows = []
        for axis, axis_result in found.axes.items():
            try:
                entries = filter_pair(axis_result, Use(session.horizon), session.confidence)
            except GmwmError as error:
                rows.append([axis, error.text(Dialect.SHELL), ""])
                continue
            marks = (_refusal(found.number_verdicts[axis].get(symbol)) for symbol in MAIN)
            rows.append([axis, *(_inflate(entry, session) + mark for entry, mark in zip(entries, marks, strict=False))])
        times = f", multiplied by {session.inflation:g}" if session.inflation != 1 else ""
        return [
            table(head, rows, "numbers"),
            html.P(f"The files of the tab Download are written from these numbers{times}."),
        ]

    job = workspace.calibration(session)
    return of_job(job, show) if job.state == "done" else []


def _budget(session: Session, workspace: Workspace, width: float) -> Any:
    def show(found: Calibration) -> Any:
        budget = found.budget(session.duration, level=session.confidence)
        figures = [
            graph(plotly_figure(panel, half_of(width), 260, title=True), {"type": "budget", "number": k}, panel.title)
            for k, panel in enumerate(description(plot_budget)(budget).panels)
        ]
        return [html.P(headline(budget), className="facts"), html.Div(figures, className="grid")]

    job = workspace.calibration(session)
    return of_job(job, show) if job.state == "done" else []


def _refusal(verdict: NumberVerdict | None) -> str:
    """Return the mark of a number that must not be used, which the files refuse; "" for the others."""
    return f" {verdict.usability.mark}" if verdict and verdict.usability is Usability.DO_NOT_USE else ""


def _inflate(entry: Any, session: Session) -> str:
    value, _, high, unit = entry.in_units(session.units)
    limit = entry.upper_only and high is not None
    return f"{'≤ ' if limit else ''}{session.inflation * (high if limit else value):.4g} {unit}"


def _against(session: Session, workspace: Workspace, width: float) -> Any:
    def show(found: Calibration) -> Any:
        rows = []
        for name, text in session.reference.items():
            sensor, _, symbol = name.rpartition(".")
            for axis, axis_result in found.axes.items():
                entry = axis_result.datasheet.get(symbol)
                if entry is None or (axis != sensor and not axis.startswith(f"{sensor}_")):
                    continue
                value, _, unit = text.partition(" ")
                reference = as_reference(name, (float(value), unit), entry.unit)
                rows.append(
                    [f"{axis} {symbol}", str(reference), entry.text(session.units), _ratio(entry, reference.si)]
                )
        return table(["Number", "Datasheet", "Measured", "Measured / datasheet"], rows, "numbers") if rows else []

    job = workspace.calibration(session)
    return of_job(job, show) if session.reference and job.state == "done" else []


def _ratio(entry: Any, si: float) -> str:
    if entry.upper_only or entry.low is None:
        return f"≤ {entry.high / si:.3g}" if entry.high is not None else "–"
    return f"{entry.value / si:.3g} ({entry.low / si:.3g} … {entry.high / si:.3g})"
