"""The JSON that commands print: collected from the tests, made into `src/gmwm/cli/schemas.json`, and held against it.

GMWM_JSON_OUTPUTS=build/json pytest tests/cli && python -m tests.json_outputs build/json
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema

from gmwm.base.documents import REMARK
from gmwm.cli.main import SCHEMAS, schema

FOLDER = os.environ.get("GMWM_JSON_OUTPUTS")
NAMES = re.compile(r"[a-z_][a-z0-9_]*")
AXIS = re.compile(r"(gyro|accel)(_[a-z0-9]+)?|imu\d*_.*")
MAPS = {
    "axes", "units", "facts", "topics", "slopes", "noise_against", "accuracy", "needed", "recordings", "growth",
    "knots", "references", "ranges", "terms", "parameters", "confidence_intervals", "failed",
}  # fmt: skip
"""Keys of objects whose keys are names of the user's or of a model."""


def documents_in(printed: str) -> Iterator[Any]:
    """The documents in the output of a command: one, or one a line."""
    try:
        yield json.loads(printed)
    except json.JSONDecodeError:
        yield from map(json.loads, printed.splitlines())


def check(command: str, printed: str) -> None:
    """Hold what a command printed against its schema, or collect it."""
    for document in documents_in(printed):
        # Files of fits and lines of events have no command or another one.
        name = document.get("command", f"{command}-event")
        if FOLDER:
            Path(FOLDER).mkdir(parents=True, exist_ok=True)
            with (Path(FOLDER) / f"{name}.jsonl").open("a", encoding="utf-8") as file:
                file.write(json.dumps(document) + "\n")
        else:
            errors = [f"{error.json_path}: {error.message[:200]}" for error in _validator(name).iter_errors(document)]
            assert errors == [], f"schema of {name}; see tests/json_outputs.py"


@cache
def _validator(name: str) -> jsonschema.Draft202012Validator:
    return jsonschema.Draft202012Validator(schema(name))


@dataclass
class Shape:
    """What was seen at one place of the documents."""

    types: set[str] = field(default_factory=set)
    objects: int = 0
    keys: Counter[str] = field(default_factory=Counter)
    members: dict[str, Shape] = field(default_factory=dict)
    items: Shape | None = None

    def add(self, value: Any) -> None:
        """See a value."""
        if isinstance(value, dict):
            self.objects += 1
            for key, member in value.items():
                self.keys[key] += 1
                self.members.setdefault(key, Shape()).add(member)
        elif isinstance(value, list):
            self.items = self.items or Shape()
            for item in value:
                self.items.add(item)
        else:
            self.types.add(
                {type(None): "null", bool: "boolean", int: "integer", float: "number", str: "string"}[type(value)]
            )

    def join(self, other: Shape) -> Shape:
        """See what the other has seen."""
        self.types |= other.types
        self.objects += other.objects
        self.keys += other.keys
        for key, member in other.members.items():
            self.members.setdefault(key, Shape()).join(member)
        if other.items:
            self.items = (self.items or Shape()).join(other.items)
        return self

    def schema(self, key: str = "") -> dict[str, Any]:
        """The schema that accepts it; a number may be null, which stands for NaN and infinity.

        `key` is "" for a document and for the members of a list or of a map.
        """
        if key == "remarks" and self.items is not None:
            return {"type": "array", "items": REMARK}
        types = set(self.types)
        if "number" in types:
            types = types - {"integer"} | {"null"}
        out: dict[str, Any] = {}
        if self.objects:
            types.add("object")
            if key in MAPS or any(AXIS.fullmatch(name) or not NAMES.fullmatch(name) for name in self.members):
                every = Shape()
                for member in self.members.values():
                    every.join(member)
                out["additionalProperties"] = every.schema()
            else:
                out["properties"] = {name: member.schema(name) for name, member in self.members.items()}
                required = [name for name, count in self.keys.items() if count == self.objects > (key != "")]
                out |= {"required": required} if required else {}
        if self.items is not None:
            types.add("array")
            out["items"] = self.items.schema()
        names = sorted(types) if types != {"null"} else []  # the type of a value that was never there is not known
        return ({"type": names[0] if len(names) == 1 else names} if names else {}) | out


def main(folder: Path) -> None:
    """Write the schemas of all documents in the folder."""
    out = {}
    for path in sorted(folder.glob("*.jsonl")):
        shape = Shape()
        for line in path.read_text(encoding="utf-8").splitlines():
            shape.add(json.loads(line))
        out[path.stem] = shape.schema()
    SCHEMAS.write_text(json.dumps(out, separators=(",", ":")) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
