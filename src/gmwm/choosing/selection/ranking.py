"""Options and results of model selection: models sorted by the criterion, and the steps of a search."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from html import escape
from textwrap import wrap
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np

from gmwm.base.arrays import Matrix, as_whole_number
from gmwm.base.documents import Documented
from gmwm.base.errors import GmwmError, ModelError, OptionError
from gmwm.base.remarks import Dialect, Remark, texts
from gmwm.base.results import Plotted, Tabular
from gmwm.base.text import Summarised, align, counted, p_relation, p_text, round_fixed
from gmwm.choosing.selection.structure import structure_of
from gmwm.fitting.estimation.bootstrap import DRAWS
from gmwm.fitting.estimation.criterion import Criterion
from gmwm.fitting.estimation.result import Fit
from gmwm.recording.options import as_confidence, one_of
from gmwm.theory.processes.model import Model, as_model

if TYPE_CHECKING:
    from polars import DataFrame

    from gmwm.fitting.estimation.intervals import Method


Entry = Literal[
    "within", "model", "slow", "lines", "shape", "filter", "nothing-shown", "without-absent-terms", "oscillation",
    "sensor",
]  # fmt: skip
Exit = Literal[
    "accepted", "all-rejected", "rejected", "filter-possible", "terms-absent", "model-error", "last", "shared"
]
ENTRY_TEXTS: Mapping[Entry, str] = {
    "within": "largest model of the user",
    "model": "model of the user",
    "slow": "slow processes, with which every search begins",
    "lines": "with the lines of the spectrum",
    "shape": "with the shape of the noise at high frequencies",
    "filter": "with the shape of the noise at high frequencies, because the model before may describe a filter",
    "nothing-shown": "slow processes, because the data show no further term",
    "without-absent-terms": "without the terms whose power is estimated as zero",
    "oscillation": "with a slow oscillation that is fitted to the wavelet variance",
    "sensor": "one form of slow noise for the axes of the sensor",
}
SEARCH_PVALUE = 0.002
"""p-value of the test below which the search continues, as in 2 of 1000 recordings of a true model."""
EXIT_TEXTS: Mapping[Exit, str] = {
    "accepted": "{model}{p} is kept: the search goes on only below p = {level}.",
    "all-rejected": "None of its models reaches p = {level}{p}, so they were not compared.",
    "rejected": "{model}{p} does not reach p = {level}.",
    "filter-possible": "{model}{p} fits, but one of its Gauss-Markov terms may be a filter of the sensor.",
    "terms-absent": "In {model}, the power of a term is estimated as zero.",
    "model-error": "{model} fits with a model error of {error:.2g} %{p}, but does not reach p = {level} without it.",
    "last": "{model}{p} does not reach p = {level}, but there is no further family.",
    "shared": "{model}{p} has the form that most axes of the sensor accept, and that does not increase their criteria.",
}


@dataclass(frozen=True, kw_only=True)
class SearchStep(Documented):
    """One step of the search for a model: a `family` (all models of some of its terms), why it was `entered` and
    `left`.

    `entered`: "within", "model" (user), "slow" (first), "lines", "shape", "filter" (spectrum), "nothing-shown",
    "without-absent-terms", "oscillation" (wavelet variance), "sensor" (form shared by axes). `left`: "accepted",
    "all-rejected", "rejected", "filter-possible", "terms-absent", "model-error" (included, as all are rejected),
    "last", "shared". `bound` limits p-values in the family; `pvalue` is that of `recommended`, None without comparison.
    `used`: the result is from here."""

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
            model=self.recommended, p=_in_brackets(pvalue), error=100 * self.model_error, level=SEARCH_PVALUE
        )
        used = " This step gives the model of the axis." if self.used else ""
        return round_fixed(f"{self.family}: {ENTRY_TEXTS[self.entered]}. {reason}{used}")


def _in_brackets(pvalue: float | None) -> str:
    return " (too few scales for a test)" if pvalue is None else f" (p {p_relation(pvalue)})"


def search_lines(steps: Iterable[SearchStep], width: int) -> Iterator[str]:
    """Yield the lines of a numbered list of the steps."""
    for number, step in enumerate(steps, start=1):
        yield from wrap(step.text(), width, initial_indent=f"{number}. ", subsequent_indent="   ")


EQUAL_CRITERIA = 1e-6
"""Two criteria count as equal if their relative difference is below this (tests/selection/test_ranking.py)."""
REMARK_PVALUE = 0.01
"""If the p-value of the goodness-of-fit test of the recommended model is below this level, the ranking has the remark
`model-rejected`. The level is a convention. It is smaller than the usual 5 % because a unit has several axes."""
MOST_CANDIDATES_LISTED = 10
"""Default number of candidates in a table."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Candidate:
    """A candidate model in a ranking, with its fit and its criterion.

    Attributes
    ----------
    model : Model
        The model with its fixed values.
    fit : Fit
        Fit to the recording, or to the mean of several recordings, with the weighting matrix Ω that all candidates
        share.
    wic : Criterion
        Wavelet information criterion.
    out_of_sample : float or None
        Cross-validation loss for several recordings: mean loss for the left-out recording of a fit to the other ones.
        None for a single recording.
    difference : float
        Criterion of this candidate minus the smallest criterion. The criterion is `out_of_sample` for several
        recordings, otherwise `wic`.
    parameters : int
        Number of parameters that the data determine. Parameters that are fixed, zero, or at an end of their domain do
        not count.
    equivalent : bool
        Whether the model is as good as the best one within the uncertainty of the criterion, and contains no smaller
        model that is.
    recommended : bool
        Whether the model is the simplest of the equivalent models. In a calibration, a model whose form the axes of the
        sensor share replaces it; this model also counts as equivalent.
    same_as : str or None
        Structure of the smaller model with the same fit, if some estimates are zero or at an end of their domain;
        otherwise None.
    """

    model: Model
    fit: Fit
    wic: Criterion
    out_of_sample: float | None
    difference: float
    parameters: int
    equivalent: bool
    recommended: bool
    same_as: str | None

    @property
    def structure(self) -> str:
        """The model as text without estimated values, such as "GM + WN"."""
        return str(self.model)

    @property
    def boundary(self) -> tuple[str, ...]:
        """Terms whose estimate is zero or at an end of the domain."""
        diagnostics = self.fit.diagnostics
        here = set(self.model.terms)
        zero = [term for term in self.fit.model.terms if term in diagnostics.not_supported]
        acting = [f"{term} as {name}" for term, name in diagnostics.acts_as.items()]
        missing = sorted(here - set(self.fit.model.terms)) if len(here) > len(self.fit.model.terms) else []
        return tuple(dict.fromkeys([*acting, *zero, *missing]))

    @cached_property
    def pvalue(self) -> float | None:
        """p-value of the goodness-of-fit test of the fit; None if there are too few levels."""
        try:
            return self.fit.goodness_of_fit().pvalue
        except GmwmError:
            return None

    def to_dict(self) -> dict[str, Any]:
        """Return the candidate as numbers, lists and strings for JSON."""
        return {
            "model": self.structure, "wic": self.wic.to_dict(), "out_of_sample": self.out_of_sample,
            "difference": self.difference, "parameters": self.parameters, "boundary": list(self.boundary),
            "equivalent": self.equivalent, "recommended": self.recommended, "same_as": self.same_as,
        }  # fmt: skip

    def __repr__(self) -> str:
        return f"Candidate({self.structure}, WIC {self.wic.value:.6g}, difference {self.difference:.4g})"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Ranking(Plotted, Tabular):
    """Candidate models sorted by the criterion, the best first.

    `ranking[0]` is the best candidate, `ranking["GM + WN"]` is the candidate with this model, and a loop visits all
    candidates.

    Attributes
    ----------
    candidates : tuple of Candidate
        The candidates, sorted by the criterion. A model with the same fit as a smaller model comes after it.
    within : Model
        The general model, which contains all candidates, with its fixed values.
    general : Fit
        Fit of the largest model that the number of levels allows. Its Ω and V are used for all candidates.
    weighting : str
        Kind of the weighting matrix: "optimal" or "diagonal".
    weighting_matrix, wavelet : (J, J) arrays
        Weighting matrix Ω, and covariance V of the measured wavelet variance ν̂².
    confidence : float
        Probability that the true model is among the equivalent models, if it is a candidate.
    """

    candidates: tuple[Candidate, ...]
    within: Model
    general: Fit
    weighting: str
    weighting_matrix: Matrix
    wavelet: Matrix
    confidence: float

    @property
    def best(self) -> Candidate:
        """The candidate with the smallest criterion."""
        return self.candidates[0]

    @property
    def recommended(self) -> Candidate:
        """The recommended candidate, see `Candidate`."""
        return next(candidate for candidate in self.candidates if candidate.recommended)

    @property
    def equivalent(self) -> tuple[Candidate, ...]:
        """The candidates that are as good as the best one, except those that contain a smaller such candidate."""
        return tuple(candidate for candidate in self.candidates if candidate.equivalent)

    @property
    def distinct(self) -> tuple[Candidate, ...]:
        """The candidates except those with the same fit as a smaller candidate."""
        return tuple(candidate for candidate in self.candidates if candidate.same_as is None)

    def label(self, candidate: Candidate) -> str:
        """Return a candidate as text. Fixed values are left out of a long text if no other candidate has the same
        terms."""
        text, short = candidate.structure, candidate.model.structure
        # Longer texts are shown without fixed values, because a filter's coefficients would fill a page.
        return short if len(text) > 60 and self._terms[short] == 1 else text

    @cached_property
    def _terms(self) -> Counter[str]:
        """Number of candidates with the same terms but different fixed values."""
        return Counter(candidate.model.structure for candidate in self.candidates)

    def compare(self, first: int | str | Model, second: int | str | Model) -> Comparison:
        """Compute the difference between the criteria of two candidates, and its standard error.

        Parameters
        ----------
        first, second : int, str or Model
            The candidates, as the place in the ranking (from 0), the text of the model, or the model.

        Returns
        -------
        Comparison
            The criterion of `first` minus the criterion of `second`, and its standard error.
        """
        from gmwm.choosing.selection.equivalence import compare

        return compare(self, self[first], self[second])

    def to_dict(self) -> dict[str, Any]:
        """Return the ranking as numbers, lists and strings for JSON."""
        return {
            "within": str(self.within), "general": self.general.model.structure, "weighting": self.weighting,
            "confidence": self.confidence, "recordings": max(len(self.best.fit.wavelet_variance.recordings), 1),
            "recommended": self.recommended.structure,
            "candidates": [candidate.to_dict() for candidate in self.candidates],
            "remarks": [remark.to_dict() for remark in self.remarks],
        }  # fmt: skip

    def to_polars(self) -> DataFrame:
        """Return the candidates as a Polars data frame with one row for each model, the best first."""
        from polars import DataFrame

        rows = [
            {
                "model": candidate.structure, "wic": candidate.wic.value, "difference": candidate.difference,
                "parameters": candidate.parameters, "p": candidate.pvalue, "equivalent": candidate.equivalent,
                "recommended": candidate.recommended, "same_as": candidate.same_as,
            }
            for candidate in self
        ]  # fmt: skip
        return DataFrame(rows, infer_schema_length=None)

    def table(self, limit: int | None = MOST_CANDIDATES_LISTED) -> tuple[list[str], list[list[str]]]:
        """Return the header and the rows of the table. It contains the first `limit` distinct candidates and all
        equivalent ones."""
        several = self.best.out_of_sample is not None
        head = [
            "", "model", "WIC", "loss", "out of sample" if several else "optimism", "difference", "p",
            "superfluous terms",
        ]  # fmt: skip
        shown = [c for k, c in enumerate(self.distinct) if limit is None or k < limit or c.equivalent]
        rows = []
        for c in shown:
            mark = "*" if c.recommended else "=" if c.equivalent else ""
            part = c.wic.optimism if c.out_of_sample is None else c.out_of_sample
            numbers = map(_short, (c.wic.value, c.wic.loss, part, c.difference))
            p = "-" if c.pvalue is None else p_text(c.pvalue)
            ends = (
                ", ".join(c.boundary).replace(" as ", " like ") if len(c.boundary) < 2 else f"{len(c.boundary)} terms"
            )
            rows.append([mark, round_fixed(self.label(c)).replace(" ", ""), *numbers, p, ends])
        return head, rows

    def difference_text(self, candidate: Candidate) -> str:
        """Format the excess of the criterion of `candidate` over the smallest one, with its standard error."""
        alone = candidate is self.best or candidate.out_of_sample is not None
        error = 0.0 if alone else self.compare(candidate.model, self.best.model).error
        return f"{_short(candidate.difference)}{f' ± {_short(error)}' if error else ''}"

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks on the recommended model, the equivalent models, and the limits of the recommendation."""
        return tuple(self._remarks())

    def _remarks(self) -> Iterator[Remark]:
        axis, chosen = self.best.fit.wavelet_variance.axis, self.recommended
        yield Remark.of("recommended", axis, case="model", model=self.label(chosen))
        if others := tuple(self.label(c) for c in self.equivalent if not c.recommended):
            yield Remark.of("recommended", axis, case="equal", models=others)
        if chosen is not self.best and not self.best.equivalent:
            difference = self.difference_text(chosen)
            yield Remark.of("recommended", axis, case="smallest", model=self.label(self.best), difference=difference)
        if chosen.pvalue is not None and chosen.pvalue < REMARK_PVALUE:
            yield Remark.of("model-rejected", axis, case="ranking", p=chosen.pvalue)
        if reduced := len(self.candidates) - len(self.distinct):
            yield Remark.of("recommended", axis, case="reduced", count=reduced)

    def summary(self, limit: int | None = MOST_CANDIDATES_LISTED) -> str:
        """Write the table of the first `limit` candidates, and the remarks."""
        wv = self.best.fit.wavelet_variance
        lines = [
            f"{counted(len(self), 'model')}{' of ' + wv.axis if wv.axis else ''} within {self.within}",
            f"{wv.extent}, {wv.levels_text}, weighting {self.weighting}",
            "",
        ]
        head, rows = self.table(limit)
        lines += align([head, *rows], right=range(2, len(head) - 1), indent="")
        if more := len(self.distinct) - len(rows):
            lines.append(f"… and {more} more")
        lines += ["* recommended, = equivalent to the best model", ""]
        remarks = texts(remark.about("") for remark in self.remarks)
        return "\n".join([*lines, *(part for text in remarks for part in wrap(text, 80, subsequent_indent="  "))])

    def _repr_html_(self) -> str:
        head, rows = self.table()
        cells = "".join(f"<th>{escape(text)}</th>" for text in head)
        body = "".join(f"<tr>{''.join(f'<td>{escape(text)}</td>' for text in row)}</tr>" for row in rows)
        remarks = "<br>".join(texts((remark.about("") for remark in self.remarks), Dialect.HTML))
        return f"<table><thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table><p>{remarks}</p>"

    @overload
    def __getitem__(self, key: int | str | Model) -> Candidate: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[Candidate, ...]: ...
    def __getitem__(self, key: int | str | Model | slice) -> Candidate | tuple[Candidate, ...]:
        if isinstance(key, (int, np.integer, slice)):
            return self.candidates[key]
        structure = structure_of(as_model(key))
        for candidate in self.candidates:
            if structure_of(candidate.model) == structure:
                return candidate
        raise OptionError(
            f"{as_model(key)} is not among the {counted(len(self), 'candidate')} within {self.within}",
            advice="To compare it with them, pass all models to `gmwm.rank`.",
        )

    def __contains__(self, key: object) -> bool:
        if isinstance(key, Candidate):
            return any(candidate is key for candidate in self.candidates)
        try:
            return isinstance(key, str | Model) and isinstance(self[key], Candidate)
        except (OptionError, ModelError):
            return False

    def __iter__(self) -> Iterator[Candidate]:
        return iter(self.candidates)

    def __len__(self) -> int:
        return len(self.candidates)

    def __repr__(self) -> str:
        return f"Ranking({counted(len(self), 'model')}, {self.recommended.structure} recommended)"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Comparison(Summarised, Plotted):
    """Comparison of two candidates of a ranking.

    Attributes
    ----------
    first, second : Candidate
        The candidates.
    difference : float
        Criterion (WIC) of the first candidate minus the criterion of the second; negative if the first is better. With
        several recordings, the criterion of the fit to their mean wavelet variance is used.
    error : float
        Standard error of the difference, computed from the covariance V of the measured wavelet variance.
    """

    first: Candidate
    second: Candidate
    difference: float
    error: float

    @property
    def remark(self) -> Remark:
        """Remark that states which model has the smaller criterion, and whether the difference may be due to chance."""
        better, worse = (self.first, self.second) if self.difference <= 0 else (self.second, self.first)
        size = abs(self.difference)
        if size <= EQUAL_CRITERIA * abs(self.first.wic.value):
            return Remark.of("criteria-differ", case="equal", first=self.first.structure, second=self.second.structure)
        return Remark.of(
            "criteria-differ", case="differ", better=better.structure, worse=worse.structure, least=better.wic.value,
            other=worse.wic.value, difference=size, error=self.error, clear="yes" if size > 2 * self.error else "no",
        )  # fmt: skip

    def summary(self) -> str:
        """Return the comparison as text."""
        return self.remark.text()

    def __repr__(self) -> str:
        return f"Comparison({self.first.structure} − {self.second.structure}: {self.difference:.4g} ± {self.error:.2g})"


def _short(number: float) -> str:
    """Format a number with two decimals, or with five digits if it is 1000 or larger."""
    return f"{number:.2f}" if abs(number) < 1000 else f"{number:.5g}"


Weights = Literal["optimal", "diagonal"]
SLOW = "4*GM + WN + QN + FN + RW + DR"
"""General model whose submodels a search ranks first (docs/validation/selection.md)."""


@dataclass(frozen=True, kw_only=True)
class RankingOptions:
    """Options of a ranking of models, whose values are checked. `gmwm.select` describes each option."""

    weighting: Weights = "optimal"
    criterion: Method = "asymptotic"
    confidence: float = 0.95
    draws: int = DRAWS
    seed: int = 0

    def __post_init__(self) -> None:
        one_of(self.weighting, "weighting", ("optimal", "diagonal"))
        one_of(self.criterion, "criterion", ("asymptotic", "bootstrap"))
        as_confidence(self.confidence)
        as_whole_number(self.draws, "draws", 100)
        as_whole_number(self.seed, "seed", 0)
