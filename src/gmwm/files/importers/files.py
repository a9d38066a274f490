"""Read the noise numbers in other programs' files, converted by their rules: YAML, MATLAB code, parameter lists.

Only recognised keys are read, so that a whole configuration can be passed."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gmwm.base.errors import ReadError, UnitError
from gmwm.base.text import counted
from gmwm.base.units import SI_UNIT, Quantity, find_unit, noise_unit
from gmwm.files.importers.values import FLOOR, Values, as_reference

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
        """Return a key's number, or one per axis, or None; with an SI `unit`, the file may state another."""
        entry = self.find(key)
        if entry is not None and not entry.cells:
            raise ReadError(f"line {entry.line}: {key} has no number")
        return None if entry is None else [_number(cell, entry, unit) for cell in entry.cells]

    def rate(self) -> float | None:
        """Return the sampling rate (Hz) in the file; None if there is none."""
        rates = map(self.numbers, ("update_rate", "rate_hz", "IMU.Frequency", "for an IMU at"))
        return next((numbers[0] for numbers in rates if numbers), None)

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
        text = re.sub(rf"(?m)^# ([\d\s]*EK(?:F2|3)_\w+[\s,]+{NUMBER}.*?)(?:  upper limit)?$", r"\1", text)
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
    rates = re.findall(rf"(?m)^\s*# (for an IMU at) ({NUMBER}) Hz$", text)  # which gmwm writes for VINS and FAST-LIO
    return ParameterFile((*(entries or _of_lines(text)), *(KeyLine(key, (), 0, (rate,)) for key, rate in rates)))


def _of_node(node: Any, above: tuple[str, ...], visited: set[int]) -> Iterator[KeyLine]:
    """Yield a YAML mapping's entries, nested; refuse repeated aliases, which can expand beyond memory."""
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


_DEGREE = math.pi / 180
Found = dict[str, Values]
Reader = Callable[[ParameterFile, float | None], Found]
_QUANTITIES: tuple[Quantity, ...] = ("gyro", "accel")


@dataclass(frozen=True)
class Format:
    """A format of files with noise numbers."""

    name: str  # name of the program
    keys: tuple[str, ...]  # keys by which a file is recognised: every file has at least one of them
    # Returns each axis's values from the text and the rate (Hz), or None if neither file nor user states it
    read: Reader
    names: Mapping[Quantity, Mapping[str, str]]  # the key in the file for each number of `Values`
    needs_rate: bool = False  # whether the numbers depend on the sampling rate
    one: bool = True  # whether a file has each key once
    density: bool = False  # whether the numbers are N and K in SI units. They may then be written with another unit

    def matches(self, document: ParameterFile) -> bool:
        """Return whether a file has a key of the format."""
        return any(document.has(key) for key in self.keys)

    def written(self, document: ParameterFile, axis: str) -> dict[str, tuple[str, float | None]]:
        """Return key and value of each number of an axis; None for values of repeated keys."""
        quantity: Quantity = "gyro" if axis.startswith("gyro") else "accel"
        entries: dict[str, tuple[str, float | None]] = {}
        for symbol, key in self.names.get(quantity, {}).items():
            values = document.numbers(key, _unit(self.density, symbol, quantity)) if self.one else None
            value = None if not values else values["xyz".index(axis[-1])] if len(values) == 3 else values[0]
            entries[symbol] = (key, value)
        return entries


def _require_numbers(document: ParameterFile, key: str, unit: str = "") -> list[float]:
    """Return the numbers of a key that every file has."""
    numbers = document.numbers(key, unit)
    if numbers is None:
        raise ReadError(f"the file has no number for {key}", advice="Add it, or write the numbers as text.")
    return numbers


def _unit(density: bool, symbol: str, quantity: Quantity) -> str:
    """Return the SI unit of N or K if the numbers of the file are densities, which may be written with a unit."""
    power = {"N": 0.5, "K": -0.5}.get(symbol)
    return noise_unit(power, SI_UNIT[quantity])[0] if density and power else ""


