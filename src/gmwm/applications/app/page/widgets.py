"""Components that several tabs use: fields with errors, lists of remarks, tables, figures, and states of jobs."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from dash import dcc, html

from gmwm.applications.app.figures import Drawn
from gmwm.applications.app.jobs import SILENT_S, Job
from gmwm.base.errors import GmwmError
from gmwm.base.remarks import Dialect, Remark, texts, with_groups
from gmwm.showing.reports.verdict import state_of

WORDS = {"bad": "Do not use", "look": "Read first", "good": "Note"}
"""Meaning of the symbol in front of a remark, for screen readers."""
MARKS = {"bad": "✗", "look": "!", "good": "·"}


def field(label: str, control: Any, name: str, hint: str = "") -> Any:
    """Return a control with its label and an empty element for its error message."""
    return html.Div(
        [
            html.Label([html.Span(label), control]),
            html.Small(hint) if hint else None,
            html.P(id=f"error-{name}", className="error", role="alert"),
        ],
        className="field",
    )


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
    body = [html.Tr([html.Th(first, scope="row"), *map(html.Td, cells)]) for first, *cells in rows]
    top = html.Thead(html.Tr([html.Th(cell, scope="col") if cell else html.Td() for cell in head]))
    return html.Div(html.Table([top, html.Tbody(body)], className=kind), className="wide")


def remarks(found: Iterable[Remark], most: int = 6) -> Any:
    """Return a list of remarks, the most severe first. If there are more than `most`, the others are folded."""
    points = [
        html.Li(
            [
                html.Span(MARKS[state], className="mark", title=WORDS[state]),
                html.Span(text),
                html.Span(group[0].code, className="code"),
            ],
            className=state,
        )
        for group, text in with_groups(found, Dialect.SHELL)
        for state in [state_of(group[0])]
    ]
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
        if group := groups[state]:
            head = html.Summary([html.Span(MARKS[state], className="mark"), f" {title} ({len(texts(group))})"])
            parts.append(html.Details([head, remarks(group, len(group))], open=state == "bad", className=state))
    return html.Div(parts)


def of_job(job: Job, show: Callable[[Any], Any], *, comes: str = "") -> Any:
    """Return the component that `show` makes from the result of a job, or a text with the state of the job. While the
    job runs, the text says what `comes`, and the page adds the progress of the job."""
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
