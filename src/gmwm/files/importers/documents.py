"""Parse the files of other programs to keys and values: YAML, also with OpenCV's first line, MATLAB code, and parameter
lists."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gmwm.base.errors import ReadError, UnitError
from gmwm.base.text import counted
from gmwm.base.units import find_unit
from gmwm.files.importers.quantities import as_reference

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_QUANTITY = re.compile(rf"({NUMBER})\s*([^\d\s.,eE+-].*)")


@dataclass(frozen=True)
class KeyLine:
    """A key with its value: the keys above it, the line, and the text of the value or of each value of a list."""

    key: str
    above: tuple[str, ...]
    line: int
    cells: tuple[str, ...]


@dataclass(frozen=True)
class ParameterFile:
    """The entries of a file."""

    entries: tuple[KeyLine, ...]

    def has(self, key: str) -> bool:
        """Return whether the file has a key."""
        return any(_names(entry, key) or key in entry.above for entry in self.entries)

    def find(self, key: str) -> KeyLine | None:
        """Return the entry with a key; None if there is none. A key that occurs twice is an error."""
        entries = [entry for entry in self.entries if _names(entry, key)]
        if len(entries) < 2:
            return entries[0] if entries else None
        lines = " and ".join(str(entry.line) for entry in entries[:2])
        owners = list(dict.fromkeys(entry.above[0] for entry in entries if entry.above))
        choice = f", and choose one of {', '.join(owners)}: FILE:{owners[0]}" if len(owners) > 1 else ""
        raise ReadError(
            f"{key} occurs {counted(len(entries), 'time')} in the file, for example in lines {lines}",
            advice=f"Pass a file with the numbers of one IMU{choice}.",
        )

    def numbers(self, key: str, unit: str = "") -> list[float] | None:
        """Return the number of a key, or one for each axis; None if the key is not there. If `unit` is the SI unit of
        the number, the file may state another unit of the same kind."""
        entry = self.find(key)
        if entry is not None and not entry.cells:
            raise ReadError(f"line {entry.line}: {key} has no number")
        return None if entry is None else [_number(cell, entry, unit) for cell in entry.cells]

    def part(self, name: str) -> ParameterFile:
        """Return the entries below a key, such as imu1."""
        entries = tuple(entry for entry in self.entries if name in entry.above)
        if not entries:
            owners = dict.fromkeys(entry.above[0] for entry in self.entries if entry.above)
            raise ReadError(f"the file has no part {name!r}; its parts: {', '.join(owners) or 'none'}")
        return ParameterFile(entries)


def parse(text: str, path: Path) -> ParameterFile:
    """Parse a file. A file that is neither MATLAB code nor YAML is a list of parameters, one key and value a line."""
    if calls := tuple(_of_matlab(text)):
        return ParameterFile(calls)
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    # The bounds that gmwm writes for PX4 and ArduPilot are comments, so that loading the file changes nothing.
    if re.match(r"# Noise of an IMU for [^\n]*, lower bounds\. Written by gmwm", text):
        text = re.sub(rf"(?m)^# (?=[\d\s]*EK(?:F2|3)_\w+[\s,]+{NUMBER})", "", text)
    body = re.sub(r"\A%YAML:[^\n]*\n(?:---[^\n]*)?", lambda head: "\n" * head[0].count("\n"), text)  # OpenCV's head
    try:
        root = YAML(typ="safe", pure=True).compose(body)
    except (YAMLError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        if path.suffix.lower() in (".yaml", ".yml"):
            where = f"line {mark.line + 1}: " if mark is not None else ""
            raise ReadError(f"{where}not valid YAML: {getattr(error, 'problem', None) or error}") from error
        root = None
    entries = tuple(_of_node(root, (), set())) if root is not None and root.id == "mapping" else ()
    return ParameterFile(entries or tuple(_of_lines(text)))


def _of_node(node: Any, above: tuple[str, ...], visited: set[int]) -> Iterator[KeyLine]:
    """Yield the entries of a mapping of YAML and of the mappings in it. Refuse a node that an alias repeats, because a
    few lines of aliases can stand for more entries than a computer can hold."""
    if id(node) in visited:
        raise ReadError(f"line {node.start_mark.line + 1}: a YAML alias repeats this part", advice="Write it out.")
    visited.add(id(node))
    if node.id == "sequence":
        for item in node.value:
            yield from _of_node(item, above, visited)
    if node.id != "mapping":
        return
    for key, value in node.value:
        name = str(key.value)
        if value.id == "scalar":
            yield KeyLine(name, above, key.start_mark.line + 1, (str(value.value),))
        elif value.id == "sequence" and all(item.id == "scalar" for item in value.value):
            yield KeyLine(name, above, key.start_mark.line + 1, tuple(str(item.value) for item in value.value))
        else:
            yield from _of_node(value, (*above, name), visited)


def _of_lines(text: str) -> Iterator[KeyLine]:
    """Yield the entries of lines such as "1 1 EKF2_GYR_NOISE 0.015 9", "param set X 0.1", "X,0.1" or "x = 0.1"."""
    for line, content in enumerate(text.splitlines(), 1):
        words = re.split(r"[\s,:=]+", re.sub(r"(?<!\S)#.*", "", content).strip())
        at = next((k for k in range(len(words) - 2, -1, -1) if re.fullmatch(r"[A-Za-z]\w*(?:\.\w+)*", words[k])), None)
        if at is not None:
            cells = words[at + 1 :]
            # QGroundControl writes the number of the type behind the value.
            yield KeyLine(
                words[at], (), line, (cells[0] if len(cells) == 1 or cells[1].isdecimal() else " ".join(cells),)
            )


_MATLAB_TOKEN = re.compile(
    r"(?ms)^[ \t]*%\{[ \t]*$.*?(?:^[ \t]*%\}[ \t]*$|\Z)|[%#][^\n]*|\.\.\.[^\n]*|\s+|"
    r"""(?P<text>(?<![\w\])}'])'(?:[^'\n]|'')*'|"[^"\n]*")|"""
    r"(?P<name>[A-Za-z][\w.]*)|(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\w*)|(?P<sign>.)"
)
"""Comments and blanks, which have no group, and the words of MATLAB code."""
_SENSORS = ("gyroparams", "accelparams")
_NOISE = {name.lower(): name for name in ("NoiseDensity", "RandomWalk", "BiasInstability", "NoiseType")}


