"""Options of a recording, and the rules for values that several functions take: checked before any work begins."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Literal

import numpy as np

from gmwm._arrays import as_rate
from gmwm.errors import OptionError, UnitError
from gmwm.signals import AXES
from gmwm.time_ranges import kept_ranges
from gmwm.units import LONG_TIME_UNITS, SI_UNIT, TIME_UNITS, find_time_unit, parse_unit

Gaps = Literal["keep", "longest"]
Columns = Mapping[str, str | int | None] | Sequence[str | None]
"""Axis to column name or index, or the axes in the order of the columns."""
ROLES = (*AXES, "time", "temperature")
"""What a column can be."""
TIME_NAMES = ", ".join((*TIME_UNITS, *LONG_TIME_UNITS))


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """Options for reading a recording; `gmwm.read` describes each.

    Every value is checked here, before the file is opened, and kept in one form: numbers as float, sequences as tuples,
    units of time in short.

    Raises
    ------
    OptionError, UnitError
        If a value is not one of those it may be.

    Examples
    --------
    >>> ReadOptions(rate=100, increments=True).to_dict()
    {'rate': 100.0, 'increments': ['gyro', 'accel']}
    """

    rate: float | None = None
    columns: Columns | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    gaps: Gaps = "keep"
    start: float | None = None
    stop: float | None = None
    skip: Sequence[tuple[float, float]] = ()
    format: str | None = None
    topic: str | None = None
    scale: Mapping[str, float] = field(default_factory=dict)
    increments: bool | Sequence[str] = ()

    def __post_init__(self) -> None:
        one_of(self.gaps, "gaps", ("keep", "longest"))
        if self.topic is not None and not isinstance(self.topic, str):
            raise OptionError(f"topic must be the name of a recording in the file, got {self.topic!r}")
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
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @property
    def stretches(self) -> list[tuple[float, float]] | None:
        """The stretches of time (s) that start, stop and skip keep; None if all three have their defaults."""
        if self.start is None and self.stop is None and not self.skip:
            return None
        return kept_ranges(self.start, self.stop, self.skip)

    @property
    def integrals(self) -> tuple[str, ...]:
        """The sensors and axes whose numbers are integrals over a sample."""
        return _checked_increments(self.increments)

    def to_dict(self) -> dict[str, Any]:
        """The values that are not the defaults, as plain numbers, texts, lists and mappings."""
        given = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: _plain(value) for name, value in given.items() if value not in (None, "keep", (), {})}


# --- rules that several functions share -----------------------------------------------------------------


def one_of(value: object, name: str, allowed: Sequence[str]) -> None:
    """Raise an OptionError if `value` is none of the `allowed` texts."""
    if not isinstance(value, str) or value not in allowed:
        *others, last = map(repr, allowed)
        raise OptionError(f"{name} must be {', '.join(others)} or {last}, got {value!r}")


def as_confidence(value: object, name: str = "confidence") -> float:
    """A confidence level: a number from 0.5 to below 1, the same for intervals, limits and the choice of models.

    Below 0.5 an interval more often misses the true value than it contains it.

    >>> as_confidence(0.95)
    0.95
    """
    known = isinstance(value, float | int | np.floating | np.integer) and not isinstance(value, bool)
    number = float(value) if known else math.nan  # type: ignore[arg-type]
    if not 0.5 <= number < 1:
        hint = f"{number:g} % is {number / 100:g}" if 50 <= number < 100 else "95 % is 0.95"
        came = repr(value) if math.isnan(number) else f"{number:g}"
        raise OptionError(f"{name} must be at least 0.5 and less than 1, got {came}; {hint}")
    return number


def as_whole_number(value: int, name: str, least: int) -> int:
    """A whole number of at least `least`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise OptionError(f"{name} must be a whole number of at least {least}, got {value!r}")
    return int(value)


# --- the fields of ReadOptions --------------------------------------------------------------------------


def _checked_columns(columns: Columns | None) -> Columns | None:
    if columns is None:
        return None
    if isinstance(columns, str) or not isinstance(columns, Mapping | Sequence):
        raise OptionError(
            'columns= must map axes to columns, as {"gyro_x": "ch1", "time": 0}, or be a list of axes in the order '
            f"of the columns; got {columns!r}"
        )
    roles = list(columns) if isinstance(columns, Mapping) else [role for role in columns if role]
    unknown = next((role for role in roles if role not in ROLES), None)
    if unknown is not None:
        raise OptionError(f"columns= must name {', '.join(ROLES)}; got {unknown!r}")
    twice = next((role for role in roles if roles.count(role) > 1), None)
    if twice is not None:
        raise OptionError(f"columns= names {twice!r} twice")
    if not isinstance(columns, Mapping):
        return tuple(columns)
    return {role: int(column) if isinstance(column, np.integer) else column for role, column in columns.items()}


def _checked_units(units: Mapping[str, str]) -> dict[str, str]:
    """The units with each key and value known, units of time in short."""
    if not isinstance(units, Mapping):
        raise OptionError(f'units must map sensors to units, as {{"gyro": "deg/s", "accel": "g"}}; got {units!r}')
    given = dict(units)
    for quantity, text in given.items():
        if quantity not in (*SI_UNIT, "time"):
            raise OptionError(f"units must name gyro, accel or time; got {quantity!r}")
        if not isinstance(text, str):
            raise OptionError(f'the unit of {quantity} must be a text, as "deg/s"; got {text!r}')
        if quantity == "time":
            given[quantity] = find_time_unit(text)
            if not given[quantity]:
                raise UnitError(f"the time unit must be one of {TIME_NAMES}; got {text!r}")
        else:
            parse_unit(text, quantity)  # type: ignore[arg-type]
    return given


def _checked_scale(scale: Mapping[str, float]) -> dict[str, float]:
    """The factors with each key an axis or a sensor, and each factor a finite number other than 0."""
    if not isinstance(scale, Mapping):
        raise OptionError(f'scale must map axes or sensors to factors, as {{"gyro": 1 / 131}}; got {scale!r}')
    factors = {}
    for key, value in scale.items():
        if key not in (*AXES, *SI_UNIT):
            raise OptionError(f"scale must name {', '.join((*SI_UNIT, *AXES))}; got {key!r}")
        try:
            factor = float(value)
        except (TypeError, ValueError):
            factor = math.nan
        if isinstance(value, bool | str) or not math.isfinite(factor) or factor == 0:
            raise OptionError(f"the scale of {key} must be a finite number other than 0, as 1 / 131; got {value!r}")
        factors[key] = factor
    return factors


def _checked_increments(increments: bool | Sequence[str]) -> tuple[str, ...]:
    """The increments as names of sensors and axes; all sensors for True."""
    if isinstance(increments, bool):
        return tuple(SI_UNIT) if increments else ()
    if isinstance(increments, str) or not isinstance(increments, Sequence):
        raise OptionError(f'increments must be True or a list of sensors or axes, as ["gyro"]; got {increments!r}')
    unknown = next((key for key in increments if key not in (*AXES, *SI_UNIT)), None)
    if unknown is not None:
        raise OptionError(f"increments must name {', '.join((*SI_UNIT, *AXES))}; got {unknown!r}")
    return tuple(increments)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return dict(value)
    return [_plain(item) for item in value] if isinstance(value, tuple) else value
