"""The tab "Recording": open a file, set how to read it, look at the samples, and leave out time ranges."""

from __future__ import annotations

from typing import Any

from dash import ALL, Dash, Input, Output, State, ctx, html, no_update

from gmwm.applications.app.figures import Drawn, traces, with_spans
from gmwm.applications.app.page import widgets
from gmwm.applications.app.session import Session, number
from gmwm.applications.app.workspace import Desk, Workspace, shown_times
from gmwm.base.errors import GmwmError, OptionError
from gmwm.base.text import duration_text
from gmwm.base.time_base import parse_length
from gmwm.base.units import by_sensor, unit_names
from gmwm.files.columns.axis_units import parse_scale
from gmwm.files.columns.columns import parse_columns
from gmwm.measuring.inspection import Inspection
from gmwm.recording.signals import Imu
from gmwm.showing.plots.labels import axis_title

FIELDS = ("rate", "gyro", "accel", "time", "columns", "topic", "scale")
"""Names of the fields that set the options for reading."""
PLACES = ("rate", "units", "columns", "topic", "scale", "file")
"""Names of the fields beside which an error of reading can be shown."""
FIELD_OF = {
    "no-time": "rate", "rate": "rate", "unit": "units", "columns": "columns", "no-inertial-data": "columns",
    "several-recordings": "topic",
}  # fmt: skip
"""The field to which an error of reading belongs, by the code of the error or its first word."""


def panel() -> list[Any]:
    """Return the components of the tab."""
    return [
        widgets.group(
            "open", html.Label("File", htmlFor="path"), widgets.text_input("path", "static.csv"),
            widgets.button("Open", "open", "main"), html.P("or drop a file here", className="hint"), id="drop",
        ),
        html.P(id="error-file", className="error", role="alert"),
        html.Details([html.Summary("Files in the folder"), html.Div(id="entries")], id="browse"),
        html.Details([html.Summary("How to read the file"), html.Div(_options(), className="fields")], id="reading"),
        html.Div(id="verdict"),
        widgets.group(
            "cut",
            html.P("Drag over a figure to mark a span, or type its ends.", className="hint"),
            widgets.group(
                "span", widgets.field("From", widgets.text_input("span-from", "20min"), "start"),
                widgets.field("To", widgets.text_input("span-to", "25min"), "stop"),
                widgets.button("Skip this span", "skip"), widgets.button("Keep only this span", "keep"),
            ),
            html.P(id="error-skip", className="error", role="alert"),
            html.Div(id="spans", className="chips"),
            id="cut",
        ),
        html.Div(id="traces", className="grid"),
    ]  # fmt: skip


def _options() -> list[Any]:
    gyro, accel, time = (
        {"": "as in the file", **{unit: unit for unit in units}}
        for units in (unit_names("gyro"), unit_names("accel"), ("s", "ms", "µs", "ns"))
    )
    return [
        widgets.field("Sampling rate (Hz)", widgets.text_input("rate", "from the time stamps"), "rate"),
        widgets.field("Gyroscope unit", widgets.menu("gyro", gyro, ""), "units"),
        widgets.field("Accelerometer unit", widgets.menu("accel", accel, ""), "accel"),
        widgets.field("Time unit", widgets.menu("time", time, ""), "time"),
        widgets.field("Columns", widgets.text_input("columns", "time,gyro_x,gyro_y,…"), "columns"),
        widgets.field("Topic", widgets.text_input("topic", "for files with several recordings"), "topic"),
        widgets.field("Scale of raw counts", widgets.text_input("scale", "gyro=1/131"), "scale"),
    ]


def register(app: Dash, desk: Desk) -> None:
    """Register the callbacks of the tab."""
    _opening(app, desk)
    _browsing(app, desk)
    _reading(app, desk)
    _cutting(app, desk)
    widgets.draws(app, desk, tab="recording", place="verdict", draw=_verdict)
    widgets.draws(app, desk, tab="recording", place="traces", draw=_traces)
    widgets.draws(app, desk, tab="recording", place="spans", draw=_spans)

    def unit(data: Any, _: int, page: str) -> Any:
        session = desk.session(data)
        if not session.file:
            return no_update
        try:
            job = desk.workspace(page).overview(session)
        except (GmwmError, OSError):
            return no_update
        return traces(job.value, 600, session.units)[1] if job.state == "done" else no_update

    app.callback(
        Output("time-unit", "data"), Input("session", "data"), Input("revision", "data"), State("page", "data")
    )(unit)


