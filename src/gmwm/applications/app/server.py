"""The server of `gmwm app`. It listens on 127.0.0.1 only, serves one user, and leaves no files when it ends."""

from __future__ import annotations

import hmac
import json
import logging
import secrets
import tempfile
import threading
import time
import warnings
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from gmwm.applications.app.desk import Desk
from gmwm.applications.app.door import LARGEST_CALLBACK, ForgedRequestError, require_callback
from gmwm.applications.app.folders import LARGEST_DROP, Folders, too_large
from gmwm.applications.app.session import Session
from gmwm.base.errors import GmwmWarning, OptionError, ReadError
from gmwm.base.extras import library

HOST = "127.0.0.1"
LOADED = (
    "scipy.fft", "scipy.interpolate", "scipy.linalg", "scipy.optimize", "scipy.signal", "scipy.special", "scipy.stats",
)  # fmt: skip
"""Modules that gmwm imports when it needs them. They are imported before the server starts, because SciPy cannot be
imported by several threads at once (tests/app/test_server.py)."""
SIGNAL_CHECK_S = 0.2
"""Time (s) between two checks for signals such as Ctrl-C."""


@dataclass(frozen=True)
class Served:
    """A running server.

    Attributes
    ----------
    url : str
        Address of the page, which contains the secret token.
    folders : Folders
        The files that the page may open.
    """

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
    """Return whether a request comes from the page itself.

    The token, the host and the origin must be correct. The host is checked because a foreign page could have a host
    name that resolves to 127.0.0.1. The origin is checked because a foreign page can send requests to any address.
    """
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
