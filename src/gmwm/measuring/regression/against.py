"""Parse the option `against`, which states the conditions for a regression as text or as arrays."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from numpy.typing import ArrayLike

from gmwm.base.arrays import Vector, as_vector
from gmwm.base.errors import OptionError
from gmwm.recording.signals import Signal

AUTO, NONE = "auto", "none"
TIME, WARM_UP, TEMPERATURE, OFFSETS = "time", "warmup", "temperature", "offsets"
_EXPECTED = "text such as 'temperature:2,lag', 'time:3' or 'warmup', an array, or a mapping of names to arrays"
_UNITS = {TEMPERATURE: "°C", TIME: "h"}

Against = str | ArrayLike | Signal | Mapping[str, ArrayLike | Signal | None] | None
"""Types that `against` accepts; see `gmwm.fit`."""


@dataclass(frozen=True)
class CovariateTerm:
    """One covariate of a regression, with the form of its effect: a polynomial of some `degree`, or a natural cubic
    spline with `knots` inner knots. "time" and "warmup" are computed from the times of the samples. With `lag`, the
    rate of change is also a column, for a sensor that follows the covariate with a delay. "offsets" gives every part
    of the recording without a gap an offset of its own. An `exact` covariate is known
    without error at every sample; all scales are then used."""

    name: str
    degree: int = 1
    lag: bool = False
    knots: int = 0
    exact: bool = False

    def __str__(self) -> str:
        options = [str(self.degree)] if self.degree > 1 else []
        options += [f"knots={self.knots}"] if self.knots else []
        options += [word for word, on in (("lag", self.lag), ("exact", self.exact)) if on]
        return self.name + (":" + ",".join(options) if options else "")

    @property
    def unit(self) -> str:
        """Unit of the covariate; an empty string if it is unknown."""
        return _UNITS.get(self.name, "")

    @property
    def is_measured(self) -> bool:
        """Whether the covariate is measured data, in contrast to a function of time."""
        return self.name not in (TIME, WARM_UP, OFFSETS)

    @classmethod
    def parse(cls, text: str) -> CovariateTerm:
        """Parse a term; raise OptionError if the text is not a name with known options.

        >>> CovariateTerm.parse("temperature:2,lag")
        CovariateTerm(name='temperature', degree=2, lag=True, knots=0, exact=False)
        """
        # Largest number of inner knots of a spline.
        most_knots = 10
        # Highest degree of a polynomial: the degree that sensor drivers use for temperature compensation.
        most_degrees = 5
        name, _, options = text.strip().partition(":")
        if not re.fullmatch(r"[A-Za-z_]\w*", name) or name in (AUTO, NONE):
            raise OptionError(argument="against", expected=_EXPECTED, got=text)
        degree, knots, words = 1, 0, set()
        for word in filter(None, (part.strip() for part in options.split(","))):
            if word.isdigit() and 1 <= int(word) <= most_degrees:
                degree = int(word)
            elif (match := re.fullmatch(r"knots=(\d+)", word)) and 1 <= int(match[1]) <= most_knots:
                knots = int(match[1])
            elif word in ("lag", "exact"):
                words.add(word)
            else:
                raise OptionError(
                    argument="against",
                    expected=f"a degree from 1 to {most_degrees}, knots=1 to {most_knots}, lag or exact after {name!r}",
                    got=word,
                )
        if (name in (WARM_UP, OFFSETS) and options) or (name == TIME and words) or (knots and degree > 1):
            raise OptionError(
                f"against: {text!r} has options that do not apply", argument="against", got=text,
                advice="Write `warmup` alone, `time` with a degree or knots, and either a degree or knots.",
            )  # fmt: skip
        return cls(name, degree=degree, lag="lag" in words, knots=knots, exact="exact" in words)


@dataclass(frozen=True, eq=False)
class Asked:
    """A requested regression: its terms, and the arrays of covariates that are not part of the recording. With
    `automatic`, the temperature of the recording is used only if a test finds that the axis depends on it."""

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


def is_given(asked: Asked) -> bool:
    """Return whether a regression or the automatic test of the temperature was requested."""
    return asked.automatic or bool(asked.terms)
