"""The tab "Download": an exported file with a preview, other files, and commands that produce the same files."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dash import Dash, Input, Output, State, ctx, dcc, html, no_update

from gmwm.applications.app.page.widgets import button, changes, draws, field, group, menu, message, of_job, restores
from gmwm.applications.app.session import EMPTY, Session, file_name, python_lines, shell_lines
from gmwm.applications.app.workspace import Desk, Workspace
from gmwm.base.errors import GmwmError, OptionError
from gmwm.calibration import Calibration
from gmwm.showing.exporters import export_formats
from gmwm.showing.exporters.reduction import RULES

RULE_NAMES = {"": "as usual for the format", **{str(rule): str(rule) for rule in RULES}}


def panel() -> list[Any]:
    """Return the components of the tab."""
    formats = {name: title[:1].upper() + title[1:] for name, title in export_formats().items()}
    return [
        group(
            "fields",
            field("Format", menu("format", formats, EMPTY.export), "export"),
            field("Axes of a sensor", menu("rule", RULE_NAMES, ""), "axes"),
            button("Download this file", "download", "main"),
        ),
        html.P(id="error-download", className="error", role="alert"),
        html.Div(id="preview"),
        html.H2("More files"),
        group(
            "controls", button("report.html", "get-report"), button("calibration.json", "get-json"),
            button("session.json", "get-session"),
        ),
        html.P("session.json reopens this page: open it like a recording.", className="hint"),
        html.H2("The same in a shell"),
        html.Div(id="shell"),
        html.H2("The same in Python"),
        html.Div(id="python"),
    ]  # fmt: skip


def register(app: Dash, desk: Desk) -> None:
    """Register the callbacks of the tab."""

    def choose(session: Session, form: str, rule: str) -> Session:
        return session.with_(export=form, rule=rule or None)

    changes(app, desk, [Input("format", "value"), Input("rule", "value")], choose, errors=("export", "axes"))
    restores(app, desk, ("format", "rule"), lambda session: [session.export, session.rule or ""])
    draws(app, desk, tab="download", place="preview", draw=_preview)
    for name, lines in (("shell", shell_lines), ("python", python_lines)):

        def draw(session: Session, _: Any, __: Any, name: str = name, lines: Any = lines) -> Any:
            return _block("\n".join(lines(_own(session, desk))), name)

        draws(app, desk, tab="download", place=name, draw=draw)

    def fetch(*given: Any) -> tuple[Any, str]:
        *clicks, data, page = given
        if not any(clicks):
            return no_update, ""
        try:
            name, text = _file(str(ctx.triggered_id), desk.session(data), desk.workspace(page))
        except (GmwmError, OSError) as error:
            return no_update, message(error)
        return {"filename": name, "content": text, "type": "text/plain;charset=utf-8", "base64": False}, ""

    app.callback(
        Output("file", "data"), Output("error-download", "children"),
        *(Input(name, "n_clicks") for name in ("download", "get-report", "get-json", "get-session")),
        State("session", "data"), State("page", "data"), prevent_initial_call=True,
    )(fetch)  # fmt: skip


def export_text(found: Calibration, session: Session) -> str:
    """Return the text of the file in the chosen export format."""
    return found.export(format=session.export, axes=session.rule, inflation=session.inflation, horizon=session.horizon)


def _file(wanted: str, session: Session, workspace: Workspace) -> tuple[str, str]:
    """Return the name and the text of the file that a button downloads. `wanted` is the name of the button."""
    if wanted == "get-session":
        return "session.json", session.to_text()
    job = workspace.calibration(session)
    job.join(3600)
    if job.error is not None:
        raise job.error
    if job.state != "done":
        raise OptionError("the calibration was cancelled", advice="Start it again above.")
    calibration: Calibration = job.value
    if wanted == "get-report":
        return "report.html", _file_text(calibration.report, "report.html")
    if wanted == "get-json":
        return "calibration.json", _file_text(calibration.save, "calibration.json")
    return file_name(session), export_text(calibration, session)


def _file_text(write: Callable[[Path], Any], name: str) -> str:
    with tempfile.TemporaryDirectory(prefix="gmwm-app-") as folder:
        path = Path(folder, name)
        write(path)
        return path.read_text(encoding="utf-8")


def _preview(session: Session, workspace: Workspace, width: float) -> Any:
    return of_job(
        workspace.calibration(session), lambda found: _block(export_text(found, session), file_name(session)),
        comes=f"the text of {file_name(session)}",
    )  # fmt: skip


def _own(session: Session, desk: Desk) -> Session:
    """Return the session with the name of a dropped file instead of the path of its temporary copy."""
    path = Path(session.file)
    return session.with_(file=path.name) if path.is_relative_to(desk.folders.dropped) else session


def _block(text: str, name: str) -> Any:
    """Return a component that shows a text with a button that copies it to the clipboard."""
    place = f"text-{name.partition('.')[0]}"
    copy = dcc.Clipboard(target_id=place, title="Copy", className="copy")
    return html.Div([copy, html.Pre(text, id=place, tabIndex=0)], className="block")
