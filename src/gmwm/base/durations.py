"""Parse durations and shares in the values of options."""

from __future__ import annotations

import math
import re

from gmwm.base.errors import OptionError

_UNITS = {
    "ms": 1e-3, "s": 1.0, "sec": 1.0, "second": 1.0, "m": 60.0, "min": 60.0, "minute": 60.0,
    "h": 3600.0, "hr": 3600.0, "hour": 3600.0, "d": 86400.0, "day": 86400.0,
}  # fmt: skip
_SECONDS = _UNITS | {f"{unit}s": seconds for unit, seconds in _UNITS.items() if len(unit) > 2 or unit == "hr"}
_NUMBER = r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:e[+-]?[0-9]+)?"
_TERM = re.compile(rf"\s*({_NUMBER})\s*([a-z]+)", re.IGNORECASE)
_PLAIN = re.compile(rf"\s*({_NUMBER})\s*(%?)\s*", re.IGNORECASE)


def parse_length(text: str, argument: str = "duration") -> float:
    """Parse a duration (s): a number with a unit, a sum of these, or a number of seconds. `argument` is for errors.

    >>> parse_length("90"), parse_length("30min"), parse_length("2 hours"), parse_length("1h30m"), parse_length("1.5d")
    (90.0, 1800.0, 7200.0, 5400.0, 129600.0)
    >>> parse_length("100ms")
    0.1
    """
    plain = _PLAIN.fullmatch(text)
    terms, remainder = _TERM.findall(f"{plain[1]}s" if plain and not plain[2] else text), _TERM.sub("", text)
    terms = [] if remainder.strip() and not plain else terms
    length = float(sum(float(number) * _SECONDS.get(unit.lower(), math.inf) for number, unit in terms))
    if not terms or not math.isfinite(length):
        raise OptionError(argument=argument, expected="a duration such as 90s, 30min, 1h30m, 2h or 1d", got=text)
    return length


def parse_share(text: str) -> float:
    """Parse a share, as a number or a percentage.

    >>> parse_share("0.1"), parse_share("10%"), parse_share("2.5 %")
    (0.1, 0.1, 0.025)
    """
    match = _PLAIN.fullmatch(text)
    if match is None:
        raise OptionError(argument="accuracy", expected="a share such as 0.1 or 10%", got=text)
    return float(match[1]) / (100.0 if match[2] else 1.0)
