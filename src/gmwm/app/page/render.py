"""Register callbacks that draw a tab, or change the session, with errors beside their fields."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from typing import Any

from dash import Dash, Input, Output, State, ctx, no_update
from dash.exceptions import PreventUpdate
from plotly.io.json import to_json_plotly

from gmwm.app.desk import Desk
from gmwm.app.page.widgets import failure, message
from gmwm.app.session import Session
from gmwm.app.workspace import Workspace
from gmwm.errors import GmwmError

Draw = Callable[[Session, Workspace, float], Any]
"""Make the content of a place from the session, the results, and the width of the page (CSS pixels)."""


def draws(app: Dash, desk: Desk, *, tab: str, place: str, draw: Draw) -> None:
    """Draw a place of a tab anew whenever the session, a result or the width changes.

    The page holds a digest of what the place shows. Equal content is not sent again: replacing a button at the moment
    of a click would lose the click.
    """
    desk.places.append(place)

    def drawn(data: Any, _: int, shown: str, width: float, page: str, digest: str | None) -> tuple[Any, Any]:
        if shown != tab:
            raise PreventUpdate
        try:
            session = desk.session(data)
            content = draw(session, desk.workspace(page), width) if session.file else []
        except Exception as error:
            content = failure(error)
        new = hashlib.sha256(str(to_json_plotly(content)).encode()).hexdigest()
        return (no_update, no_update) if new == digest else (content, new)

    app.callback(
        Output(place, "children"), Output(digest_of(place), "data"), Input("session", "data"),
        Input("revision", "data"), Input("tab", "data"), Input("width", "data"), State("page", "data"),
        State(digest_of(place), "data"),
    )(drawn)  # fmt: skip


def digest_of(place: str) -> str:
    """Return the name of the store of a place's digest."""
    return f"{place}-digest"


def restores(app: Dash, desk: Desk, fields: Sequence[str], values: Callable[[Session], Sequence[Any]]) -> None:
    """Set the values of fields when a session is opened."""
    app.callback([Output(name, "value") for name in fields], Input("restored", "data"), State("session", "data"))(
        lambda _, data: list(values(desk.session(data)))
    )


def triggers() -> list[tuple[Any, str, Any]]:
    """Return the component, the property and its value of each input that changed; two may change at once."""
    names = ctx.triggered_prop_ids
    return [(names[one["prop_id"]], one["prop_id"].rpartition(".")[2], one["value"]) for one in ctx.triggered]


Change = Callable[..., Session | None]
"""Return the new session from the session and the values of the inputs and states; None if nothing was done, because
an input was only made."""


def changes(
    app: Dash, desk: Desk, inputs: Sequence[Any], change: Change, *, states: Sequence[Any] = (),
    errors: Sequence[str] = (),
) -> None:  # fmt: skip
    """Change the session when one of the inputs changes.

    An error is shown beside the field of its argument, or beside the first field; the session stays as it was.
    """

    def changed(*given: Any) -> list[Any]:
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
        # The page drops an answer if its next question comes before it: the next answer has what it missed.
        known = session.to_dict()
        return [no_update if known == data else known, *shown.values()]

    app.callback(
        Output("session", "data", allow_duplicate=True),
        *(Output(f"error-{name}", "children", allow_duplicate=True) for name in errors),
        *inputs, *states, State("session", "data"), State("page", "data"), prevent_initial_call=True,
    )(changed)  # fmt: skip
