"""The manual page of gmwm for `man`, made from the help of the commands, and the JSON Schemas of their output."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from gmwm.base.documents import DIALECT
from gmwm.base.errors import OptionError
from gmwm.cli.output import one_line

SCHEMAS = Path(__file__).with_name("schemas.json")
"""Made from the JSON that the commands print in the tests: `python -m tests.json_outputs`."""


def schema(name: str) -> dict[str, Any]:
    """Return the schema of the JSON of a command, of the lines of events before it (monitor-event), or of the files
    calibration.json and session.json."""
    if name == "calibration.json":
        from gmwm.calibration.result import Calibration

        return Calibration.schema()
    if name == "session.json":
        from gmwm.applications.app.session import Session

        return Session.schema()
    schemas = json.loads(SCHEMAS.read_text(encoding="utf-8"))
    if name not in schemas:
        raise OptionError(
            argument="schema", expected=f"one of calibration.json, session.json, {', '.join(schemas)}", got=name
        )
    return {"$schema": DIALECT, "title": f"gmwm {name}", **schemas[name]}


def manual(context: Any) -> str:
    """Return the manual page as troff source: the description, and each command with its options and examples."""
    from gmwm import __version__

    program = context.command
    title, *paragraphs = program.help.split("\n\n")
    lines = [
        f'.TH GMWM 1 "" "gmwm {__version__}" "User Commands"', ".SH NAME", f"gmwm \\- {_escaped(title)}",
        ".SH SYNOPSIS", ".B gmwm", r"\fICOMMAND\fR [\fIOPTIONS\fR]", ".SH DESCRIPTION",
        *_paragraphs(paragraphs), *_options(program, context), ".SH COMMANDS",
    ]  # fmt: skip
    for name in program.list_commands(context):
        lines += _command(program.get_command(context, name), context)
    return "\n".join(lines) + "\n"


def _command(command: Any, parent: Any) -> Iterator[str]:
    context = type(parent)(command, info_name=command.name, parent=parent)
    usage = " ".join(command.collect_usage_pieces(context))
    yield f".SS {_escaped(f'gmwm {command.name} {usage}')}"
    yield from _paragraphs((command.help or "").split("\n\n"))
    yield from _options(command, context)
    heading, *examples = (command.epilog or "").split("\n\n")
    if examples:
        yield from (".PP", _escaped(heading), ".nf", *(f"  {_escaped(example)}" for example in examples), ".fi")


def _options(command: Any, context: Any) -> Iterator[str]:
    for parameter in command.get_params(context):
        names, text = parameter.get_help_record(context) or ("", "")
        if names:
            yield from (".TP", rf"\fB{_escaped(names)}\fR", _escaped(one_line(text)))


def _paragraphs(texts: list[str]) -> Iterator[str]:
    for text in texts:
        yield from (".PP", _escaped(one_line(text)))


def _escaped(text: str) -> str:
    """Escape what troff would interpret: backslashes, hyphens, and a dot or an apostrophe at the start of a line.

    >>> print(_escaped(".imu with --json"))
    \\&.imu with \\-\\-json
    """
    escaped = text.replace("\\", r"\e").replace("-", r"\-")
    return rf"\&{escaped}" if escaped.startswith((".", "'")) else escaped