def _two(keys: Mapping[Quantity, tuple[str, str]], change: Callable[[float, float | None], float]) -> Reader:
    """Return a function that reads N and K of each sensor, or of each axis from lists of three. `change` converts a
    number in the file, given the sampling rate, to a density."""

    def read(document: ParameterFile, rate: float | None) -> Found:
        axes: Found = {}
        for sensor, pair in keys.items():
            if all(document.find(key) is None for key in pair):
                continue
            white = _white(document, pair[0], _unit(change is _density, "N", sensor))
            walk = _three(document, pair[1], _unit(change is _density, "K", sensor))
            for k, letter in enumerate("xyz"):
                axes[f"{sensor}_{letter}"] = Values(N=change(white[k], rate), K=change(walk[k], rate))
        return axes

    return read


def _density(value: float, rate: float | None) -> float:
    return value


def _per_step(value: float, rate: float | None) -> float:
    """Convert σ of one step to a density N = σ/√f: a step of Δt = 1/f adds (Δt σ)², and noise N² Δt."""
    assert rate is not None
    return value / math.sqrt(rate)


def _for_step(step: float) -> Callable[[float, float | None], float]:
    """Return the conversion for a filter with a fixed step Δt (s), which adds (Δt p)² in each step, so N = p √Δt."""
    return lambda value, rate: value * math.sqrt(step)


def _imu_utils(document: ParameterFile, rate: float | None) -> Found:
    """Read a file of imu_utils: gyr_n is √f times the Allan deviation at 1 s, and gyr_w is its minimum."""
    axes: Found = {}
    for sensor, short in (("gyro", "gyr"), ("accel", "acc")):
        for letter in "xyz":
            axis = f"{letter}-axis"
            entries = tuple(entry for entry in document.entries if axis in entry.above)
            white, floor = (ParameterFile(entries).numbers(f"{short}_{symbol}") for symbol in "nw")
            if white and floor:
                axes[f"{sensor}_{letter}"] = Values(N=_per_step(white[0], rate), B=floor[0] / FLOOR)
    if not axes:
        raise ReadError("the file has no numbers of the axes x, y and z", advice="Use the file that imu_utils wrote.")
    return axes


def _kf_gins(document: ParameterFile, rate: float | None) -> Found:
    """Read a file of KF-GINS, in deg/√h, m/s/√h, deg/h, mGal and h. The bias is a Gauss-Markov process."""
    time = 3600.0 * _require_numbers(document, "corrtime")[0]
    sizes = {"arw": _DEGREE / 60, "vrw": 1 / 60, "gbstd": _DEGREE / 3600, "abstd": 1e-5}
    axes: Found = {}
    values = {key: _three(document, key) for key in sizes}
    for sensor, white, bias in (("gyro", "arw", "gbstd"), ("accel", "vrw", "abstd")):
        for k, letter in enumerate("xyz"):
            axes[f"{sensor}_{letter}"] = Values(
                N=values[white][k] * sizes[white], sigma=values[bias][k] * sizes[bias], time=time
            )
    return axes


def _three(document: ParameterFile, key: str, unit: str = "") -> list[float]:
    return each_axis(_require_numbers(document, key, unit), key)


def _white(document: ParameterFile, key: str, unit: str = "") -> list[float]:
    """Return the white noise of three axes, which is larger than zero."""
    white = _three(document, key, unit)
    if 0 in white:
        entry = document.find(key)
        raise ReadError(
            f"line {entry.line if entry else 0}: {key} is 0, but every sensor has white noise",
            advice="Write the number, or remove the keys of this sensor.",
        )
    return white


