"""Functions that register callbacks, which draw parts of a tab or change the session."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from typing import Any

from dash import Dash, Input, Output, State, ctx, html, no_update
from dash.exceptions import PreventUpdate
from plotly.io.json import to_json_plotly

from gmwm.applications.app.desk import Desk
from gmwm.applications.app.page.widgets import failure, message
from gmwm.applications.app.session import Session
from gmwm.applications.app.workspace import Workspace
from gmwm.base.errors import GmwmError

Draw = Callable[[Session, Workspace, float], Any]
"""Function that returns the content of a page element from session, workspace and page width (CSS pixels)."""


def draws(app: Dash, desk: Desk, *, tab: str, place: str, draw: Draw) -> None:
    """Register a callback that draws the element `place` of a tab whenever the session, a result or the width changes.

    The page stores a digest of the content of the element. Unchanged content is not sent again, because a click would
    be lost if the button were replaced at the same moment.
    """
    desk.places.append(place)

    def draw_place(data: Any, _: int, shown: str, width: float, page: str, digest: str | None) -> tuple[Any, Any]:
        if shown != tab:
            raise PreventUpdate
        try:
            session = desk.session(data)
            content = draw(session, desk.workspace(page), width) if session.file else _closed(place)
        except Exception as error:
            content = failure(error)
        new = hashlib.sha256(str(to_json_plotly(content)).encode()).hexdigest()
        return (no_update, no_update) if new == digest else (content, new)

    app.callback(
        Output(place, "children"), Output(digest_of(place), "data"), Input("session", "data"),
        Input("revision", "data"), Input("tab", "data"), Input("width", "data"), State("page", "data"),
        State(digest_of(place), "data"),
    )(draw_place)  # fmt: skip


def _closed(place: str) -> Any:
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
"""Function that returns the new session from the session and the values of the inputs and states. It returns None if
the user did nothing, because a component was only created."""


def changes(
    app: Dash, desk: Desk, inputs: Sequence[Any], change: Change, *, states: Sequence[Any] = (),
    errors: Sequence[str] = (),
) -> None:  # fmt: skip
    """Register a callback that changes the session when one of the inputs changes.

    If the change raises an error, the session is not changed. The error is shown beside the field of its argument, or
    beside the first of the fields `errors`.
    """

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
