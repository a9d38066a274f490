"""Steps of the search for a model: which families were tried, and why each was entered and left."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from textwrap import wrap
from typing import Literal

from gmwm.base.documents import Documented
from gmwm.base.text import p_relation, round_fixed

Entry = Literal[
    "within",
    "model",
    "slow",
    "lines",
    "shape",
    "filter",
    "nothing-shown",
    "without-absent-lines",
    "oscillation",
    "sensor",
]
Exit = Literal[
    "accepted", "all-rejected", "rejected", "filter-possible", "lines-absent", "model-error", "last", "shared"
]
ENTRY_TEXTS: Mapping[Entry, str] = {
    "within": "largest model of the user",
    "model": "model of the user",
    "slow": "slow processes, with which every search begins",
    "lines": "with the lines of the spectrum",
    "shape": "with the shape of the noise at high frequencies",
    "filter": "with the shape of the noise at high frequencies, because the model before may describe a filter",
    "nothing-shown": "slow processes, because the data show no further term",
    "without-absent-lines": "without the lines whose power is estimated as zero",
    "oscillation": "with a slow oscillation that is fitted to the wavelet variance",
    "sensor": "one form of slow noise for the axes of the sensor",
}
REJECTED = 0.002
"""The search continues if the p-value of the goodness-of-fit test is below this level. A true model has such a p-value
in 2 of 1000 recordings."""
EXIT_TEXTS: Mapping[Exit, str] = {
    "accepted": "{model}{p} is kept: the search goes on only below p = {level}.",
    "all-rejected": "None of its models reaches p = {level}{p}, so they were not compared.",
    "rejected": "{model}{p} does not reach p = {level}.",
    "filter-possible": "{model}{p} fits, but one of its Gauss-Markov terms may be a filter of the sensor.",
    "lines-absent": "In {model}, the power of a line is estimated as zero.",
    "model-error": "{model} fits with a model error of {error:.2g} %{p}, but does not reach p = {level} without it.",
    "last": "{model}{p} does not reach p = {level}, but there is no further family.",
    "shared": "{model}{p} has the form that most axes of the sensor accept, and that does not increase their criteria.",
}


@dataclass(frozen=True, kw_only=True)
class SearchStep(Documented):
    """One step of the search for a model: a family of models, and why it was entered and left.

    Attributes
    ----------
    family : str
        The largest model of the family. All models made of some of its terms belong to the family.
    entered : str
        Why the family was tried: "within" and "model" (given by the user), "slow" (the first family of a search),
        "lines", "shape" or "filter" (terms from the spectrum), "nothing-shown", "without-absent-lines", "oscillation"
        (fitted to the wavelet variance), or "sensor" (the form that the axes of the sensor share).
    bound : float or None
        Upper bound of the p-value of the goodness-of-fit test of any model of the family.
    recommended : str or None
        The recommended model of the family; None if the models were not compared.
    pvalue : float or None
        p-value of the goodness-of-fit test of this model; None if there is no test.
    model_error : float
        Relative model error that is included in the comparison.
    left : str
        Why the search went on or ended: "accepted", "all-rejected", "rejected", "filter-possible", "lines-absent", or
        "model-error" (all rejected, so the result includes a model error), "last" (rejected, but there is no further
        family), or "shared" (the axes of the sensor share the form of the model).
    used : bool
        Whether the result of the search is from this family.
    """

    family: str
    entered: Entry
    bound: float | None = None
    recommended: str | None = None
    pvalue: float | None = None
    model_error: float = 0.0
    left: Exit
    used: bool = False

    def text(self) -> str:
        """Return the step as two or three sentences."""
        pvalue = self.bound if self.recommended is None else self.pvalue
        reason = EXIT_TEXTS[self.left].format(
            model=self.recommended,
            p=" (too few scales for a test)" if pvalue is None else f" (p {p_relation(pvalue)})",
            error=100 * self.model_error,
            level=REJECTED,
        )
        return round_fixed(f"{self.family}: {ENTRY_TEXTS[self.entered]}. {reason}{' Result.' if self.used else ''}")


def search_lines(steps: Iterable[SearchStep], width: int) -> Iterator[str]:
    """Yield the lines of a numbered list of the steps."""
    for number, step in enumerate(steps, start=1):
        yield from wrap(step.text(), width, initial_indent=f"{number}. ", subsequent_indent="   ")
