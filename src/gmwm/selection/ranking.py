"""Models in the order of their criterion, what the data cannot tell apart, and the one to use."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from html import escape
from textwrap import wrap
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from gmwm._arrays import Matrix
from gmwm._tables import aligned
from gmwm._text import Summarised, counted
from gmwm.errors import GmwmError, ModelError, OptionError
from gmwm.estimation.result import Fit
from gmwm.inference.criterion import Criterion
from gmwm.processes.model import Model, as_model
from gmwm.selection.structure import structure_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure

    from gmwm.plots.view import UnitSystem, ViewName

WIDTH = 80
SAME = 1e-6
"""Criteria that differ by less (relative) are those of one curve."""
REJECTED = 0.01
"""p of the fit below which a recommendation does not go without a word."""
LISTED = 10
"""So many candidates a table shows."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Candidate:
    """A model in a ranking.

    Attributes
    ----------
    model : Model
        Its structure, as it was asked for.
    fits : tuple of Fit
        To each recording, under the Ω that all candidates have in common.
    wic : Criterion
        Its criterion; of several recordings the mean.
    out_of_sample : float or None
        Of several recordings, the mean loss of a fit to one on another.
    difference : float
        By how much its criterion exceeds the least: `out_of_sample` where there is one, else `wic`.
    parameters : int
        Parameters that the data determine: neither held, nor zero, nor at an end of their domain.
    equivalent : bool
        Whether it is as good as the best within the uncertainty of the criterion, and none of its terms can be spared.
    recommended : bool
        Whether it is the simplest of those.
    same_as : str or None
        The smaller model that it comes down to, as the data show no more of its terms.
    """

    model: Model
    fits: tuple[Fit, ...]
    wic: Criterion
    out_of_sample: float | None
    difference: float
    parameters: int
    equivalent: bool
    recommended: bool
    same_as: str | None

    @property
    def structure(self) -> str:
        """The model as text, with values only where they are held: "GM + WN"."""
        return str(self.model)

    @property
    def fit(self) -> Fit:
        """The fit to the recording, or to the first of several."""
        return self.fits[0]

    @property
    def boundary(self) -> tuple[str, ...]:
        """Terms that are zero or at an end of their domain."""
        diagnostics = self.fit.diagnostics
        here = set(self.model.terms)
        zero = [term for term in self.fit.model.terms if term in diagnostics.not_supported]
        acting = [f"{term} as {name}" for term, name in diagnostics.acts_as.items()]
        missing = sorted(here - set(self.fit.model.terms)) if len(here) > len(self.fit.model.terms) else []
        return tuple(dict.fromkeys([*acting, *zero, *missing]))

    @cached_property
    def pvalue(self) -> float | None:
        """p of the goodness of fit to the first recording; None where it cannot be tested."""
        try:
            return self.fit.goodness_of_fit().pvalue
        except GmwmError:
            return None

    def to_dict(self) -> dict[str, Any]:
        """The candidate as plain numbers, lists and texts, ready for JSON."""
        return {
            "model": self.structure,
            "wic": self.wic.to_dict(),
            "out_of_sample": self.out_of_sample,
            "difference": self.difference,
            "parameters": self.parameters,
            "boundary": list(self.boundary),
            "equivalent": self.equivalent,
            "recommended": self.recommended,
            "same_as": self.same_as,
        }

    def __repr__(self) -> str:
        return f"Candidate({self.structure}, WIC {self.wic.value:.6g}, difference {self.difference:.4g})"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Ranking:
    """Candidates, the best first; `ranking[0]`, `ranking["GM + WN"]`, or in a loop.

    Attributes
    ----------
    candidates : tuple of Candidate
        By the criterion; models that come down to a smaller one follow it.
    within : Model
        The general model, as it was asked for.
    general : Fit
        The largest candidate that the levels allow, whose Ω and V all candidates have.
    weighting : str
        Which Ω: "optimal" or "diagonal".
    weighting_matrix, wavelet : (J, J) arrays
        Ω, and V, the covariance of ν̂²; of the first recording.
    confidence : float
        Share of cases in which the right model is among the equivalent ones.
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
        """The candidate with the least criterion."""
        return self.candidates[0]

    @property
    def recommended(self) -> Candidate:
        """The simplest of the candidates that are as good as the best."""
        return next(candidate for candidate in self.candidates if candidate.recommended)

    @property
    def equivalent(self) -> tuple[Candidate, ...]:
        """The candidates that are as good as the best, and of which no term can be spared."""
        return tuple(candidate for candidate in self.candidates if candidate.equivalent)

    @property
    def distinct(self) -> tuple[Candidate, ...]:
        """The candidates without those that come down to a smaller one."""
        return tuple(candidate for candidate in self.candidates if candidate.same_as is None)

    def compare(self, first: int | str | Model, second: int | str | Model) -> Comparison:
        """Candidates `first` and `second` side by side: the difference of their criteria, and its standard error."""
        from gmwm.selection.comparison import compared

        return compared(self, self[first], self[second])

    def to_dict(self) -> dict[str, Any]:
        """The ranking as plain numbers, lists and texts, ready for JSON."""
        return {
            "within": str(self.within),
            "general": self.general.model.structure,
            "weighting": self.weighting,
            "confidence": self.confidence,
            "recordings": len(self.best.fits),
            "recommended": self.recommended.structure,
            "candidates": [candidate.to_dict() for candidate in self.candidates],
        }

    def table(self, limit: int | None = LISTED) -> tuple[list[str], list[list[str]]]:
        """Head and rows of the table: the first `limit` distinct candidates, and every equivalent one."""
        several = self.best.out_of_sample is not None
        head = ["", "model", "WIC", "loss", "out of sample" if several else "optimism", "difference", "p", "at an end"]
        shown = [c for k, c in enumerate(self.distinct) if limit is None or k < limit or c.equivalent]
        rows = []
        for c in shown:
            mark = "*" if c.recommended else "=" if c.equivalent else ""
            part = c.wic.optimism if c.out_of_sample is None else c.out_of_sample
            numbers = map(_short, (c.wic.value, c.wic.loss, part, c.difference))
            p = "-" if c.pvalue is None else f"{c.pvalue:.3f}" if c.pvalue >= 0.001 else "< 0.001"
            ends = ", ".join(c.boundary) if len(c.boundary) < 2 else f"{len(c.boundary)} terms"
            rows.append([mark, c.structure.replace(" ", ""), *numbers, p, ends])
        return head, rows

    def words(self) -> list[str]:
        """What the ranking comes down to."""
        chosen, others = self.recommended, [c.structure for c in self.equivalent if not c.recommended]
        lines = [f"* recommended: {chosen.structure}"]
        if others:
            lines.append(f"= as good within the criterion's uncertainty: {'; '.join(others)}")
        if chosen is not self.best:
            more = [c for c in (self.best,) if not c.equivalent]
            lines += [f"least criterion: {c.structure}, but the data do not call for so much" for c in more]
        if chosen.pvalue is not None and chosen.pvalue < REJECTED:
            lines.append(
                "the test of the fit rejects even the recommended model: a larger general model may do better, or the "
                "data hold what no such sum describes (look at the picture)"
            )
        same = len(self.candidates) - len(self.distinct)
        if same:
            come = f"{same} more candidates come" if same > 1 else "1 more candidate comes"
            lines.append(f"{come} down to one of these: the data show no more of their terms")
        return lines

    def summary(self, limit: int | None = LISTED) -> str:
        """The table of the first `limit` candidates, and the recommendation in words."""
        wv = self.best.fit.wavelet_variance
        records = f"{len(self.best.fits)} recordings, the first of " if len(self.best.fits) > 1 else ""
        lines = [
            f"{counted(len(self), 'model')}{' of ' + wv.axis if wv.axis else ''} within {self.within}",
            f"{records}{wv.extent}, {len(wv)} levels, weighting {self.weighting}",
            "",
        ]
        head, rows = self.table(limit)
        lines += aligned([head, *rows], right=range(2, len(head) - 1), indent="")
        left = len(self.distinct) - len(rows)
        if left:
            lines.append(f"… and {left} more")
        words = [part for line in self.words() for part in wrap(line, WIDTH, subsequent_indent="  ")]
        return "\n".join([*lines, "", *words])

    def _repr_html_(self) -> str:
        head, rows = self.table()
        cells = "".join(f"<th>{escape(text)}</th>" for text in head)
        body = "".join(f"<tr>{''.join(f'<td>{escape(text)}</td>' for text in row)}</tr>" for row in rows)
        words = "<br>".join(escape(line) for line in self.words())
        return f"<table><thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table><p>{words}</p>"

    @overload
    def __getitem__(self, key: int | str | Model) -> Candidate: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[Candidate, ...]: ...
    def __getitem__(self, key: int | str | Model | slice) -> Candidate | tuple[Candidate, ...]:
        if isinstance(key, (int, np.integer, slice)):
            return self.candidates[key]
        wanted = structure_of(as_model(key))
        for candidate in self.candidates:
            if structure_of(candidate.model) == wanted:
                return candidate
        raise OptionError(
            f"{as_model(key)} is not among the {len(self)} candidates within {self.within}; "
            "rank it beside them: rank([…], data)"
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

    def plot(
        self,
        *,
        limit: int = 4,
        view: ViewName = "wavelet",
        units: UnitSystem = "si",
        path: str | os.PathLike[str] | None = None,
    ) -> MatplotlibFigure:
        """Draw the best models over the data, their distances from the data, and the criteria.

        Curves often look the same. Their distances from the data, scaled so that the confidence limits are at −1 and 1,
        show how they differ. Of several recordings, the curves are those of the first.

        Parameters
        ----------
        limit : int
            Number of the best distinct candidates to draw; the recommended one is always drawn.
        view : "wavelet" or "allan"
            Wavelet variance ν² over the scale τ (s), or Allan deviation √(2ν²) over the averaging time τ/2 (s).
        units : "si" or "datasheet"
            rad/s and m/s², or deg/h and mg.
        path : path, optional
            File to write the picture to, ending in .png, .pdf or .svg.

        Returns
        -------
        matplotlib.figure.Figure
            A figure that is not registered with pyplot, so it need not be closed. Notebooks display it.

        Raises
        ------
        OptionError
            If an option is unknown, or the data do not support it.

        Examples
        --------
        >>> from gmwm import QN, RW, WN, select
        >>> x = (WN(sigma2=4.0) + RW(gamma2=1e-3)).simulate(20_000, 100.0, rng=1)
        >>> figure = select(WN() + QN() + RW(), x, rate=100.0).plot()
        >>> figure.axes[2].get_xlabel()
        'WIC above the best'
        """
        from gmwm.plots.ranking import plot_ranking

        return plot_ranking(self, limit=limit, view=view, units=units, path=path)

    def __repr__(self) -> str:
        return f"Ranking({counted(len(self), 'model')}, {self.recommended.structure} recommended)"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Comparison(Summarised):
    """Two candidates beside one another.

    Attributes
    ----------
    first, second : Candidate
    difference : float
        Criterion of the first less that of the second: negative where the first is better. The criterion is the WIC,
        of several recordings the mean.
    error : float
        Standard error of the difference, from the scatter V of ν̂².
    """

    first: Candidate
    second: Candidate
    difference: float
    error: float

    def summary(self) -> str:
        """The comparison in words."""
        better, worse = (self.first, self.second) if self.difference <= 0 else (self.second, self.first)
        size = abs(self.difference)
        if size <= SAME * abs(self.first.wic.value):
            return f"{self.first.structure} and {self.second.structure} have the same criterion"
        clear = "by more than chance" if size > 2 * self.error else "no more than chance may do"
        return (
            f"{better.structure} has the smaller criterion: {better.wic.value:.2f} against {worse.wic.value:.2f} of "
            f"{worse.structure}, a difference of {size:.2f} ± {self.error:.2f}, {clear}"
        )

    def plot(
        self, *, view: ViewName = "wavelet", units: UnitSystem = "si", path: str | os.PathLike[str] | None = None
    ) -> MatplotlibFigure:
        """Draw the two candidates over the data, and their distances from the data.

        The title gives the difference of their criteria. Of several recordings, the curves are those of the first.

        Parameters
        ----------
        view : "wavelet" or "allan"
            Wavelet variance ν² over the scale τ (s), or Allan deviation √(2ν²) over the averaging time τ/2 (s).
        units : "si" or "datasheet"
            rad/s and m/s², or deg/h and mg.
        path : path, optional
            File to write the picture to, ending in .png, .pdf or .svg.

        Returns
        -------
        matplotlib.figure.Figure
            A figure that is not registered with pyplot, so it need not be closed. Notebooks display it.

        Raises
        ------
        OptionError
            If an option is unknown, or the data do not support it.
        """
        from gmwm.plots.ranking import plot_candidates

        return plot_candidates(self, view=view, units=units, path=path)

    def __repr__(self) -> str:
        return f"Comparison({self.first.structure} − {self.second.structure}: {self.difference:.4g} ± {self.error:.2g})"


def _short(number: float) -> str:
    """Two decimals, or five digits of what is large."""
    return f"{number:.2f}" if abs(number) < 1000 else f"{number:.5g}"
