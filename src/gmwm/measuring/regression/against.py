"""Parse the option `against`, which states the conditions for a regression as text or as arrays."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Vector, as_vector
from gmwm.base.errors import OptionError
from gmwm.base.text import duration_text
from gmwm.base.time_base import parse_length
from gmwm.recording.signals import Signal

AUTO, NONE = "auto", "none"
TIME, WARM_UP, TEMPERATURE, OFFSETS = "time", "warmup", "temperature", "offsets"
SEASON, STEP = "season:", "step:"
HOUR_S, YEAR_S = 3600.0, parse_length("1y")
_EXPECTED = "text such as 'temperature:2,lag', 'time:3', 'season:1y' or 'step:2019-03-01', an array, or a mapping"

Against = str | ArrayLike | Signal | Mapping[str, ArrayLike | Signal | None] | None
"""Types that `against` accepts; see `gmwm.fit`."""


@dataclass(frozen=True)
class CovariateTerm:
    """One covariate, with a polynomial of some `degree`, or a natural cubic spline with `knots` inner knots.

    "time" and "warmup" come from sample times; "offsets" gives every part between gaps its own. `lag` adds the rate of
    change, for a delayed sensor. An `exact` one has no error, so all scales are used. `seconds` is the period of
    "season:1y", the time of "step:2019-03-01" (NaN before `within`), or the unit of "time": 1 h or 1 y."""

    name: str
    degree: int = 1
    lag: bool = False
    knots: int = 0
    exact: bool = False
    seconds: float = HOUR_S

    def __str__(self) -> str:
        if self.kind in (SEASON, STEP):
            return self.name
        options = [str(self.degree)] if self.degree > 1 else []
        options += [f"knots={self.knots}"] if self.knots else []
        words = {"lag": self.lag, "exact": self.exact, "yr": self.seconds == YEAR_S}
        options += [word for word, on in words.items() if on]
        return self.name + (":" + ",".join(options) if options else "")

    @property
    def unit(self) -> str:
        """Unit of the covariate; an empty string if it is unknown."""
        return {TEMPERATURE: "°C", TIME: "yr" if self.seconds == YEAR_S else "h"}.get(self.name, "")

    @property
    def kind(self) -> str:
        """The name, or "season:" or "step:" without the period or the time."""
        return self.name[: self.name.find(":") + 1] or self.name

    @property
    def is_measured(self) -> bool:
        """Whether the covariate is measured data, in contrast to a function of time."""
        return self.kind not in (TIME, WARM_UP, OFFSETS, SEASON, STEP)

    @classmethod
    def parse(cls, text: str) -> CovariateTerm:
        """Parse a term; raise OptionError if the text is not a name with known options.

        >>> CovariateTerm.parse("temperature:2,lag")
        CovariateTerm(name='temperature', degree=2, lag=True, knots=0, exact=False, seconds=3600.0)
        """
        most_knots = 10
        # Highest degree of a polynomial: the degree that sensor drivers use for temperature compensation.
        most_degrees = 5
        name, _, options = text.strip().partition(":")
        if f"{name}:" == STEP and re.match(r"\d{4}-", options):
            _unix_time(text)
            return cls(text.strip(), exact=True, seconds=math.nan)
        if f"{name}:" in (SEASON, STEP) and options[:1].isdigit():
            return cls(text.strip(), exact=True, seconds=parse_length(options, f"against={name}"))
        if not re.fullmatch(r"[A-Za-z_]\w*", name) or name in (AUTO, NONE):
            raise OptionError(argument="against", expected=_EXPECTED, got=text)
        degree, knots, words = 1, 0, set()
        for word in filter(None, (part.strip() for part in options.split(","))):
            if word.isdigit() and 1 <= int(word) <= most_degrees:
                degree = int(word)
            elif (match := re.fullmatch(r"knots=(\d+)", word)) and 1 <= int(match[1]) <= most_knots:
                knots = int(match[1])
            elif word in ("lag", "exact") or (word == "yr" and name == TIME):
                words.add(word)
            else:
                raise OptionError(
                    argument="against",
                    expected=f"season:1y, step:2000d, or a degree from 1 to {most_degrees}, knots=1 to {most_knots}, "
                    f"lag or exact after {name!r}",
                    got=word,
                )
        if (name in (WARM_UP, OFFSETS) and options) or (name == TIME and words - {"yr"}) or (knots and degree > 1):
            raise OptionError(
                f"against: {text!r} has options that do not apply", argument="against", got=text,
                advice="Write `warmup` alone, `time` with a degree or knots, and either a degree or knots.",
            )  # fmt: skip
        seconds = YEAR_S if "yr" in words else HOUR_S
        return cls(name, degree=degree, lag="lag" in words, knots=knots, exact="exact" in words, seconds=seconds)

    def within(self, start: float, duration: float, rate: float) -> CovariateTerm:
        """Return the term for a recording (Unix start, s; duration, s; Hz); a season or step must fit in it."""
        if self.name == TIME and duration > YEAR_S:
            return replace(self, seconds=YEAR_S)
        seconds, length = self.seconds, duration_text(duration)
        if math.isnan(seconds):
            seconds = _unix_time(self.name) - start
        if self.kind == SEASON and not 2 / rate < seconds <= duration:
            bound = f"longer than the recording of {length}" if seconds > duration else "no longer than two samples"
            raise OptionError(f"the period of {self.name} is {bound}", argument="against")
        if self.kind == STEP and not 0 < seconds < duration:
            first, last = (np.datetime64(round(time), "s") for time in (start, start + duration))
            raise OptionError(
                f"{self.name} is outside the recording of {length}, from {first} to {last}", argument="against",
                advice="Without dates in the recording, give the time since its first sample, such as step:2000d.",
            )  # fmt: skip
        return replace(self, seconds=seconds)


@dataclass(frozen=True, eq=False)
class Asked:
    """Terms, and arrays that are not in the recording; `automatic`: temperature only if a test finds dependence."""

    terms: tuple[CovariateTerm, ...] = ()
    arrays: Mapping[str, Vector] | None = None
    automatic: bool = False

    def __str__(self) -> str:
        return AUTO if self.automatic else " + ".join(map(str, self.terms)) or NONE

    @classmethod
    def of(cls, against: Against | Asked) -> Asked:
        """Check and convert the option `against`; raise OptionError or DataError if it cannot be interpreted."""
        if isinstance(against, Asked):
            return against
        if against is None:
            return cls()
        if isinstance(against, str):
            text = against.strip()
            if text == AUTO:
                return cls(automatic=True)
            if text == NONE:
                return cls()
            return cls(_distinct(CovariateTerm.parse(part) for part in text.split("+")))
        arrays_by_text = against if isinstance(against, Mapping) else {"covariate": against}
        if not arrays_by_text:
            raise OptionError(argument="against", expected=_EXPECTED, got="an empty mapping")
        arrays, terms = {}, []
        for text, values in arrays_by_text.items():
            term = CovariateTerm.parse(str(text))
            terms.append(term)
            if not term.is_measured:
                if values is None:
                    continue
                raise OptionError(
                    f"against: {term.name} is computed from the clock, and needs no array", argument="against",
                    got=text, advice="Give the array another name, or pass None.",
                )  # fmt: skip
            if values is None:
                raise OptionError(argument="against", expected=f"the samples of {term.name}", got=None)
            arrays[term.name] = values.values if isinstance(values, Signal) else as_vector(values, term.name)
        return cls(_distinct(terms), arrays)


def _distinct(terms: Iterable[CovariateTerm]) -> tuple[CovariateTerm, ...]:
    distinct = tuple(terms)
    names = [term.name for term in distinct]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise OptionError(argument="against", expected="each covariate once", got=twice)
    if TIME in names and WARM_UP in names and next(t for t in distinct if t.name == TIME).degree > 1:
        raise OptionError(
            "against: a curved trend in time and a warm-up describe the same course", argument="against",
            got=" + ".join(map(str, distinct)), advice="Use one of them.",
        )  # fmt: skip
    return distinct


def _unix_time(step: str) -> float:
    """Return the Unix time (s) of a step such as "step:2019-03-01"."""
    try:
        return float(np.datetime64(step.strip().partition(":")[2].removesuffix("Z"), "ms").astype(np.int64)) / 1e3
    except ValueError:
        raise OptionError(argument="against", expected="a date such as step:2019-03-01T12:30", got=step) from None
