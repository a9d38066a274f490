"""Shell commands and Python code that compute what a session shows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from gmwm.applications.app.session import EMPTY, Session
from gmwm.base.template import shell_word
from gmwm.files.readers.streams import is_large

FOLDER = "results"
"""Folder for results in the commands."""


def shell_lines(session: Session) -> list[str]:
    """Return the shell commands that write the files of the tab "Download".

    >>> print("\\n".join(shell_lines(Session(file="static.csv", reading={"skip": [[10, 20]]}))))
    gmwm calibrate static.csv --skip 10-20 --output results
    gmwm export results/calibration.json --format kalibr --output imu.yaml
    """
    calibrate = ["gmwm", "calibrate", session.file, *_reading(session.reading)]
    for axis, model in session.models.items():
        calibrate += ["--model", f"{axis}={model}"]
    if session.robust != EMPTY.robust:
        calibrate += ["--robust", "yes" if session.robust else "no"]
    if session.confidence != EMPTY.confidence:
        calibrate += ["--confidence", number(session.confidence)]
    calibrate += ["--output", FOLDER]
    export = ["gmwm", "export", f"{FOLDER}/calibration.json", "--format", session.export]
    if session.rule is not None:
        export += ["--axes", session.rule]
    if session.inflation != EMPTY.inflation:
        export += ["--inflation", number(session.inflation)]
    if session.horizon != EMPTY.horizon:
        export += ["--horizon", f"{number(session.horizon)}s"]
    export += ["--output", file_name(session)]
    return [" ".join(map(shell_word, words)) for words in (calibrate, export)]


def python_lines(session: Session) -> list[str]:
    """Return the lines of Python code that write the files of the tab "Download".

    >>> print("\\n".join(python_lines(Session(file="static.csv", models={"gyro": "GM + WN"}))))
    import gmwm
    <BLANKLINE>
    imu = gmwm.read('static.csv')
    calibration = gmwm.calibrate(imu, models={'gyro': 'GM + WN'}).of_file('static.csv')
    calibration.save('calibration.json')
    calibration.report('report.html')
    calibration.export('imu.yaml', 'kalibr')
    """
    options: dict[str, Any] = {"robust": session.robust, "confidence": session.confidence, "models": session.models}
    changed = {name: value for name, value in options.items() if value != getattr(EMPTY, name)}
    export: dict[str, Any] = {"axes": session.rule, "inflation": session.inflation, "horizon": session.horizon}
    defaults = {"axes": EMPTY.rule, "inflation": EMPTY.inflation, "horizon": EMPTY.horizon}
    chosen = {name: value for name, value in export.items() if value != defaults[name]}
    opened = "stream" if is_large(Path(session.file)) else "read"
    return [
        "import gmwm",
        "",
        f"imu = gmwm.{opened}({_call(session.file, **session.reading)})",
        f"calibration = gmwm.calibrate({_call(**changed, first='imu')}).of_file({session.file!r})",
        "calibration.save('calibration.json')",
        "calibration.report('report.html')",
        f"calibration.export({_call(file_name(session), session.export, **chosen)})",
    ]


def file_name(session: Session) -> str:
    """Return the name of the exported file in the format of a session.

    >>> file_name(Session()), file_name(Session(export="openvins"))
    ('imu.yaml', 'openvins.yaml')
    """
    from gmwm.showing.exporters.base import find_exporter

    return f"{'imu' if session.export == EMPTY.export else session.export}{find_exporter(session.export).extension}"


def number(value: float) -> str:
    """Format a number with all digits, but a whole number without a decimal point.

    >>> number(20.0), number(0.1)
    ('20', '0.1')
    """
    return repr(int(value)) if float(value).is_integer() and abs(value) < 1e15 else repr(float(value))


def _call(*values: Any, first: str = "", **named: Any) -> str:
    """Format the arguments of a Python call. `first` is an argument that is already code."""
    return ", ".join([*([first] if first else []), *map(repr, values), *(f"{k}={v!r}" for k, v in named.items())])


def _reading(reading: Mapping[str, Any]) -> Iterator[str]:
    """Yield the words of the shell options for reading a recording."""
    for name, value in reading.items():
        option = f"--{name.replace('_', '-')}"
        if name == "skip":
            for begin, end in value:
                yield from (option, f"{number(begin)}-{number(end)}")
        elif name == "columns":
            yield from (option, _columns(value))
        elif isinstance(value, Mapping):
            pairs = (f"{k}={number(v) if isinstance(v, float) else v}" for k, v in value.items())
            yield from (option, ",".join(pairs))
        elif isinstance(value, list):
            yield from (option, ",".join(value))
        else:
            yield from (option, number(value) if isinstance(value, float) else str(value))


def _columns(columns: Any) -> str:
    if isinstance(columns, Mapping):
        return ",".join(f"{axis}={'' if column is None else column}" for axis, column in columns.items())
    return ",".join(axis or "" for axis in columns)