def _matlab(document: ParameterFile, rate: float | None) -> Found:
    """Read MATLAB code that sets the parameters of imuSensor. With the default NoiseType, N and B are smaller than the
    numbers in the code by the factor √2, and K is larger by this factor. K and B are 0 by default."""
    axes: Found = {}
    for sensor in _QUANTITIES:
        call = ParameterFile(tuple(entry for entry in document.entries if f"{sensor}params" in entry.above))
        if not any(call.find(key) for key in ("NoiseDensity", "RandomWalk", "BiasInstability")):
            continue
        kind = call.find("NoiseType")
        if kind is not None and kind.cells not in (("single-sided",), ("double-sided",)):
            raise ReadError(f"line {kind.line}: NoiseType must be single-sided or double-sided")
        factor = 1.0 if kind is not None and kind.cells == ("single-sided",) else math.sqrt(2)
        white = _white(call, "NoiseDensity")
        walk, flicker = (each_axis(call.numbers(key) or [0.0], key) for key in ("RandomWalk", "BiasInstability"))
        for k, letter in enumerate("xyz"):
            axes[f"{sensor}_{letter}"] = Values(N=white[k] / factor, K=walk[k] * factor, B=flicker[k] / factor)
    return axes


def _format(
    name: str, keys: tuple[str, str, str, str], change: Callable[[float, float | None], float],
    *, needs_rate: bool = False,
) -> Format:  # fmt: skip
    """Return a format with keys for N and K of gyroscopes, and for N and K of accelerometers."""
    gyro_n, gyro_k, accel_n, accel_k = keys
    pairs: dict[Quantity, tuple[str, str]] = {"gyro": (gyro_n, gyro_k), "accel": (accel_n, accel_k)}
    names: dict[Quantity, dict[str, str]] = {q: {"N": white, "K": walk} for q, (white, walk) in pairs.items()}
    return Format(
        name, (gyro_n, accel_n), _two(pairs, change), names=names, needs_rate=needs_rate, density=change is _density,
    )  # fmt: skip


_KALIBR = ("gyroscope_noise_density", "gyroscope_random_walk", "accelerometer_noise_density",
           "accelerometer_random_walk")  # fmt: skip
FORMATS = (
    Format("imu_utils", ("avg-axis",), _imu_utils, needs_rate=True,
           names={"gyro": {"N": "gyr_n", "B": "gyr_w"}, "accel": {"N": "acc_n", "B": "acc_w"}}, one=False),
    _format("Kalibr, allan_variance_ros, OpenVINS or Kimera", _KALIBR, _density),
    _format("ORB-SLAM3", ("IMU.NoiseGyro", "IMU.GyroWalk", "IMU.NoiseAcc", "IMU.AccWalk"), _density),
    _format("VINS", ("gyr_n", "gyr_w", "acc_n", "acc_w"), _per_step, needs_rate=True),
    _format("LIO-SAM", ("imuGyrNoise", "imuGyrBiasN", "imuAccNoise", "imuAccBiasN"), _density),
    _format("FAST-LIO", ("gyr_cov", "b_gyr_cov", "acc_cov", "b_acc_cov"),
            lambda value, rate: _per_step(math.sqrt(value), rate), needs_rate=True),
    Format("KF-GINS", ("arw",), _kf_gins,
           names={"gyro": {"N": "arw", "sigma": "gbstd"}, "accel": {"N": "vrw", "sigma": "abstd"}}),
    _format("PX4", ("EKF2_GYR_NOISE", "EKF2_GYR_B_NOISE", "EKF2_ACC_NOISE", "EKF2_ACC_B_NOISE"), _for_step(0.010)),
    _format("ArduPilot", ("EK3_GYRO_P_NSE", "EK3_GBIAS_P_NSE", "EK3_ACC_P_NSE", "EK3_ABIAS_P_NSE"),
            _for_step(0.012)),
    Format("MATLAB imuSensor", ("NoiseDensity",), _matlab, one=False,
           names={q: {"N": "NoiseDensity", "K": "RandomWalk", "B": "BiasInstability"} for q in _QUANTITIES}),
)  # fmt: skip
"""The formats, in the order in which they are tried."""
