"""JSON Schemas of what commands print with --json and write into files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from gmwm.base.errors import OptionError
from gmwm.base.schema import DIALECT

FILE = Path(__file__).with_name("schemas.json")
"""Made from the JSON that the commands print in the tests: `python -m tests.json_outputs`."""


def schema(name: str) -> dict[str, Any]:
    """Return the schema of the JSON of a command, of the lines of events before it (monitor-event), or of
    calibration.json."""
    if name == "calibration.json":
        from gmwm.calibration.result import Calibration

        return Calibration.schema()
    schemas = json.loads(FILE.read_text(encoding="utf-8"))
    if name not in schemas:
        raise OptionError(argument="schema", expected=f"one of calibration.json, {', '.join(schemas)}", got=name)
    return {"$schema": DIALECT, "title": f"gmwm {name}", **schemas[name]}
