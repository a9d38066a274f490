"""Rank given models, or all models within a general one, by the wavelet information criterion."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.errors import GmwmError, ModelError, OptionError
from gmwm.choosing.selection.candidate_fits import Explored, Progress, explore, losses_left_out
from gmwm.choosing.selection.equivalence import REJECTED_DIFFERENCE, as_good, difference_error
from gmwm.choosing.selection.ranking import EQUAL_CRITERIA, Candidate, Ranking, RankingOptions, Weights
from gmwm.choosing.selection.structure import (
    freedom,
    nested_models,
    shown_by,
    structure_of,
    within,
    without_drift,
    without_values,
)
from gmwm.fitting.estimation.bootstrap import DRAWS
from gmwm.fitting.estimation.criterion import Criterion, covariance_trace, implied_by_refits, optimism, problem_of
from gmwm.fitting.estimation.estimator import measure
from gmwm.fitting.estimation.intervals import Method
from gmwm.fitting.estimation.linearised import columns_of
from gmwm.fitting.estimation.model_error import Distance
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.simulated_curves import simulated_variances
from gmwm.measuring.axis_results import ResultsByAxis, signals_of
from gmwm.measuring.covariance import Design
from gmwm.measuring.regression.against import Against
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.signals import Imu, Signal
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model, as_model
from gmwm.theory.processes.validation import as_seed

CLEAR = 4.0
"""A model is not equivalent if its criterion is larger by more than this number of standard errors of the difference,
which assume Gaussian variances (wrong at coarse levels). 2 excludes the true WN + RW in 10 % of recordings, 4 in none
of 40 (docs/validation/selection.md)."""
EXCLUDED_PVALUE = 0.005
"""A model is not equivalent if its p-value is below this, and the best model's is more than `BETTER` times larger. A
true model has such a p-value in 5 of 1000 recordings (tests/selection/test_decisions.py). With `SEARCH_PVALUE` instead,
1 of 30 real axes changes, N by 0.1 % and K by 0.7 %."""
BETTER = 10.0
"""Ratio of p-values; see `EXCLUDED_PVALUE`."""

Data = WaveletVariance | Signal | ArrayLike
AnyModel = Model | Process | str


@overload
def select(
    general: AnyModel, data: Imu, rate: float | None = None, *,
    weighting: Weights = "optimal", criterion: Method = "asymptotic", confidence: float = 0.95, draws: int = DRAWS,
    rng: int | np.random.Generator = 0, robust: bool = False, efficiency: float = 0.6, against: Against = None,
    progress: Progress | None = None,
) -> ResultsByAxis[Ranking]: ...  # fmt: skip
@overload
def select(
    general: AnyModel, data: Data | Sequence[WaveletVariance] | Sequence[Signal], rate: float | None = None, *,
    weighting: Weights = "optimal", criterion: Method = "asymptotic", confidence: float = 0.95, draws: int = DRAWS,
    rng: int | np.random.Generator = 0, robust: bool = False, efficiency: float = 0.6, against: Against = None,
    progress: Progress | None = None,
) -> Ranking: ...  # fmt: skip
def select(
    general: AnyModel, data: Imu | Data | Sequence[WaveletVariance] | Sequence[Signal], rate: float | None = None, *,
    weighting: Weights = "optimal", criterion: Method = "asymptotic", confidence: float = 0.95, draws: int = DRAWS,
    rng: int | np.random.Generator = 0, robust: bool = False, efficiency: float = 0.6, against: Against = None,
    progress: Progress | None = None,
) -> Ranking | ResultsByAxis[Ranking]:  # fmt: skip
    """Select a model: rank every model within a general one, and recommend the simplest model that is as good as the
    best.

    All models are fitted with the same weighting matrix Ω, which is computed from the estimate of the general model.
    They are compared by the wavelet information criterion, WIC = objective + 2 tr[Cov(ν̂², ν²(θ̂)) Ω], where ν̂² is the
    measured wavelet variance and ν²(θ̂) the one of the fitted model. The second term is the optimism, because a fit is
    closer to the fitted data than to other data. The criterion is uncertain and tends to keep unnecessary terms. A
    model is therefore equivalent to the best one if the difference of their criteria can be due to chance. The test
    simulates recordings from the model. The model is equivalent if, in more than 5 % of them, its criterion exceeds the
    smallest criterion by at least as much as in the data. Models that contain a smaller equivalent model are left out,
    and the simplest of the remaining models is recommended.

    Parameters
    ----------
    general : Model, Process or str
        The largest model, for example `4 * GM() + WN() + QN() + RW() + DR()`. Fixed values stay fixed, and a process
        whose values are all fixed is in every candidate. Models with more parameters than the wavelet variance has
        levels are not candidates.
    data : WaveletVariance, Signal or (N,) array; a list of these; or an Imu or (N, k) array
        The recording, or several recordings of the same sensor. With several recordings, the candidates are fitted to
        the mean of the wavelet variances, and ranked by cross-validation. Each recording is left out in turn, and the
        loss is its distance from a fit to the other recordings. A model that describes a disturbance of one recording
        only has a large loss.
    rate : float, optional
        Sampling rate (Hz); only for plain arrays.
    weighting : "optimal" or "diagonal"
        Ω = V⁻¹ or diag(1 / V_jj), where V is the exact covariance of ν̂² under the general model. "optimal"
        distinguishes models best.
    criterion : "asymptotic" or "bootstrap"
        How the optimism is computed: by first-order theory, or by fitting every candidate to `draws` recordings
        simulated from the general model. A simulated fit takes a few milliseconds.
    confidence : float
        Probability that the true model is among the equivalent models, if it is a candidate.
    draws : int
        Number of simulated recordings for the uncertainty of the criterion and for the bootstrap.
    rng : int or numpy.random.Generator
        Seed or generator of the random numbers. The same integer gives the same result.
    robust, efficiency, against
        As for `fit`. The same regression is used for all models.
    progress : callable, optional
        Function that is called with the number of fitted candidates and the number of all candidates.

    Returns
    -------
    Ranking; for an Imu or several columns a mapping of axis to Ranking

    Raises
    ------
    ModelError
        If no parameter is free, or there are too many candidates.
    MissingTheoryError
        If a process does not define its autocovariance.
    DataError, OptionError
        As for `fit`, and if the recordings differ in their rate, unit or estimator.

    References
    ----------
    Efron (2004), The estimation of prediction error, JASA 99, 619-632; section III-C of Balamuta, Guerrier, Molinari
    and Yang.

    Examples
    --------
    >>> from gmwm import GM, QN, RW, WN, select
    >>> x = (WN(sigma2=4.0) + RW(gamma2=1e-3)).simulate(50_000, 100.0, rng=1)
    >>> ranking = select(2 * GM() + WN() + QN() + RW(), x, rate=100.0)
    >>> ranking.recommended.structure
    'WN + RW'
    """
    options = RankingOptions(
        weighting=weighting, criterion=criterion, confidence=confidence, draws=draws, seed=as_seed(rng)
    )  # fmt: skip

    def search(x: Any) -> Ranking:
        return select_within(
            general, x, options, rate=rate, robust=robust, efficiency=efficiency, against=against, progress=progress
        )

    if (signals := signals_of(data)) is not None:
        return ResultsByAxis(results={axis: search(x) for axis, x in signals.items()})
    return search(data)


def select_within(
    general: AnyModel, data: Data | Sequence[WaveletVariance] | Sequence[Signal], options: RankingOptions, *,
    required: Sequence[Process] = (), rate: float | None = None, robust: bool = False, efficiency: float = 0.6,
    against: Against = None, progress: Progress | None = None,
) -> Ranking:  # fmt: skip
    """Rank every model within a general one, with the `required` terms; the options are checked."""
    wv = measure(data, rate, robust, efficiency, against=against)
    ranking, others = begin_ranking(general, wv, options, required=required, progress=progress)
    return with_equivalent(ranking, others)


def begin_ranking(
    general: AnyModel, wv: WaveletVariance, options: RankingOptions, *, required: Sequence[Process] = (),
    progress: Progress | None = None,
) -> tuple[Ranking, Iterator[int]]:  # fmt: skip
    """Rank like `select_within`, but test only until the recommended model is known. Also return an iterator that
    tests the others and yields the places of the equivalent ones: half of the time, which a search often saves."""
    optional = without_drift(without_values(as_model(general)), [wv])
    models = nested_models(optional)
    if required:
        models = [*(Model((*model.processes, *required)) for model in models), Model(tuple(required))]
    general_model = Model((*optional.processes, *required))
    candidates = [model for model in models if freedom(model) <= len(wv)]
    if not candidates:
        raise ModelError(
            f"every model within {general_model.structure} has more parameters than the wavelet variance has levels, "
            f"{len(wv)}",
            advice="Record longer.",
        )
    return _rank(general_model, candidates, wv, options=options, progress=progress)


def with_equivalent(ranking: Ranking, places: Iterable[int]) -> Ranking:
    """Return a ranking whose candidates at these places are equivalent too."""
    candidates = list(ranking.candidates)
    for place in places:
        candidates[place] = replace(candidates[place], equivalent=True)
    return replace(ranking, candidates=tuple(candidates))


@overload
def rank(
    models: Sequence[AnyModel], data: Imu, rate: float | None = None, *,
    weighting: Weights = "optimal", criterion: Method = "asymptotic", confidence: float = 0.95, draws: int = DRAWS,
    rng: int | np.random.Generator = 0, robust: bool = False, efficiency: float = 0.6, against: Against = None,
    progress: Progress | None = None,
) -> ResultsByAxis[Ranking]: ...  # fmt: skip
@overload
def rank(
    models: Sequence[AnyModel], data: Data | Sequence[WaveletVariance] | Sequence[Signal], rate: float | None = None, *,
    weighting: Weights = "optimal", criterion: Method = "asymptotic", confidence: float = 0.95, draws: int = DRAWS,
    rng: int | np.random.Generator = 0, robust: bool = False, efficiency: float = 0.6, against: Against = None,
    progress: Progress | None = None,
) -> Ranking: ...  # fmt: skip
def rank(
    models: Sequence[AnyModel], data: Imu | Data | Sequence[WaveletVariance] | Sequence[Signal],
    rate: float | None = None, *,
    weighting: Weights = "optimal", criterion: Method = "asymptotic", confidence: float = 0.95, draws: int = DRAWS,
    rng: int | np.random.Generator = 0, robust: bool = False, efficiency: float = 0.6, against: Against = None,
    progress: Progress | None = None,
) -> Ranking | ResultsByAxis[Ranking]:  # fmt: skip
    """Rank given models by the criterion of `select`.

    The weighting matrix Ω and the covariance V are computed from the smallest model that contains all candidates.

    Parameters
    ----------
    models : list of Model, Process or str
        The candidates.
    data, rate, weighting, criterion, confidence, draws, rng, robust, efficiency, against, progress
        As for `select`.

    Returns
    -------
    Ranking; for an Imu or several columns a mapping of axis to Ranking

    Raises
    ------
    ModelError, DataError, OptionError
        As for `select`.

    Examples
    --------
    >>> from gmwm import rank
    >>> from gmwm import RW, WN
    >>> x = (WN(sigma2=4.0) + RW(gamma2=1e-3)).simulate(50_000, 100.0, rng=1)
    >>> ranking = rank(["WN", "WN + RW", "GM + WN"], x, rate=100.0)
    >>> [candidate.structure for candidate in ranking]
    ['WN + RW', 'GM + WN', 'WN']
    """
    options = RankingOptions(
        weighting=weighting, criterion=criterion, confidence=confidence, draws=draws, seed=as_seed(rng)
    )  # fmt: skip
    if isinstance(models, (str, Process, Model)) or not list(models):
        raise OptionError(
            argument="models", expected='a list of candidates such as ["WN + RW", "GM + WN"]', got=models,
            advice="To rank all models within one, use `gmwm.select`.",
        )  # fmt: skip
    candidates = [as_model(model) for model in models]

    def ranked(x: Any) -> Ranking:
        return rank_models(
            candidates, measure(x, rate, robust, efficiency, against=against), options, progress=progress
        )

    if (signals := signals_of(data)) is not None:
        return ResultsByAxis(results={axis: ranked(x) for axis, x in signals.items()})
    return ranked(data)


def rank_models(
    models: Sequence[Model], wv: WaveletVariance, options: RankingOptions, *, progress: Progress | None = None
) -> Ranking:
    """Rank given models. The options are already checked."""
    candidates = [without_values(model) for model in models]
    for model in candidates:
        if freedom(model) > len(wv):
            raise ModelError(
                f"{model.structure} has {freedom(model)} free parameters, but the wavelet variance has only "
                f"{len(wv)} levels",
                advice="Record longer, or leave this model out.",
            )
    unique = list({frozenset(structure_of(model).items()): model for model in candidates}.values())
    return with_equivalent(*_rank(_union(unique), unique, wv, options=options, progress=progress))


def _union(models: Sequence[Model]) -> Model:
    """Return the smallest model that contains all models. A term that is fixed in some and free in others is free."""
    most = Counter[Process]()
    for model in models:
        most |= Counter(model.processes)
    terms: list[Process] = []
    single: dict[str, int] = {}
    for process, count in most.items():
        place = single.get(process.name)
        larger = next(((k, kind) for k, p in enumerate(terms) if (kind := _join(p, process)) is not None), None)
        if larger is not None:
            terms[larger[0]] = larger[1]()
        elif process.repeatable or place is None:
            single[process.name] = len(terms)
            terms += [process] * count
        elif terms[place].is_complete:
            terms[place] = process
    return Model(tuple(terms))


def _join(one: Process, other: Process) -> type[Process] | None:
    """Return the class that includes two processes of different order, if there is one and no value is fixed."""
    if type(one) is type(other) or any(
        process.is_fixed(p.name) for process in (one, other) for p in process.parameters
    ):
        return None
    return type(one).joined(type(other))


def _rank(
    general: Model, candidates: Sequence[Model], wv: WaveletVariance, *, options: RankingOptions,
    progress: Progress | None,
) -> tuple[Ranking, Iterator[int]]:  # fmt: skip
    weighting, draws, seed = options.weighting, options.draws, options.seed
    explored = explore(general, candidates, wv, weighting, progress=progress)
    criteria = _criteria(explored, method=options.criterion, draws=draws, seed=seed)
    losses = losses_left_out(explored, candidates, weighting)
    ranked = [
        _candidate(model, explored.fits[k], criteria[k], None if losses is None else float(losses[k]))
        for k, model in enumerate(candidates)
    ]
    ranked = _relate(ranked)
    ranked = _sort(ranked)
    ranked = [replace(c, difference=_score(c) - _score(ranked[0])) for c in ranked]
    equivalent = _equivalent(ranked, explored, confidence=options.confidence, draws=draws, seed=seed)
    first = next(equivalent)
    chosen = [replace(c, equivalent=k == first, recommended=k == first) for k, c in enumerate(ranked)]
    ranking = Ranking(
        candidates=tuple(chosen), within=general, general=explored.general, weighting=weighting,
        weighting_matrix=explored.weights.matrix, wavelet=explored.wavelet, confidence=options.confidence,
    )  # fmt: skip
    return ranking, equivalent


def _levels(candidates: Sequence[Candidate]) -> dict[str, float]:
    """Return each structure's criterion, equal up to numerical errors, as for ARMA(1,1) and GM + WN."""
    level: dict[str, float] = {}
    least = -np.inf
    for c in sorted(candidates, key=_score):
        if not _score(c) - least <= EQUAL_CRITERIA * abs(_score(c)):
            least = _score(c)
        level[c.structure] = least
    return level


