"""Components that several tabs use, and functions that register callbacks for them."""

from __future__ import annotations

import hashlib
import sys
import traceback
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from dash import Dash, Input, Output, State, ctx, dcc, html, no_update
from dash.exceptions import PreventUpdate
from plotly.io.json import to_json_plotly

from gmwm.applications.app.figures import Drawn
from gmwm.applications.app.session import Session
from gmwm.applications.app.workspace import SILENT_S, Desk, Job, Workspace
from gmwm.base.errors import GmwmError
from gmwm.base.remarks import Dialect, Remark, texts, with_groups
from gmwm.base.text import with_minus
from gmwm.showing.reports.verdict import state_of

WORDS = {"bad": "Do not use", "look": "Read first", "good": "Note"}
"""Meaning of the symbol in front of a remark, for screen readers."""
MARKS = {"bad": "✗", "look": "!", "good": "·"}


def group(kind: str, *parts: Any, **more: Any) -> Any:
    """Return components together, with the CSS class `kind`."""
    return html.Div(list(parts), className=kind, **more)


def field(label: str, control: Any, name: str) -> Any:
    """Return a control with its label and an empty element for its error message."""
    error = html.P(id=f"error-{name}", className="error", role="alert")
    return group("field", html.Label([html.Span(label), control]), error)


def text_input(name: Any, placeholder: str = "", value: str = "") -> Any:
    """Return a text field whose value is used when the user presses Enter or leaves it."""
    return dcc.Input(id=name, type="text", debounce=True, placeholder=placeholder, value=value, spellCheck="false")


def menu(name: str, options: dict[str, str], value: str) -> Any:
    """Return a drop-down menu. `options` has the label of each value."""
    shown = [{"label": label, "value": key} for key, label in options.items()]
    return dcc.Dropdown(id=name, options=shown, value=value, clearable=False, searchable=False)


def choices(name: str, options: dict[str, str], value: str, label: str) -> Any:
    """Return radio buttons with a caption. `options` has the label of each value."""
    radio = dcc.RadioItems(id=name, options=options, value=value, inline=True, className="radio")
    return html.Div([html.Span(label, id=f"label-{name}", className="caption"), radio], className="choices")


def button(text: Any, name: Any, kind: str = "", **more: Any) -> Any:
    """Return a button with the CSS class `kind`."""
    return html.Button(text, id=name, n_clicks=0, className=kind, type="button", **more)


def graph(figure: Drawn, name: Any, label: str, **config: Any) -> Any:
    """Return a Plotly figure as a component, with a label for screen readers."""
    settings = {"displayModeBar": False, "displaylogo": False, "responsive": True, **config}
    figure_element = dcc.Graph(
        id=name, figure=figure, config=settings, style={"height": f"{figure['layout']['height']:.0f}px"}
    )
    return html.Figure([figure_element], className="picture", role="img", **{"aria-label": label})


def table(head: Sequence[Any], rows: Iterable[Sequence[Any]], kind: str = "") -> Any:
    """Return a table with column headings. The first cell of each row is the heading of the row."""
    signed = ([with_minus(cell) if isinstance(cell, str) else cell for cell in row] for row in rows)
    body = [html.Tr([html.Th(first, scope="row"), *map(html.Td, cells)]) for first, *cells in signed]
    top = html.Thead(html.Tr([html.Th(cell, scope="col") if cell else html.Td() for cell in head]))
    return html.Div(html.Table([top, html.Tbody(body)], className=kind), className="wide")


def remarks(found: Iterable[Remark], most: int = 6) -> Any:
    """Return a list of remarks, the most severe first. If there are more than `most`, the others are folded."""
    points = []
    for alike, text in with_groups(found, Dialect.SHELL):
        state, code = state_of(alike[0]), html.Span(alike[0].code, className="code")
        mark = html.Span(MARKS[state], className="mark", title=WORDS[state])
        points.append(html.Li([mark, html.Span(text), code], className=state))
    if len(points) <= most + 1:
        return html.Ul(points, className="points")
    more = html.Details([html.Summary(f"{len(points) - most} more"), html.Ul(points[most:], className="points")])
    return html.Div([html.Ul(points[:most], className="points"), more])


def by_severity(found: Iterable[Remark]) -> Any:
    """Return remarks folded by severity, as in the report. Those that make numbers unusable are open."""
    titles = {
        "bad": "Find the cause before you use the numbers",
        "look": "Read before you use the numbers",
        "good": "Further notes",
    }
    groups: dict[str, list[Remark]] = {state: [] for state in titles}
    for remark in found:
        groups[state_of(remark)].append(remark)
    parts = []
    for state, title in titles.items():
        if alike := groups[state]:
            head = html.Summary([html.Span(MARKS[state], className="mark"), f" {title} ({len(texts(alike))})"])
            parts.append(html.Details([head, remarks(alike, len(alike))], open=state == "bad", className=state))
    return html.Div(parts)


