"""gmwm app: calibrate in the browser."""

from __future__ import annotations

from pathlib import Path

from gmwm.cli.command import command
from gmwm.cli.output import Outcome

EXAMPLES = ("gmwm app static.csv", "gmwm app recordings", "gmwm app session.json")


@command
def app(
    path: Path = Path("."),
    port: int = 0,
    browser: bool = True,
) -> Outcome:
    """Calibrate in the browser: look at a recording, leave out time ranges, try models, and download the files.

    The page runs on this computer only: nothing is sent over the network. It shows the commands that repeat what
    was done. Ctrl-C stops it. The page needs the optional dependencies "app" of gmwm.

    Arguments:
        path ([FILE]): A recording, a session.json that the page saved, or a folder. The page can open the files in this
            folder.
    Options:
        port (0 … 65535): Port of the page; 0 for any free port.
        browser (--browser/--no-browser): Open the page in the browser."""
    from gmwm.applications.app.server import serve

    return serve(path, port=port, browser=browser, tell=lambda url: print(f"{url}\nCtrl-C ends gmwm app.", flush=True))