def _opening(app: Dash, desk: Desk) -> None:
    def open_file(*given: Any) -> Any:
        _, __, dropped, files, path, data, count, page = given
        text = (path or "").strip()
        if ctx.triggered_id == "dropped":
            text = dropped or ""
        elif isinstance(ctx.triggered_id, dict):
            if not any(files):
                return [no_update] * 3
            text = ctx.triggered_id["path"]
        try:
            file = desk.folders.file(text)
            if text.endswith(".json"):
                session = Session.load(file)
                desk.folders.file(session.file)
            else:
                if not text or file.is_dir():
                    raise OptionError(argument="file", expected="the name of a file", got=text)
                before = desk.session(data)
                session = Session(file=str(file), view=before.view, units=before.units, confidence=before.confidence)
        except (GmwmError, OSError, ValueError) as error:
            return no_update, widgets.message(error), no_update
        desk.workspace(page).session = session
        return session.to_dict(), "", count + 1

    app.callback(
        Output("session", "data", allow_duplicate=True), Output("error-file", "children"), Output("restored", "data"),
        Input("open", "n_clicks"), Input("path", "n_submit"), Input("dropped", "data"),
        Input({"type": "file", "path": ALL}, "n_clicks"),
        State("path", "value"), State("session", "data"), State("restored", "data"), State("page", "data"),
        prevent_initial_call=True,
    )(open_file)  # fmt: skip

    widgets.restores(app, desk, ("path", *FIELDS), lambda session: [session.file, *_field_values(session)])


def _browsing(app: Dash, desk: Desk) -> None:
    def browse(_: list[int], page: str) -> Any:
        hit = ctx.triggered_id
        folder = hit["path"] if isinstance(hit, dict) else "."
        try:
            here, folders, files = desk.folders.entries(folder)
        except (GmwmError, OSError) as error:
            return widgets.failure(error)
        up = [] if here == "." else [_entry("folder", f"{here}/..", "..")]
        inside = "" if here == "." else f"{here}/"
        return [
            html.P(str(desk.folders.root / here), className="hint"),
            html.Div(
                [
                    *up,
                    *(_entry("folder", inside + name, f"{name}/") for name in folders),
                    *(_entry("file", inside + name, name) for name in files),
                ],
                className="chips",
            ),
        ]

    app.callback(
        Output("entries", "children"), Input({"type": "folder", "path": ALL}, "n_clicks"), Input("page", "data")
    )(browse)


def _entry(kind: str, path: str, name: str) -> Any:
    return widgets.button(name, {"type": kind, "path": path}, f"chip {kind}")


def _field_values(session: Session) -> list[Any]:
    """Return the values of the fields of `FIELDS` for a session."""
    reading = session.reading
    units = reading.get("units", {})
    columns = reading.get("columns")
    if isinstance(columns, dict):
        columns = ",".join(f"{axis}={'' if column is None else column}" for axis, column in columns.items())
    elif columns is not None:
        columns = ",".join(axis or "" for axis in columns)
    rate = number(reading["rate"]) if "rate" in reading else ""
    scale = ",".join(f"{name}={number(factor)}" for name, factor in reading.get("scale", {}).items())
    shown = (units.get(name, "") for name in ("gyro", "accel", "time"))
    return [rate, *shown, columns or "", reading.get("topic", ""), scale]


def _reading(app: Dash, desk: Desk) -> None:
    def change(session: Session, *given: Any) -> Session:
        rate, gyro, accel, time, columns, topic, scale = (str(value or "").strip() for value in given)
        units = {name: unit for name, unit in (("gyro", gyro), ("accel", accel), ("time", time)) if unit}
        return session.read_as(
            rate=_number(rate, "rate") if rate else None, units=units, columns=parse_columns(columns or None),
            topic=topic or None, scale=parse_scale(scale or None),
        )  # fmt: skip

    inputs = [Input(name, "value") for name in FIELDS]
    widgets.changes(app, desk, inputs, change, errors=PLACES[:-1])

    def beside(data: Any, _: int, page: str) -> list[Any]:
        error = _reading_error(desk.session(data), desk.workspace(page))
        place = _place(error)
        texts = [widgets.message(error) if error is not None and name == place else "" for name in PLACES]
        return [*texts, True if place not in ("", "file") else no_update]

    app.callback(
        *(Output(f"error-{name}", "children", allow_duplicate=True) for name in PLACES), Output("reading", "open"),
        Input("session", "data"), Input("revision", "data"), State("page", "data"),
        prevent_initial_call="initial_duplicate",
    )(beside)  # fmt: skip


def _reading_error(session: Session, workspace: Workspace) -> Exception | None:
    """Return the error that occurred when the file was read; None if there is none or reading has not ended."""
    if not session.file:
        return None
    try:
        return workspace.recording(session).error
    except (GmwmError, OSError) as error:
        return error


def _place(error: Exception | None) -> str:
    """Return the field beside which an error of reading is shown; "" if there is no error."""
    if error is None:
        return ""
    argument = getattr(error, "argument", None)
    if argument in PLACES:
        return str(argument)
    code = str(getattr(error, "code", None) or "")
    return FIELD_OF.get(code, FIELD_OF.get(code.partition("-")[0], "file"))