def of_job(job: Job, show: Callable[[Any], Any], *, comes: str = "") -> Any:
    """Return what `show` makes of a job's result, or its state; while it runs, the text says what `comes`."""
    job.join(SILENT_S)
    if job.state == "done":
        return show(job.value)
    if job.state == "failed":
        return failure(job.error)
    if job.state == "cancelled":
        again = button("Start again", {"type": "again", "title": job.title})
        return html.P([f"{job.title} was cancelled. ", again], className="waiting")
    said = html.P(f"{job.title} …", className="waiting")
    return html.Div([said, html.P(f"Next: {comes}.", className="hint")], className="empty") if comes else said


def failure(error: Exception | None) -> Any:
    """Return a paragraph with the message of an error."""
    return html.P(message(error), className="error", role="alert")


def message(error: Exception | None) -> str:
    """Return the message of an error as text. If the error is a bug, print its traceback in the terminal."""
    if isinstance(error, GmwmError):
        return error.text(Dialect.SHELL)
    if isinstance(error, OSError):
        return f"{error.filename or 'file'}: {error.strerror or error}"
    if isinstance(error, MemoryError):
        return "There is not enough memory for a recording of this length."
    if error is not None:
        traceback.print_exception(error, file=sys.stderr)
    return f"gmwm has a bug: {type(error).__name__}: {error}. The terminal shows where."


Draw = Callable[[Session, Workspace, float], Any]
"""Function that returns the content of a page element from session, workspace and page width (CSS pixels)."""


def draws(app: Dash, desk: Desk, *, tab: str, place: str, draw: Draw) -> None:
    """Register a callback that draws `place` of a tab whenever the session, a result or the width changes. Unchanged
    content, by its digest, is not sent again: a click would be lost if its button were replaced meanwhile."""
    desk.places.append(place)

    def draw_place(data: Any, _: int, shown: str, width: float, page: str, digest: str | None) -> tuple[Any, Any]:
        if shown != tab:
            raise PreventUpdate
        try:
            session = desk.session(data)
            content = draw(session, desk.workspace(page), width) if session.file else _closed_text(place)
        except Exception as error:
            content = failure(error)
        new = hashlib.sha256(str(to_json_plotly(content)).encode()).hexdigest()
        return (no_update, no_update) if new == digest else (content, new)

    app.callback(
        Output(place, "children"), Output(digest_of(place), "data"), Input("session", "data"),
        Input("revision", "data"), Input("tab", "data"), Input("width", "data"), State("page", "data"),
        State(digest_of(place), "data"),
    )(draw_place)  # fmt: skip


def _closed_text(place: str) -> Any:
    """Return what a page element shows while no recording is open. Each tab has one text."""
    if place not in ("curves", "fit", "numbers", "preview"):
        return []
    return html.P("No recording is open. Open one in the tab Recording.", className="waiting")


def digest_of(place: str) -> str:
    """Return the name of the store that contains the digest of a page element."""
    return f"{place}-digest"


def restores(app: Dash, desk: Desk, fields: Sequence[str], values: Callable[[Session], Sequence[Any]]) -> None:
    """Register a callback that sets fields to the values of a session when the session is opened."""
    app.callback([Output(name, "value") for name in fields], Input("restored", "data"), State("session", "data"))(
        lambda _, data: list(values(desk.session(data)))
    )


def triggers() -> list[tuple[Any, str, Any]]:
    """Return component, property and new value of each input that triggered the callback. There can be several."""
    names = ctx.triggered_prop_ids
    return [
        (names[trigger["prop_id"]], trigger["prop_id"].rpartition(".")[2], trigger["value"])
        for trigger in ctx.triggered
    ]


Change = Callable[..., Session | None]
"""Returns the new session from the session and inputs, or None if a component was only created."""


def changes(
    app: Dash, desk: Desk, inputs: Sequence[Any], change: Change, *, states: Sequence[Any] = (),
    errors: Sequence[str] = (),
) -> None:  # fmt: skip
    """Register a callback that changes the session when an input changes. An error leaves the session as it is, and is
    shown at the field of its argument, or at the first of `errors`."""

    def apply_change(*given: Any) -> list[Any]:
        *values, data, page = given
        workspace, shown = desk.workspace(page), dict.fromkeys(errors, "")
        with workspace.lock:
            session = workspace.session or desk.session(data)
            try:
                new = change(session, *values)
                if new is None:
                    shown = dict.fromkeys(errors, no_update)
                workspace.session = session = new or session
            except (GmwmError, OSError) as error:
                argument = getattr(error, "argument", None) or getattr(error, "prefix", "")
                shown[str(argument) if argument in shown else errors[0]] = message(error)
        # The page ignores a response if it has sent a newer request. So each response contains the whole session.
        current = session.to_dict()
        return [no_update if current == data else current, *shown.values()]

    app.callback(
        Output("session", "data", allow_duplicate=True),
        *(Output(f"error-{name}", "children", allow_duplicate=True) for name in errors),
        *inputs, *states, State("session", "data"), State("page", "data"), prevent_initial_call=True,
    )(apply_change)  # fmt: skip
