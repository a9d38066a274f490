"""Layout of the whole page: header, tabs, progress of long computations, and the stores that contain its state."""

from __future__ import annotations

import uuid
from pathlib import Path
from typing import Any

from dash import ALL, Dash, Input, Output, State, ctx, dcc, html, no_update

from gmwm.applications.app.page import curves, download, model, numbers, recording
from gmwm.applications.app.page.widgets import button, changes, choices, digest_of, restores
from gmwm.applications.app.workspace import Desk

TABS = {
    "recording": ("Recording", recording),
    "curves": ("Curves", curves),
    "model": ("Model", model),
    "numbers": ("Numbers", numbers),
    "download": ("Download", download),
}
UNITS = {"datasheet": "deg/h, mg", "si": "rad/s, m/s²"}

SHOW_TAB = """
function(...args) {
  const names = %s, context = window.dash_clientside.callback_context;
  const hit = context.triggered.length ? context.triggered[0].prop_id.split('.')[0].replace('tab-', '') : '';
  const shown = names.includes(hit) && args[names.indexOf(hit)] ? hit : args[args.length - 1] || names[0];
  return [shown, ...names.map(n => n !== shown), ...names.map(n => String(n === shown)),
          ...names.map(n => n === shown ? 0 : -1)];
}
"""
WIDTH = "function(id) { return document.documentElement.clientWidth; }"


def layout(desk: Desk) -> Any:
    """Return the components of a new page."""
    return html.Div(
        [
            dcc.Store(id="session", data=desk.first.to_dict()),
            dcc.Store(id="page", data=uuid.uuid4().hex),
            dcc.Store(id="restored", data=0),
            dcc.Store(id="dropped"),
            dcc.Store(id="revision", data=0),
            dcc.Store(id="width", data=1280),
            dcc.Store(id="tab", data="recording"),
            dcc.Store(id="time-unit", data=1.0),
            dcc.Store(id="model-shown"),
            *(dcc.Store(id=digest_of(place)) for place in desk.places),
            dcc.Interval(id="poll", interval=400),  # milliseconds
            dcc.Download(id="file"),
            html.Header(
                [
                    html.H1("gmwm"),
                    html.P(id="opened", className="opened"),
                    choices("units", UNITS, "datasheet", "Units"),
                    html.Nav(_tabs(), role="tablist", **{"aria-label": "Steps"}),
                    html.Div(
                        [
                            html.Progress(id="progress", max=1, value=0),
                            html.Span(id="doing"),
                            button("Cancel", "cancel", "small"),
                        ],
                        id="status", className="idle", role="status", **{"aria-live": "polite"},
                    ),
                ]
            ),
            html.Main(
                [
                    html.Section(
                        module.panel(), id=f"panel-{name}", role="tabpanel", hidden=name != "recording",
                        **{"aria-labelledby": f"tab-{name}"},
                    )
                    for name, (_, module) in TABS.items()
                ]
            ),
        ],
        id="root",
    )  # fmt: skip


def _tabs() -> list[Any]:
    return [
        html.Button(
            title, id=f"tab-{name}", n_clicks=0, type="button", role="tab", tabIndex=0 if name == "recording" else -1,
            **{"aria-selected": str(name == "recording").lower(), "aria-controls": f"panel-{name}"},
        )
        for name, (title, _) in TABS.items()
    ]  # fmt: skip


def register(app: Dash, desk: Desk) -> None:
    """Register the callbacks of the page and of all tabs."""
    names = list(TABS)
    app.clientside_callback(
        SHOW_TAB % names,
        Output("tab", "data"),
        *(Output(f"panel-{name}", "hidden") for name in names),
        *(Output(f"tab-{name}", "aria-selected") for name in names),
        *(Output(f"tab-{name}", "tabIndex") for name in names),
        *(Input(f"tab-{name}", "n_clicks") for name in names),
        State("tab", "data"),
    )
    app.clientside_callback(WIDTH, Output("width", "data"), Input("page", "data"))

    def poll(_: int, page: str, seen: int) -> tuple[Any, ...]:
        jobs = desk.workspace(page).jobs
        running = jobs.running()
        revision = no_update if jobs.revision == seen else jobs.revision
        if not running:
            return revision, "idle", "", no_update
        job = running[-1]
        share = "" if job.share is None else str(job.share)
        return revision, "busy", job.progress, share

    app.callback(
        Output("revision", "data"), Output("status", "className"), Output("doing", "children"),
        Output("progress", "value"), Input("poll", "n_intervals"), State("page", "data"), State("revision", "data"),
    )(poll)  # fmt: skip

    def stop(clicks: int, again: list[int], page: str) -> int:
        jobs = desk.workspace(page).jobs
        if ctx.triggered_id == "cancel" and clicks:
            jobs.cancel()
        elif any(again):
            jobs.again()
        return jobs.revision

    app.callback(
        Output("revision", "data", allow_duplicate=True),
        Input("cancel", "n_clicks"), Input({"type": "again", "title": ALL}, "n_clicks"), State("page", "data"),
        prevent_initial_call=True,
    )(stop)  # fmt: skip

    def file_shown(data: dict[str, Any]) -> str:
        file = desk.session(data).file
        return Path(file).name if file else "No recording is open"

    app.callback(Output("opened", "children"), Input("session", "data"))(file_shown)
    changes(app, desk, [Input("units", "value")], lambda session, units: session.with_(units=units), errors=("file",))
    restores(app, desk, ("units",), lambda session: [session.units])
    for _, module in TABS.values():
        module.register(app, desk)
