"""One form of slow noise for the axes of a sensor, if they accept it and their criteria together do not increase."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gmwm.base.units import by_sensor
from gmwm.choosing.selection.api import EXCLUDED_PVALUE
from gmwm.choosing.selection.ranking import Candidate, Ranking, SearchStep
from gmwm.choosing.selection.search import ModelChoice
from gmwm.choosing.selection.structure import slow_terms
from gmwm.fitting.estimation.goodness import usable_levels
from gmwm.fitting.estimation.result import Fit

SPARE = 1.0
"""Largest increase of the criterion with which an axis accepts a model. A parameter that the axis does not need costs 2
in the mean, so few axes get one (tests/selection/test_shared_form.py)."""
ONE_TERM = 2
"""Additional parameters of an axis, those of one GM term (tests/selection/test_shared_form.py)."""
GROSS = 5.0
"""Ratio to measured variances that a new model exceeds only if the old does (tests/selection/test_shared_form.py)."""


def with_shared_form(choices: Mapping[str, ModelChoice]) -> dict[str, ModelChoice]:
    """Return all choices, with one form of model for most axes of each sensor, of fewest parameters.

    An axis accepts a model within `SPARE` of its criterion, with at most one more term, that the test does not reject
    and, for walks or flicker, is not stationary. The form must suit most axes, not increase their joint criterion, and
    leave fewer forms."""
    shared = dict(choices)
    for sensor, of_sensor in by_sensor(choices).items():
        if sensor:
            for axis, candidate in _shared({axis: choice.ranking for axis, choice in of_sensor.items()}).items():
                shared[axis] = _with_recommended(choices[axis], candidate)
    return shared


def _shared(rankings: Mapping[str, Ranking]) -> dict[str, Candidate]:
    """Return the candidates with the shared form, for the axes that recommend another form."""
    recommended = {axis: ranking.recommended for axis, ranking in rankings.items()}
    forms = {axis: slow_terms(candidate.model) for axis, candidate in recommended.items()}
    if len(set(forms.values())) == 1:
        return {}
    accepted = {axis: _accepted(ranking) for axis, ranking in rankings.items()}
    orders = []
    for form in dict.fromkeys(form for candidates in accepted.values() for form in candidates):
        group = {axis: candidates[form] for axis, candidates in accepted.items() if form in candidates}
        increase = sum(candidate.difference - recommended[axis].difference for axis, candidate in group.items())
        different = len({form, *(forms[axis] for axis in rankings if axis not in group)})
        if 2 * len(group) > len(rankings) and increase <= 0 and different < len(set(forms.values())):
            orders.append((different, sum(candidate.parameters for candidate in group.values()), increase, form, group))
    for *_, group in sorted(orders, key=lambda order: order[:4]):
        changed = {axis: candidate for axis, candidate in group.items() if candidate is not recommended[axis]}
        if not any(_is_worse(candidate, recommended[axis]) for axis, candidate in changed.items()):
            return changed
    return {}


def _accepted(ranking: Ranking) -> dict[tuple[str, ...], Candidate]:
    """Return the best candidate of each form that an axis accepts, before the test of its fit."""
    recommended = ranking.recommended
    accepted = {slow_terms(recommended.model): recommended}
    for candidate in ranking.distinct:
        more = candidate.parameters - recommended.parameters
        # A slow Gauss-Markov term instead of a random walk would make K a limit.
        walks = _is_stationary(recommended) or not _is_stationary(candidate)
        if candidate.difference <= recommended.difference + SPARE and more <= ONE_TERM and walks:
            accepted.setdefault(slow_terms(candidate.model), candidate)
    return accepted


def _is_stationary(candidate: Candidate) -> bool:
    """Return whether a candidate has no random walk, flicker noise or drift."""
    return all(process.stationary for process in candidate.model.processes)


def _is_worse(candidate: Candidate, recommended: Candidate) -> bool:
    """Return whether the test rejects a candidate or it misses a level by far, and the recommended one fits better."""
    pvalue, other = candidate.pvalue, recommended.pvalue
    rejected = pvalue is not None and pvalue < EXCLUDED_PVALUE and (other is None or pvalue < other)
    return rejected or _largest_ratio(candidate.fit) > max(_largest_ratio(recommended.fit), GROSS)


def _largest_ratio(fit: Fit) -> float:
    """Return the largest ratio of the fitted to the measured wavelet variance at a usable level, or of its inverse."""
    used = usable_levels(fit.wavelet_variance)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = fit.implied[used] / fit.wavelet_variance.variance[used]
        return float(np.maximum(ratio, 1 / ratio).max(initial=1.0))


def _with_recommended(choice: ModelChoice, candidate: Candidate) -> ModelChoice:
    """Return the choice with another recommended candidate, and the step that explains it."""
    ranking = choice.ranking
    candidates = tuple(
        replace(c, recommended=c is candidate, equivalent=c.equivalent or c is candidate) for c in ranking.candidates
    )
    *steps, last = choice.steps
    step = SearchStep(
        family=last.family, entered="sensor", recommended=ranking.label(candidate), pvalue=candidate.pvalue,
        model_error=last.model_error, left="shared", used=True,
    )  # fmt: skip
    return replace(
        choice, ranking=replace(ranking, candidates=candidates), steps=(*steps, replace(last, used=False), step)
    )