def _of_matlab(text: str) -> Iterator[KeyLine]:
    """Yield the named arguments of the calls of gyroparams and accelparams in MATLAB code."""
    if not re.search(r"\b(?:gyro|accel)params\b", text):
        return
    words = [
        (match[0], text.count("\n", 0, match.start()) + 1) for match in _MATLAB_TOKEN.finditer(text) if match.lastgroup
    ]
    at = 0
    while at < len(words):
        (word, line), after = words[at], words[at + 1][0] if at + 1 < len(words) else ""
        at += 1
        if word in _SENSORS and after == "(":
            arguments, at = _arguments(words, at + 1, f"line {line}: {word}")
            yield from _named(arguments, word)
        elif after == "=" and word.rpartition(".")[2].lower() in _NOISE:
            raise ReadError(
                f"line {line}: {word} is set outside gyroparams and accelparams", advice="Write it into the call."
            )


def _arguments(words: list[tuple[str, int]], at: int, where: str) -> tuple[list[list[tuple[str, int]]], int]:
    """Return the words of each argument of a call whose first word is at an index, and the index behind the call."""
    arguments: list[list[tuple[str, int]]] = [[]]
    depth = 0
    for k in range(at, len(words)):
        word = words[k][0]
        depth += (word in "([{") - (word in ")]}")
        if depth < 0:
            return [argument for argument in arguments if argument], k + 1
        if word == "," and depth == 0:
            arguments.append([])
        else:
            arguments[-1].append(words[k])
    raise ReadError(f"{where} has no closing parenthesis")


def _named(arguments: list[list[tuple[str, int]]], call: str) -> Iterator[KeyLine]:
    """Yield the names and values of arguments: 'Name', value or Name=value."""
    values = iter(arguments)
    for first in values:
        (name, line), *value = first
        if value[:1] == [("=", line)]:
            value = value[1:]
        elif name[0] in "'\"" and not value:
            value = next(values, [])
        else:
            value = []
        cells = [word.strip("'\"") for word, _ in value]
        if (
            cells[:1] == ["["]
            and cells[-1:] == ["]"]
            and all(re.fullmatch(NUMBER, cell) or cell == "," for cell in cells[1:-1])
        ):
            row = tuple(cell for cell in cells if re.fullmatch(NUMBER, cell))
        else:
            row = (" ".join(cells),)
        plain = name.strip("'\"")
        yield KeyLine(_NOISE.get(plain.lower(), plain), (call,), line, row)


def _names(entry: KeyLine, key: str) -> bool:
    """Return whether an entry has a key, which may have dots or be below another key: IMU.NoiseGyro."""
    return entry.key == key or ("." in key and ".".join((*entry.above, entry.key)).endswith(key))


def _number(cell: str, entry: KeyLine, unit: str) -> float:
    """Return the number of a cell, which may state a unit of the same kind as `unit`."""
    text, where = cell.strip(), f"line {entry.line}: the value of {entry.key}"
    quantity = _QUANTITY.fullmatch(text)
    if quantity is not None and unit and float(quantity[1]) > 0:
        try:
            return as_reference(entry.key, (float(quantity[1]), quantity[2].strip()), unit).si
        except UnitError as error:
            raise ReadError(f"{where} has the unit {quantity[2]!r}, expected {error.expected}") from error
    if quantity is not None and find_unit(quantity[2]) is not None:
        raise ReadError(f"{where} has a unit: {text!r}", advice="Write a plain number in the unit of the program.")
    if not re.fullmatch(NUMBER, text):
        raise ReadError(f"{where} is not a number: {text!r}", advice="Write a plain number.")
    if not 0 <= float(text) < math.inf:
        raise ReadError(f"{where} must be finite, and 0 or larger: {text}")
    return float(text)


def each_axis(row: Sequence[float], key: str) -> list[float]:
    """Return one number for each axis, from one or three."""
    if len(row) not in (1, 3):
        raise ReadError(f"{key} has {len(row)} numbers, but one, or one for each of three axes, are expected")
    return [*row] * 3 if len(row) == 1 else [*row]
