"""Dependence of the variance of a term on a known condition, as a sum of known functions such as "1 + rate**2"."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import ModelError, OptionError

_EXPECTED = "a sum of 1, rate, rate**2, abs(rate) or hats(0, 25, 50), with one name for the condition"
_POWER = re.compile(r"([A-Za-z_]\w*)(?:(?:\*\*|\^)([1-9]))?")
_ABSOLUTE = re.compile(r"abs\(([A-Za-z_]\w*)\)")
_HATS = re.compile(r"hats\(([^()]*)\)")


@dataclass(frozen=True)
class Function:
    """Known function of the condition, with its text."""

    text: str
    of: Callable[[Vector], Vector]


@dataclass(frozen=True)
class Varies:
    """Functions φ_m of the condition c (`condition`, "" if none names it) in the variance Σ_m s_m φ_m(c) of a term."""

    condition: str
    functions: tuple[Function, ...]

    @classmethod
    def parse(cls, text: str) -> Varies:
        """Parse the text of a sum such as "1 + rate**2". Raises OptionError if the text is not a sum of known
        functions.

        >>> [one.text for one in Varies.parse("1 + rate^2").functions]
        ['1', 'rate^2']
        """
        functions: list[Function] = []
        names: set[str] = set()
        for part in re.split(r"\+(?![^(]*\))", str(text)):
            word = part.strip()
            if word == "1":
                functions.append(Function("1", np.ones_like))
            elif match := _HATS.fullmatch(word):
                functions += _hats(match[1], text)
            elif match := _ABSOLUTE.fullmatch(word):
                names.add(match[1])
                functions.append(Function(word, np.abs))
            elif (match := _POWER.fullmatch(word)) and match[1] != "hats":
                names.add(match[1])
                power = int(match[2] or 1)
                functions.append(Function(f"{match[1]}^{power}" if power > 1 else match[1], _power(power)))
            else:
                raise OptionError(argument="varies", expected=_EXPECTED, got=text)
        texts = [function.text for function in functions]
        if len(names) > 1 or len(set(texts)) < len(texts):
            raise OptionError(argument="varies", expected=_EXPECTED, got=text)
        return cls(next(iter(names), ""), tuple(functions))

    def at(self, conditions: Vector, term: str) -> Matrix:
        """Return the values φ_m(c_s) (m, s) of the functions at conditions; raises ModelError if one is negative, or if
        the conditions cannot separate them."""
        rows = np.array([function.of(conditions) for function in self.functions])
        for function, row in zip(self.functions, rows, strict=True):
            if np.any(row < 0):
                raise ModelError(
                    f"{term} varies with {function.text}, which is negative at {conditions[np.argmin(row)]:g}",
                    advice="Use an even power, abs(…) or hats(…), so that variances cannot be negative.",
                )
        scale = np.max(rows, axis=1, keepdims=True)
        if np.linalg.matrix_rank(rows / np.where(scale > 0, scale, 1.0), tol=1e-6) < len(rows):
            raise ModelError(
                f"{len(rows)} functions of {term} cannot be separated at the conditions "
                f"{', '.join(f'{c:g}' for c in conditions)}",
                advice="Use more conditions, or fewer functions.",
            )
        return rows


def parse_varies(varies: Mapping[str, str]) -> tuple[dict[str, Varies], str]:
    """Parse the functions of each term, and find the name of the condition; raises OptionError if two names differ."""
    if not isinstance(varies, Mapping):
        raise OptionError(argument="varies", expected="a mapping such as {'WN': '1 + rate**2'}", got=varies)
    sums = {term: Varies.parse(text) for term, text in varies.items()}
    names = {single.condition for single in sums.values() if single.condition}
    if len(names) > 1:
        raise OptionError(argument="varies", expected="one name for the condition", got=", ".join(sorted(names)))
    return sums, next(iter(names), "condition")


def _power(power: int) -> Callable[[Vector], Vector]:
    return lambda c: np.asarray(c**power)


def _hats(inside: str, text: str) -> list[Function]:
    """Return one piecewise linear function for each number in hats(…): 1 there, 0 at the others, constant outside."""
    try:
        places = np.array([float(word) for word in inside.split(",")])
    except ValueError:
        places = np.empty(0)
    if places.size < 2 or not np.all(np.isfinite(places)) or np.any(np.diff(places) <= 0):
        raise OptionError(argument="varies", expected="hats(…) with two or more ascending numbers", got=text)
    return [Function(f"hat at {place:g}", _hat(places, k)) for k, place in enumerate(places)]


def _hat(places: Vector, k: int) -> Callable[[Vector], Vector]:
    return lambda c: np.asarray(np.interp(c, places, np.eye(places.size)[k]))
