"""Dependence of a term on a condition: of its variance, as "1 + rate**2", or its shape, as β = exp(a + b rate)."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.base.errors import ModelError, OptionError
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.parameter import fixed

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

    def means(self, conditions: NDArray[np.float64], term: str) -> NDArray[np.float64]:
        """Return means (m, S, …) of φ_m over the conditions' last axis; ModelError if negative or inseparable."""
        values = np.array([function.of(conditions) for function in self.functions])
        for function, row in zip(self.functions, values, strict=True):
            if np.any(row < 0):
                raise ModelError(
                    f"{term} varies with {function.text}, which is negative at {conditions[row < 0][0]:g}",
                    advice="Use an even power, abs(…) or hats(…), so that variances cannot be negative.",
                )
        places = np.mean(conditions.reshape(len(conditions), -1), axis=1)
        rows = np.mean(values.reshape(len(values), len(places), -1), axis=2)
        scale = np.max(rows, axis=1, keepdims=True)
        if np.linalg.matrix_rank(rows / np.where(scale > 0, scale, 1.0), tol=1e-6) < len(rows):
            raise ModelError(
                f"{len(rows)} functions of {term} cannot be separated at the conditions "
                f"{', '.join(f'{place:g}' for place in places)}",
                advice="Use more conditions, or fewer functions.",
            )
        return np.asarray(np.mean(values, axis=-1))


@dataclass(frozen=True)
class Link:
    """Shape parameter that follows the condition c: exp(a + b c) if positive, tanh(a + b c) from −1 to 1."""

    name: str
    condition: str

    def at(self, process: Process, z: float) -> Process:
        """Return a process with the parameter held at z = a + b c."""
        return process.with_values(**{self.name: fixed(float(self.values(process, np.array([z]))[0]))})

    def values(self, process: Process, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values of the parameter at z = a + b c."""
        return next(p for p in process.parameters if p.name == self.name).at_coordinate(z)

    def limits(self, process: Process, samples: int, rate: float) -> tuple[float, float]:
        """Return the ends of the search of a: correlation times from two samples to the recording."""
        if next(p for p in process.parameters if p.name == self.name).domain == "between":
            return -4.0, float(np.arctanh(1 - 1 / samples))
        return float(np.log(rate / samples)), float(np.log(rate / 2))


def parse_varies(varies: Mapping[str, str]) -> tuple[dict[str, Varies], dict[str, Link], str]:
    """Parse functions of variances ("WN") and links of shapes ("GM.beta") by term, and the condition's name."""
    if not isinstance(varies, Mapping):
        raise OptionError(argument="varies", expected="a mapping such as {'WN': '1 + rate**2'}", got=varies)
    sums: dict[str, Varies] = {}
    links: dict[str, Link] = {}
    for key, text in varies.items():
        term, dot, name = str(key).partition(".")
        if not dot:
            sums[key] = Varies.parse(text)
            continue
        match = _POWER.fullmatch(str(text).strip())
        if match is None or match[2]:
            raise OptionError(argument="varies", expected=f"the name of the condition for {key}", got=text)
        links[term] = Link(name, match[1])
    named = [*(each.condition for each in sums.values()), *(each.condition for each in links.values())]
    names = {name for name in named if name}
    if len(names) > 1:
        raise OptionError(argument="varies", expected="one name for the condition", got=", ".join(sorted(names)))
    return sums, links, next(iter(names), "condition")


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
