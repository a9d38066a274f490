"""Read the numbers of a datasheet, written as text: "gyro: N=0.15deg/√h, B=3deg/h over 100s; accel: N=60µg/√Hz"."""

from __future__ import annotations

import re

from gmwm.base.axis_names import AXES
from gmwm.base.durations import parse_length
from gmwm.base.errors import OptionError
from gmwm.base.units import SI_UNIT, Quantity, noise_unit
from gmwm.files.importers.quantities import as_reference
from gmwm.files.importers.values import Values
from gmwm.theory.processes.model import Model

POWERS = {"Q": 1.0, "N": 0.5, "B": 0.0, "sigma": 0.0, "K": -0.5, "R": -1.0}
"""Symbols of the numbers in a datasheet. The unit of each number is the unit of the signal times this power of the
second."""
_NAMES = {"σ": "sigma", "σ_GM": "sigma", "T": "T_c", "τ": "T_c", **{name: name for name in (*POWERS, "T_c")}}
EXAMPLE = "gyro: N=0.15deg/√h, B=3deg/h over 100s; accel: N=60µg/√Hz, K=1e-4m/s²/√s"
_IS_NUMBER = re.compile(r"[\wσ]+\s*=")
_PART = re.compile(
    r"\s*([\wσ]+)\s*=\s*([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*"
    r"([^\s,;]*(?:\s*/\s*[^\s,;]+)*)(?:\s+over\s+([^,;]+))?\s*"
)


def read_datasheet(text: str) -> dict[str, Values | Model]:
    """Parse text with the noise numbers, or the noise model, of each axis.

    Parameters
    ----------
    text : str
        Parts "SENSOR: SYMBOL=VALUE UNIT, …" with ";" between them. The sensor is gyro, accel or an axis. A symbol is N,
        K, B, sigma, Q, R or T_c. "over 100s" after B or sigma is the correlation time of a Gauss-Markov process. A part
        can also be a model with values.

    Raises
    ------
    OptionError
        If the text has another form.
    UnitError
        If a unit does not fit its symbol.

    Examples
    --------
    >>> read_datasheet("gyro_x: N=60 deg/√h")["gyro_x"].N == read_datasheet("gyro_x: N=1 deg/s/√Hz")["gyro_x"].N
    True
    """
    axes: dict[str, Values | Model] = {}
    for part in (part for part in text.split(";") if part.strip()):
        place, colon, body = (piece.strip() for piece in part.partition(":"))
        if not colon or place not in (*SI_UNIT, *AXES):
            expected = f"text such as '{EXAMPLE}', with gyro, accel or an axis before each colon"
            raise OptionError(argument="source", expected=expected, got=part.strip())
        quantity: Quantity = "gyro" if place.startswith("gyro") else "accel"
        values: Values | Model = _values(body, place, quantity) if _IS_NUMBER.match(body) else Model.parse(body)
        for axis in AXES:
            if axis == place or axis.rpartition("_")[0] == place:
                if axis in axes:
                    raise OptionError(argument="source", expected=f"{axis} once", got=text)
                axes[axis] = values
    if not axes:
        raise OptionError(argument="source", expected=f"text such as '{EXAMPLE}'", got=text)
    return axes


def _values(body: str, place: str, quantity: Quantity) -> Values:
    numbers: dict[str, float] = {}
    for part in body.split(","):
        match = _PART.fullmatch(part)
        name = _NAMES.get(match[1]) if match else None
        if match is None or name is None:
            expected = f"numbers such as N=0.15deg/√h, of {', '.join(dict.fromkeys(_NAMES.values()))}"
            raise OptionError(argument="source", expected=expected, got=part.strip())
        if name == "T_c":
            pairs = {"time": parse_length(match[2] + match[3], "source")}
        else:
            si = noise_unit(POWERS[name], SI_UNIT[quantity])[0]
            pairs = {name: as_reference(f"{place}.{name}", (float(match[2]), match[3]), si, argument="source").si}
        if match[4] is not None:
            if name not in ("B", "sigma"):
                raise OptionError(argument="source", expected="a correlation time after B or sigma only", got=part)
            pairs["time"] = parse_length(match[4].strip(), "source")
        for key, value in pairs.items():
            if key in numbers:
                raise OptionError(argument="source", expected=f"{key} once for {place}", got=body)
            numbers[key] = value
    if "time" in numbers and not numbers.keys() & {"B", "sigma"}:
        raise OptionError(argument="source", expected="B or sigma beside a correlation time", got=body)
    if "sigma" in numbers and "time" not in numbers:
        raise OptionError(argument="source", expected="a correlation time, as in sigma=5deg/h over 100s", got=body)
    if {"B", "sigma"} <= numbers.keys():
        raise OptionError(argument="source", expected="B or sigma, not both", got=body)
    return Values(**numbers)