def _number(text: str, name: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise OptionError(argument=name, expected="a number", got=text) from None


def _cutting(app: Dash, desk: Desk) -> None:
    def mark(marked: list[Any], unit: float) -> Any:
        hit = ctx.triggered[0]["value"] if ctx.triggered else None
        span = shown_times(hit)
        if span is None:
            return no_update, no_update
        return tuple(f"{max(end * unit, 0.0):.7g}s" for end in span)

    app.callback(
        Output("span-from", "value"), Output("span-to", "value"),
        Input({"type": "trace", "axis": ALL}, "relayoutData"), State("time-unit", "data"), prevent_initial_call=True,
    )(mark)  # fmt: skip

    def change(session: Session, *given: Any) -> Session | None:
        hit, _, value = next(iter(widgets.triggers()), (None, "", None))
        if not value:
            return None
        if isinstance(hit, dict):
            return _without(session, str(hit["span"]))
        *_others, begin, end = given
        first, last = parse_length(begin or "", "start"), parse_length(end or "", "stop")
        if hit == "keep":
            return session.read_as(start=first, stop=last)
        return session.read_as(skip=[*session.reading.get("skip", ()), (first, last)])

    inputs = [Input("skip", "n_clicks"), Input("keep", "n_clicks"), Input({"type": "span", "span": ALL}, "n_clicks")]
    states = [State("span-from", "value"), State("span-to", "value")]
    widgets.changes(app, desk, inputs, change, states=states, errors=("skip", "start", "stop"))


def _without(session: Session, span: str) -> Session:
    """Return the session with one cut removed: "keep" for the kept range, or the number of a skipped range."""
    if span == "keep":
        return session.read_as(start=None, stop=None)
    skips = {str(k): skip for k, skip in enumerate(session.reading.get("skip", ()))}
    skips.pop(span, None)
    return session.read_as(skip=list(skips.values()) or None)


def _spans(session: Session, workspace: Workspace, width: float) -> list[Any]:
    chips = []
    reading = session.reading
    if "start" in reading or "stop" in reading:
        last = f"{number(reading['stop'])} s" if "stop" in reading else "the end"
        text = f"keep {number(reading.get('start', 0.0))} s to {last} ×"
        chips.append(widgets.button(text, {"type": "span", "span": "keep"}, "chip", title="Remove this cut"))
    for k, (begin, end) in enumerate(reading.get("skip", ())):
        text = f"skip {number(begin)} s to {number(end)} s ×"
        chips.append(widgets.button(text, {"type": "span", "span": str(k)}, "chip", title="Remove this cut"))
    return chips


def _verdict(session: Session, workspace: Workspace, width: float) -> Any:
    # An error of reading is already shown beside its field.
    return [] if _reading_error(session, workspace) else widgets.of_job(workspace.inspection(session), _inspection_view)


def _inspection_view(found: Inspection) -> Any:
    state = "At rest" if found.static else "Not at rest"
    facts = [f"{found.samples} samples at {found.rate:g} Hz", duration_text(found.duration, 3), state]
    if found.segments > 1:
        facts.append(f"{found.segments} segments")
    if found.gravity is not None:
        facts.append(f"specific force {found.gravity:.5g} m/s²")
    head = ["Axis", "Mean", "Standard deviation", "Noise", "LSB", "Unit"]
    rows = [
        [axis_title(name), *(f"{value:.4g}" for value in (axis_report.mean, axis_report.sd, axis_report.noise)),
         "–" if axis_report.lsb is None else f"{axis_report.lsb:.4g}", axis_report.unit]
        for name, axis_report in found.axes.items()
    ]  # fmt: skip
    numbers = html.Details([html.Summary("Statistics of the axes"), widgets.table(head, rows, "numbers")])
    return [html.P(" · ".join(facts), className="facts"), widgets.remarks(found.remarks), numbers]


def _traces(session: Session, workspace: Workspace, width: float) -> Any:
    def show(imu: Imu) -> list[Any]:
        figures, unit = traces(imu, width, session.units)
        spans = _left_out(session)

        def place(axis: str, figure: Drawn) -> Any:
            name = {"type": "trace", "axis": axis}
            return widgets.graph(with_spans(figure, spans, unit), name, f"{axis_title(axis)} over time")

        return [html.Div([place(axis, picture) for axis, picture in of.items()]) for of in by_sensor(figures).values()]

    return [] if _reading_error(session, workspace) else widgets.of_job(workspace.overview(session), show)


def _left_out(session: Session) -> list[tuple[float, float]]:
    """Return the time ranges (s) that the session leaves out."""
    reading = session.reading
    spans = [(float(begin), float(end)) for begin, end in reading.get("skip", ())]
    if "start" in reading:
        spans.append((0.0, reading["start"]))
    if "stop" in reading:
        spans.append((reading["stop"], 1e12))  # a time (s) after the end of any recording
    return spans
