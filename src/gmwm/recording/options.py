"""Options for reading recordings, and checks of arguments that several functions share."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Literal

import numpy as np

from gmwm.base.arrays import as_number, as_rate
from gmwm.base.errors import OptionError, UnitError
from gmwm.base.units import AXES, LENGTHS, LONG_TIME_UNITS, POSITIONS, SI_UNIT, TIME_UNITS, find_time_unit, parse_unit
from gmwm.recording.time_ranges import kept_ranges

Gaps = Literal["keep", "longest"]
BadLines = Literal["error", "skip"]
Columns = Mapping[str, str | int | None] | Sequence[str | None]
"""A mapping of axis to column name or index, or a sequence of the axes in the order of the columns."""
ROLES = (*AXES, *POSITIONS, "time", "temperature")  # roles that a column of a file can have
TIME_NAMES = ", ".join((*TIME_UNITS, *LONG_TIME_UNITS))


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """Options for reading a recording. `gmwm.read` describes each of them in detail.

    All values are checked before the file is opened. They are stored in one form: numbers as float, sequences as
    tuples, units of time by their symbols.

    Attributes
    ----------
    rate : float or None
        Sampling rate (Hz); None if the time stamps of the file give it.
    columns : mapping, sequence or None
        Column of each axis by name or index (from 0), or the axes in the order of the columns; None uses the header.
    units : mapping
        Units of "gyro", "accel" and "time" that replace the units that the file states.
    gaps : "keep" or "longest"
        Whether to keep all segments between gaps, or only the longest one.
    bad_lines : "error" or "skip"
        Whether a line of text that cannot be read is an error or a lost sample.
    start, stop : float or None
        First and last time to keep, in seconds from the first sample; None keeps all.
    skip : sequence of (from, to)
        Time ranges to leave out, in seconds from the first sample.
    format : str or None
        Name of the reader; None if the content of the file decides.
    topic : str or None
        Name of the recording in a file that holds several.
    scale : mapping
        Factor by axis or sensor that converts the numbers in the file to the declared unit.
    increments : bool or sequence
        Sensors and axes whose numbers are integrals over one sampling interval; True for both sensors.
    mount : mapping
        Axis of the unit, with its sign, that points along x, y and z of the vehicle.

    Raises
    ------
    OptionError
        If a value is not allowed.
    UnitError
        If a unit is not known.

    Examples
    --------
    >>> ReadOptions(rate=100, increments=True).to_dict()
    {'rate': 100.0, 'increments': ['gyro', 'accel']}
    """

    rate: float | None = None
    columns: Columns | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    gaps: Gaps = "keep"
    bad_lines: BadLines = "error"
    start: float | None = None
    stop: float | None = None
    skip: Sequence[tuple[float, float]] = ()
    format: str | None = None
    topic: str | None = None
    scale: Mapping[str, float] = field(default_factory=dict)
    increments: bool | Sequence[str] = ()
    mount: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        one_of(self.gaps, "gaps", ("keep", "longest"))
        one_of(self.bad_lines, "bad_lines", ("error", "skip"))
        if self.topic is not None and not isinstance(self.topic, str):
            raise OptionError(argument="topic", expected="the name of a recording in the file", got=self.topic)
        kept_ranges(self.start, self.stop, self.skip)
        checked = {
            "rate": None if self.rate is None else as_rate(self.rate),
            "columns": _checked_columns(self.columns),
            "units": _checked_units(self.units),
            "start": None if self.start is None else float(self.start),
            "stop": None if self.stop is None else float(self.stop),
            "skip": tuple((float(begin), float(end)) for begin, end in self.skip),
            "scale": _checked_scale(self.scale),
            "increments": _checked_increments(self.increments),
            "mount": _checked_mount(self.mount),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @property
    def ranges(self) -> list[tuple[float, float]] | None:
        """The time ranges (s) that start, stop and skip keep; None if all three have their defaults."""
        if self.start is None and self.stop is None and not self.skip:
            return None
        return kept_ranges(self.start, self.stop, self.skip)

    @property
    def integrals(self) -> tuple[str, ...]:
        """The sensors and axes whose numbers are integrals over one sampling interval."""
        return _checked_increments(self.increments)

    def to_dict(self) -> dict[str, Any]:
        """Return the values that differ from the defaults, as numbers, strings, lists and mappings."""
        values = {option.name: getattr(self, option.name) for option in fields(self)}
        return {name: _plain(value) for name, value in values.items() if value not in (None, "keep", "error", (), {})}


def one_of(value: object, name: str, allowed: Sequence[str]) -> None:
    """Check that a value is one of the allowed strings."""
    if not isinstance(value, str) or value not in allowed:
        *others, last = map(repr, allowed)
        raise OptionError(argument=name, expected=f"{', '.join(others)} or {last}", got=value)


def as_size(value: float) -> float:
    """Check the significance level of a test: a number between 0 and 1.

    >>> as_size(0.05)
    0.05
    """
    return as_number(value, "size", lambda size: 0 < size < 1, "a probability between 0 and 1, such as 0.05")


def as_confidence(value: object, name: str = "confidence") -> float:
    """Check a confidence level in [0.5, 1): below, intervals more often miss the truth (tests/test_options.py)."""
    is_number = isinstance(value, float | int | np.floating | np.integer) and not isinstance(value, bool)
    is_number = is_number and abs(value) < 1e300  # type: ignore[arg-type]  # an integer may be too large for a float
    number = float(value) if is_number else math.nan  # type: ignore[arg-type]
    if not 0.5 <= number < 1:
        percent = number if 50 <= number < 100 else 95.0
        raise OptionError(
            argument=name, expected="at least 0.5 and less than 1", got=number if is_number else value,
            advice="Write {percent:g} % as {share:g}.", percent=percent, share=percent / 100,
        )  # fmt: skip
    return number


_UNITS = '{"gyro": "deg/s", "accel": "g"}'


def _checked_columns(columns: Columns | None) -> Columns | None:
    if columns is None:
        return None
    if isinstance(columns, str) or not isinstance(columns, Mapping | Sequence):
        raise OptionError(
            argument="columns",
            expected='a mapping such as {"gyro_x": "ch1", "time": 0}, or a list of axes in the order of the columns',
            got=columns,
        )
    roles = list(columns) if isinstance(columns, Mapping) else [role for role in columns if role]
    unknown = next((role for role in roles if role not in ROLES), None)
    if unknown is not None:
        raise OptionError(argument="columns", expected=f"columns for {', '.join(ROLES)}", got=unknown)
    twice = next((role for role in roles if roles.count(role) > 1), None)
    if twice is not None:
        raise OptionError(argument="columns", expected=f"a list that names {twice} once", got=list(columns))
    if not isinstance(columns, Mapping):
        return tuple(columns)
    return {role: int(column) if isinstance(column, np.integer) else column for role, column in columns.items()}


def _checked_units(units: Mapping[str, str]) -> dict[str, str]:
    """Check the keys and values of the units; units of time become symbols."""
    if not isinstance(units, Mapping):
        raise OptionError(argument="units", expected=f"a mapping such as {_UNITS}", got=units)
    checked = dict(units)
    for quantity, text in checked.items():
        if quantity not in (*SI_UNIT, "position", "time"):
            raise OptionError(argument="units", expected="units of gyro, accel, position or time", got=quantity)
        if not isinstance(text, str):
            raise OptionError(argument="units", expected=f"a mapping to texts, such as {_UNITS}", got=text)
        if quantity == "time":
            checked[quantity] = find_time_unit(text)
            if not checked[quantity]:
                raise UnitError(
                    f"{text!r} is not a unit of time", argument="units", got=text, advice="Use one of {known}.",
                    known=TIME_NAMES,
                )  # fmt: skip
        elif quantity == "position" and text not in LENGTHS:
            raise UnitError(f"{text!r} is not one of {', '.join(LENGTHS)}", argument="units", got=text)
        elif quantity != "position":
            parse_unit(text, quantity)  # type: ignore[arg-type]
    return checked


def _checked_scale(scale: Mapping[str, float]) -> dict[str, float]:
    """Check the factors: the keys are axes or sensors, the factors finite numbers other than 0."""
    if not isinstance(scale, Mapping):
        raise OptionError(argument="scale", expected='a mapping such as {"gyro": 1 / 131}', got=scale)
    factors = {}
    for key, value in scale.items():
        if key not in (*AXES, *POSITIONS, *SI_UNIT):
            raise OptionError(argument="scale", expected=f"factors of {', '.join((*SI_UNIT, *AXES))}", got=key)
        try:
            factor = float(value)
        except (TypeError, ValueError, OverflowError):
            factor = math.nan
        if isinstance(value, bool | str) or not math.isfinite(factor) or factor == 0:
            raise OptionError(argument="scale", expected=f"a finite number other than 0 for {key}", got=value)
        factors[key] = factor
    return factors


def _checked_mount(mount: Mapping[str, str]) -> dict[str, str]:
    """Check the mount: x, y and z of the vehicle, and an axis of the unit for each."""
    pairs = mount.items() if isinstance(mount, Mapping) else [("", "")]
    axes = {str(key): str(axis).removeprefix("+") for key, axis in pairs}
    if axes and not sorted(axes) == sorted(axis.removeprefix("-") for axis in axes.values()) == ["x", "y", "z"]:
        expected = "the axis of the unit along each of x, y and z of the vehicle, such as x=-y,y=x,z=z"
        raise OptionError(argument="mount", expected=expected, got=mount)
    return axes


def _checked_increments(increments: bool | Sequence[str]) -> tuple[str, ...]:
    """Check the increments, as names of sensors and axes. True means all sensors."""
    if isinstance(increments, bool):
        return tuple(SI_UNIT) if increments else ()
    if isinstance(increments, str) or not isinstance(increments, Sequence):
        expected = 'True or a list of sensors or axes, such as ["gyro"]'
        raise OptionError(argument="increments", expected=expected, got=increments)
    unknown = next((key for key in increments if key not in (*AXES, *SI_UNIT)), None)
    if unknown is not None:
        raise OptionError(argument="increments", expected=f"a list of {', '.join((*SI_UNIT, *AXES))}", got=unknown)
    return tuple(increments)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return dict(value)
    return [_plain(item) for item in value] if isinstance(value, tuple) else value