def _sort(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Sort candidates by the criterion. A model with the same fit as a smaller model comes after it."""
    level = _levels(candidates)
    return sorted(
        candidates,
        key=lambda c: (level[c.same_as or c.structure], c.same_as is not None, c.parameters, freedom(c.model)),
    )


def _score(candidate: Candidate) -> float:
    return candidate.wic.value if candidate.out_of_sample is None else candidate.out_of_sample


def _candidate(model: Model, fit: Fit, wic: Criterion, out_of_sample: float | None) -> Candidate:
    return Candidate(
        model=model, fit=fit, wic=wic, out_of_sample=out_of_sample, difference=0.0,
        parameters=len(columns_of(fit.model, fit.diagnostics.acts_as)[0]), equivalent=False, recommended=False,
        same_as=None,
    )  # fmt: skip


def _criteria(explored: Explored, method: Method, draws: int, seed: int) -> list[Criterion]:
    """Compute the criterion of each candidate. If candidates share a fit, it is evaluated once."""
    traces, shown = dict[int, float](), dict[tuple[Process, ...], float]()
    variances = None
    if method == "bootstrap":
        wv = explored.general.wavelet_variance
        variances = simulated_variances(explored.general.model, Design.of(wv), draws, seed)
    for fit in {id(fit): fit for fit in explored.fits}.values():
        if variances is None:
            # Terms that are zero do not count.
            terms = tuple(process for process in fit.model.processes if process.scale > 0)
            if terms not in shown:
                shown[terms] = optimism(fit, explored.wavelet, explored.weights)
            traces[id(fit)] = shown[terms]
        else:
            implied = implied_by_refits(*problem_of(fit), variances)
            traces[id(fit)] = covariance_trace(variances, implied, explored.weights.matrix)
    return [Criterion(loss=float(fit.objective), optimism=traces[id(fit)], method=method) for fit in explored.fits]


def _relate(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Set `same_as` of candidates that have the same fit as a smaller candidate."""
    by_structure = {frozenset(structure_of(c.model).items()): c for c in candidates}
    alike: dict[int, Candidate] = {}
    for c in sorted(candidates, key=lambda c: freedom(c.model)):
        alike.setdefault(id(c.fit), c)
    shown = {key: frozenset(shown_by(c.fit).items()) for key, c in alike.items()}
    related = []
    for c in candidates:
        smaller = by_structure.get(shown[id(c.fit)])
        if smaller is None or smaller is c:
            smaller = alike[id(c.fit)]
        related.append(c if smaller is c else replace(c, same_as=smaller.structure))
    target = {c.structure: c.same_as for c in related}
    return [c if c.same_as is None else replace(c, same_as=_end(c.same_as, target)) for c in related]


def _end(name: str, target: Mapping[str, str | None]) -> str:
    """Follow a chain of `same_as` names, and return the last one."""
    seen = {name}
    while (after := target[name]) is not None and after not in seen:
        name = after
        seen.add(name)
    return name


def _is_rejected(candidate: Candidate, best: Candidate) -> bool:
    """Return whether the test rejects a candidate and the best one fits much better. With weights of a candidate far
    below the data, other models can appear equally far from the data."""
    pvalue = candidate.pvalue
    return pvalue is not None and pvalue < EXCLUDED_PVALUE and (best.pvalue or 0.0) > BETTER * pvalue


def _is_near(candidate: Candidate) -> bool:
    """Return whether a candidate is so near to the data that the test, which fits it again without the coarse levels,
    cannot reject it. The distance of the fit to all levels is larger, and takes a twentieth of the time."""
    try:
        return Distance.of(candidate.fit).pvalue > BETTER * EXCLUDED_PVALUE
    except GmwmError:  # the model has no noise at some level
        return False


def _equivalent(
    candidates: Sequence[Candidate], explored: Explored, confidence: float, draws: int, seed: int
) -> Iterator[int]:
    """Yield the places of the candidates that are as good as the best one and contain no smaller such one, the simplest
    first."""
    best, level = candidates[0], _levels(candidates)
    distinct = [k for k, c in enumerate(candidates) if c.same_as is None]
    if not _is_near(best):
        # A model that the test rejects is not the best one if it accepts another.
        near = next((candidates[k] for k in distinct if _is_near(candidates[k])), None)
        best = near if near is not None and _is_rejected(best, near) else best
    equivalent, worse = list[Candidate](), list[Candidate]()
    for place in sorted(distinct, key=lambda k: (candidates[k].parameters, level[candidates[k].structure], k)):
        candidate = candidates[place]
        structure = structure_of(candidate.model)
        if any(within(structure_of(k.model), structure) for k in equivalent):
            continue
        if level[candidate.structure] != level[best.structure]:
            difference = candidate.wic.value - best.wic.value
            if difference > REJECTED_DIFFERENCE:
                continue
            # A model with a clearly larger criterion is not equivalent, even if it is simpler.
            if difference > CLEAR * difference_error(candidate.fit, best.fit, explored.weights, explored.wavelet):
                continue
            # Models with the same curve and criterion, such as RW and a slow GM, have the same answer.
            alike = (k.fit.implied for k in worse if level[k.structure] == level[candidate.structure])
            if any(np.allclose(curve, candidate.fit.implied, rtol=EQUAL_CRITERIA, atol=0) for curve in alike):
                continue
            # The test of the fit is last, because it takes longest.
            good = as_good(explored, candidate.fit, rival=best.fit, size=1 - confidence, draws=draws, seed=seed)
            if not good or (not _is_near(candidate) and _is_rejected(candidate, best)):
                worse.append(candidate)
                continue
        equivalent.append(candidate)
        yield place
