"""The server of `gmwm app`. It listens on 127.0.0.1 only, serves one user, and leaves no files when it ends."""

from __future__ import annotations

import hmac
import json
import logging
import math
import re
import secrets
import tempfile
import threading
import time
import warnings
import webbrowser
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from gmwm.applications.app.folders import LARGEST_DROP, Folders, too_large
from gmwm.applications.app.session import Session
from gmwm.applications.app.workspace import Desk
from gmwm.base.errors import GmwmError, GmwmWarning, OptionError, ReadError
from gmwm.base.extras import library

LARGEST_CALLBACK = 1_000_000  # largest size of the request of a callback (bytes)
LONGEST = {"reference": 100_000}  # largest length of the text of a field; 4000 for all others
RANGES = {"horizon": (-2.0, 3.0), "inflation": (1.0, 20.0)}  # ranges of the sliders


class ForgedRequestError(Exception):
    """A request that the page cannot have sent."""


def require_callback(body: Any, callbacks: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise ForgedRequestError unless the page can send this request to a callback, by Dash's outputs."""
    _require(isinstance(body, dict) and isinstance(body.get("output"), str), "it names no callback")
    callback = callbacks.get(body["output"], {})
    _require("callback" in callback, "no callback has this output")
    _require_outputs(body.get("outputs"), body["output"])
    for kind in ("inputs", "state"):
        items = body.get(kind, [])
        _require(isinstance(items, list) and len(items) == len(callback[kind]), f"it has other {kind}")
        for item, expected in zip(items, callback[kind], strict=True):
            _require_item(item, expected)
    changed = body.get("changedPropIds", [])
    _require(isinstance(changed, list) and len(changed) <= 1000, "its triggers are no list")
    for name in changed:
        _require(
            isinstance(name, str) and any(_is_name(name, expected) for expected in callback["inputs"]), "other trigger"
        )


def _require(condition: bool, reason: str) -> None:
    if not condition:
        raise ForgedRequestError(reason)


def _require_outputs(outputs: Any, output: str) -> None:
    """Require that the outputs are those of the callback."""
    listed = outputs if isinstance(outputs, list) else [outputs]
    _require(all(_is_item(item) and isinstance(item["id"], str) for item in listed), "it has other outputs")
    names = [f"{item['id']}.{item['property'].partition('@')[0]}" for item in listed]
    expected = output.strip(".").split("...") if output.startswith("..") else [output]
    _require(names == [name.partition("@")[0] for name in expected], "it has other outputs")


def _is_item(item: Any) -> bool:
    return isinstance(item, dict) and "id" in item and isinstance(item.get("property"), str)


def _require_item(item: Any, expected: Mapping[str, str]) -> None:
    """Require that a sent component, or each of a list of components, is the expected one, with a possible value."""
    if not expected["id"].startswith("{"):
        _require(
            _is_item(item) and item["id"] == expected["id"] and item["property"] == expected["property"], "other input"
        )
        require_value(expected["id"], expected["property"], item.get("value"))
        return
    _require(isinstance(item, list), "an input is no list")
    for member in item:
        _require(_is_item(member) and member["property"] == expected["property"], "other input")
        _require(_matches(member["id"], expected["id"]), "other input")
        require_value(member["id"]["type"], expected["property"], member.get("value"))


def _matches(name: Any, pattern: str) -> bool:
    """Return whether the name of a component belongs to a pattern, such as {"type": "axis", "axis": "gyro_x"}."""
    keys = json.loads(pattern)
    if not isinstance(name, dict) or name.keys() != keys.keys() or name["type"] != keys["type"]:
        return False
    return all(isinstance(text, str) and len(text) <= 4000 for text in name.values())


def _is_name(name: str, expected: Mapping[str, str]) -> bool:
    """Return whether a text names a component of an input and its property. The component may have been removed."""
    component, _, prop = name.rpartition(".")
    if not expected["id"].startswith("{") or not component.startswith("{"):
        return (component, prop) == (expected["id"], expected["property"])
    try:
        return prop == expected["property"] and _matches(json.loads(component), expected["id"])
    except ValueError:
        return False


def require_value(name: str, prop: str, value: Any) -> None:
    """Require that a property of the component `name` can have a value. None is a value that was never set."""
    if value is None and (name, prop) not in _NEVER_NONE:
        return
    if prop in ("n_clicks", "n_submit", "n_blur", "n_intervals"):
        _require(_is_count(value), f"{prop} of {name} is no count")
    elif prop == "relayoutData":
        _require(isinstance(value, dict) and _is_change(value), f"{prop} of {name} is no change of a figure")
    elif prop == "value" and name in RANGES:
        low, high = RANGES[name]
        _require(_is_number(value) and low <= value <= high, f"{name} is out of range")
    elif prop == "value":
        _require(isinstance(value, str) and len(value) <= LONGEST.get(name, 4000), f"{name} is no text, or too long")
    else:
        check = _DATA.get(name, _is_digest if name.endswith("-digest") else None)
        _require(prop == "data" and check is not None and check(value), f"{name} has another kind of data")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def _is_count(value: Any) -> bool:
    return _is_number(value) and -1 <= value < 2**53 and value == math.floor(value)


def _is_change(value: Any, depth: int = 5) -> bool:
    """Return whether a value describes a change of a figure: a number, a text, or a short list or object of these."""
    if isinstance(value, list | dict):
        items = list(value.values()) if isinstance(value, dict) else value
        return depth > 0 and len(items) <= 64 and all(_is_change(item, depth - 1) for item in items)
    return (
        value is None or isinstance(value, bool) or _is_number(value) or (isinstance(value, str) and len(value) < 4000)
    )


def _is_session(value: Any) -> bool:
    try:
        return isinstance(value, dict) and bool(Session.from_dict(value).to_dict() or True)
    except GmwmError:
        return False


def _is_model_shown(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and _is_session(value[0]) and isinstance(value[1], str)


def _is_digest(value: Any) -> bool:
    return isinstance(value, str) and re.fullmatch("[0-9a-f]{64}", value) is not None


_DATA: Mapping[str, Callable[[Any], bool]] = {
    "session": _is_session, "model-shown": _is_model_shown, "restored": _is_count, "revision": _is_count,
    "page": lambda value: isinstance(value, str) and re.fullmatch("[0-9a-f]{32}", value) is not None,
    "dropped": lambda value: isinstance(value, str) and len(value) <= 4000,
    "width": lambda value: _is_number(value) and 1 <= value <= 100_000,
    "time-unit": lambda value: _is_number(value) and 0 < value < 1e12,
    "tab": lambda value: value in ("recording", "curves", "model", "numbers", "download"),
}  # fmt: skip
_NEVER_NONE = {(name, "data") for name in ("session", "page", "width", "tab", "time-unit", "revision", "restored")} | {
    (name, "value") for name in RANGES
}


HOST = "127.0.0.1"
LOADED = (
    "scipy.fft", "scipy.interpolate", "scipy.linalg", "scipy.optimize", "scipy.signal", "scipy.special", "scipy.stats",
)  # fmt: skip
"""Modules imported before the server starts: SciPy fails if several threads import it (tests/app/test_server.py)."""
SIGNAL_CHECK_S = 0.2  # time (s) between two checks for signals such as Ctrl-C


@dataclass(frozen=True)
class Served:
    """A running server: address of the page, with the secret token, and the files that the page may open."""

    url: str
    folders: Folders


def serve(path: Path, *, port: int = 0, browser: bool = True, tell: Callable[[str], None] = print) -> NoReturn:
    """Serve the page, and open it in the browser, until Ctrl-C or another signal raises an exception."""
    with running(path, port=port) as server:
        tell(server.url)
        if browser:
            webbrowser.open(server.url)
        while True:
            # Polars installs its own handler for Ctrl-C. With it, Ctrl-C would not interrupt an unlimited wait.
            time.sleep(SIGNAL_CHECK_S)


@contextmanager
def running(path: Path, *, port: int = 0) -> Iterator[Served]:
    """Run the server in a thread while the block runs. Then cancel all jobs and remove the temporary folder."""
    library("dash")
    from werkzeug.serving import make_server

    for name in LOADED:
        import_module(name)
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    with tempfile.TemporaryDirectory(prefix="gmwm-app-") as temporary, warnings.catch_warnings():
        # The page shows the same texts as remarks on the recording.
        warnings.simplefilter("ignore", GmwmWarning)
        folders, first = open_path(path, Path(temporary).resolve())
        desk, token = Desk(folders, first), secrets.token_urlsafe(24)
        server = make_server(HOST, port, _unready, threaded=True)
        host = f"{HOST}:{server.server_port}"
        server.app = application(desk, host=host, token=token)
        server.daemon_threads = True
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": SIGNAL_CHECK_S}, daemon=True)
        thread.start()
        try:
            yield Served(f"http://{host}/{token}/", folders)
        finally:
            desk.close()
            server.shutdown()
            server.server_close()


def open_path(path: Path, dropped: Path) -> tuple[Folders, Session]:
    """Return the folder that the page may access, and the first session, for a recording, session.json or folder."""
    if not path.exists():
        raise OptionError(argument="path", expected="a recording, a session.json or a folder", got=str(path))
    root = path.resolve()
    if root.is_dir():
        return Folders(root, dropped), Session()
    folders = Folders(root.parent, dropped)
    if root.suffix != ".json":
        return folders, Session(file=str(root))
    session = Session.load(root)
    return Folders(folders.file(session.file).parent, dropped) if session.file else folders, session


def application(desk: Desk, *, host: str, token: str) -> Any:
    """Return the web application. It serves the Dash page, and refuses requests from other pages and programs."""
    from dash import Dash
    from flask import Flask, request

    from gmwm.applications.app.page.layout import layout, register

    prefix = f"/{token}/"
    flask = Flask("gmwm")
    flask.before_request(lambda: None if _is_allowed(request, host, token) else ("Refused.", 403))

    def receive() -> Any:
        try:
            if (request.content_length or 0) > LARGEST_DROP:
                raise too_large(request.content_length or 0)
            return {"path": str(desk.folders.store(request.args.get("name", ""), request.stream))}
        except ReadError as error:
            return str(error), 413
        except OSError as error:
            return f"The file could not be stored: {error.strerror}.", 507

    flask.add_url_rule(f"{prefix}dropped", view_func=receive, methods=["POST"])

    app = Dash(
        "gmwm", server=flask, url_base_pathname=prefix, title="gmwm", update_title="", serve_locally=True,
        assets_folder=str(Path(__file__).with_name("assets")), suppress_callback_exceptions=True,
        index_string=INDEX,
    )  # fmt: skip
    app.layout = lambda: layout(desk)
    register(app, desk)

    def check_callback() -> Any:
        """Refuse the callbacks that the page cannot send."""
        if not request.path.endswith("/_dash-update-component"):
            return None
        if (request.content_length or 0) > LARGEST_CALLBACK:
            return "Too large.", 413
        try:
            require_callback(json.loads(request.get_data()), app.callback_map)
        except (ValueError, RecursionError, ForgedRequestError) as error:
            return f"Refused: {error}"[:200], 400
        return None

    flask.before_request(check_callback)
    policy = "; ".join(
        (
            "default-src 'none'", f"script-src 'self' {' '.join(app.csp_hashes())}",
            "style-src 'self' 'unsafe-inline'", "img-src 'self' data: blob:", "connect-src 'self'", "font-src 'self'",
            "base-uri 'none'", "form-action 'none'", "frame-ancestors 'none'",
        )
    )  # fmt: skip

    def headers(response: Any) -> Any:
        response.headers.update(
            {
                "Content-Security-Policy": policy,
                "Cross-Origin-Resource-Policy": "same-origin",
                "Referrer-Policy": "no-referrer",
                "X-Content-Type-Options": "nosniff",
            }
        )
        return response

    flask.after_request(headers)
    return flask


def _is_allowed(request: Any, host: str, token: str) -> bool:
    """Return whether a request comes from the page itself, by token, host and origin. A foreign page could have a host
    name that resolves to 127.0.0.1, or send requests to any address."""
    sent_token = request.path.split("/", 2)[1] if request.path.startswith("/") else ""
    origin = request.headers.get("Origin")
    if origin is None and request.method not in ("GET", "HEAD"):
        return False
    same = origin is None or origin == f"http://{host}"
    return request.host == host and same and hmac.compare_digest(sent_token.encode(), token.encode())


def _unready(environ: Any, start: Any) -> list[bytes]:
    """Answer requests with an error until the application is ready."""
    start("503 Service Unavailable", [])
    return []


INDEX = """<!DOCTYPE html>
<html lang="en">
<head>
{%metas%}
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{%title%}</title>
<link rel="icon" href="data:,">
{%css%}
</head>
<body>
{%app_entry%}
<footer>{%config%}{%scripts%}{%renderer%}</footer>
</body>
</html>
"""
