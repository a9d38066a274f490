"""Structures of models: the names of their processes, and which models contain other models."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import product

import numpy as np

from gmwm.base.arrays import Booleans
from gmwm.base.errors import ModelError
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.linear_recursion import Lagged
from gmwm.theory.processes.model import Model, ModelLike, as_model
from gmwm.theory.processes.noise import DR, QN, WN
from gmwm.theory.processes.ordered import find_class
from gmwm.theory.processes.oscillator import OSC
from gmwm.theory.processes.sinusoid import SIN

LEAST_DRIFT_SHARE = 0.1
"""Share at the longest scale below which segments cannot show a drift (tests/selection/test_decisions.py)."""


def without_values(model: Model) -> Model:
    """Return a model without its values except fixed ones, because candidates do not share starting values."""
    bare = tuple(map(_bare, model.processes))
    return model if bare == model.processes else Model(bare)


@lru_cache(maxsize=1024)
def _bare(process: Process) -> Process:
    """Return a process without its values except fixed ones."""
    return process.with_values(**{p.name: None for p in process.parameters if not process.is_fixed(p.name)})


@lru_cache(maxsize=1024)
def _name(process: Process) -> str:
    """Return the text of a process with its fixed values only."""
    return str(_bare(process))


def without_drift(general: Model, recordings: Sequence[WaveletVariance]) -> Model:
    """Return the model without drifts unless gaps show one: slow noise resembles it in short segments only."""
    if any(wv.rise is None or _is_felt(wv.rise, wv) for wv in recordings):
        return general
    others = tuple(p for p in general.processes if not isinstance(p, DR))
    return Model(others) if others else general


def _is_felt(rise: float, wv: WaveletVariance) -> bool:
    """Return whether this slope is a visible part of the wavelet variance at the longest scale."""
    felt = DR(omega=rise).wavelet_variance(wv.levels[-1:], wv.rate, wv.filter)
    return bool(felt[0] >= LEAST_DRIFT_SHARE * wv.variance[-1])


def nested_models(general: Model) -> list[Model]:
    """Return all models of some terms of a general model, largest first, with fixed terms, and lower orders too.

    >>> from gmwm import Model
    >>> [model.structure for model in nested_models(Model.parse("2*GM + WN"))]
    ['2*GM + WN', '2*GM', 'GM + WN', 'GM', 'WN']
    >>> [model.structure for model in nested_models(Model.parse("AR(2) + RW"))]
    ['AR(2) + RW', 'AR(2)', 'AR(1) + RW', 'AR(1)', 'RW']
    """
    # Most candidates for which `select` does not raise an error (tests/selection/test_ranking.py).
    most_candidates = 5000
    bare = without_values(general)
    held = [p for p in bare.processes if p.is_complete]
    free = Counter(p for p in bare.processes if not p.is_complete)
    if not free:
        raise ModelError(
            f"there is no model to select: every parameter of {general} is fixed",
            advice="Leave `fixed(…)` out for at least one process.",
        )
    choices = [_choices(process, count) for process, count in free.items()]
    size = math.prod(map(len, choices))
    if size > most_candidates:
        raise ModelError(
            f"{general.structure} contains {size - 1} models, more than the largest number of {most_candidates}",
            advice="Use a smaller general model, or pass the candidates to `gmwm.rank`.",
        )
    chosen = ([process for part in parts for process in part] for parts in product(*choices))
    sums = [Model((*terms, *held)) for terms in chosen if terms]
    return sorted(sums, key=lambda model: -freedom(model))


def _choices(process: Process, count: int) -> list[list[Process]]:
    """Return the choices for a process that occurs `count` times in the general model, from all occurrences to none."""
    every = [[process] * k for k in range(count, -1, -1)]
    if count > 1 or any(process.is_fixed(p.name) for p in process.parameters):
        return every
    return [[process], *([kind()] for kind in type(process).smaller()), []]


def largest_within(family: ModelLike, wv: WaveletVariance, required: Sequence[Process] = ()) -> Model:
    """Return the largest model within `family` plus the required terms with at most one parameter for each level."""
    optional = without_drift(without_values(as_model(family)), [wv])
    largest = Model((*optional.processes, *required))
    if freedom(largest) <= len(wv):
        return largest
    sums = (Model((*part.processes, *required)) for part in nested_models(optional))
    return next((model for model in sums if freedom(model) <= len(wv)), Model(tuple(required)) if required else largest)


def freedom(model: Model) -> int:
    """Return the number of free parameters of a model."""
    return len(model.names) - len(model.fixed_names)


def structure_of(model: Model) -> Counter[str]:
    """Count the processes of a model with their fixed values; cached, because a selection asks about ten times."""
    if "_structure" not in model.__dict__:
        model.__dict__["_structure"] = names_of(model.processes)
    structure: Counter[str] = model.__dict__["_structure"]
    return structure


def slow_terms(model: Model) -> tuple[str, ...]:
    """Return the sorted names of all terms except white, quantization and short-memory noise, and oscillations.

    >>> slow_terms(Model.parse("WN + RW + GM + SIN"))
    ('GM', 'RW')
    """
    fast = (WN, QN, SIN, OSC, Lagged)
    return tuple(sorted(process.name for process in model.processes if not isinstance(process, fast)))


def names_of(processes: Iterable[Process]) -> Counter[str]:
    """Count processes by name and fixed values."""
    return Counter(map(_name, processes))


def shown_by(fit: Fit) -> Counter[str]:
    """Return the structure of a fit without zero terms; a term that acts as another process counts as it."""
    shown, acted = Counter[str](), set[str]()
    for term, process in fit.model.by_term.items():
        if term in fit.diagnostics.acts_as:
            acted.add(fit.diagnostics.acts_as[term])
        elif term not in fit.diagnostics.not_supported:
            shown[_name(process)] += 1
    # Several terms that act as the same process, such as white noise, count as one term.
    return shown | Counter(acted)


def containing(structures: Sequence[Counter[str]]) -> Booleans:
    """Return for each pair of structures (whole, part) what `of_lower_order(part, whole)` returns, an array (n, n).

    >>> containing([Counter({"GM": 1, "WN": 1}), Counter({"WN": 1})])
    array([[ True,  True],
           [False,  True]])
    """
    names = list(dict.fromkeys(name for structure in structures for name in structure))
    counts = np.array([[structure[name] for name in names] for structure in structures]).reshape(-1, len(names))
    contains = np.asarray(np.all(counts[:, None, :] >= counts, axis=2))
    # Only a process with an order can contain another process.
    ordered = np.array([bool(_cases(name, limits=False)) for name in names], dtype=np.bool_)
    for k in np.flatnonzero(np.any(counts[:, ordered] > 0, axis=1)).tolist():
        for i in np.flatnonzero(~contains[k]).tolist():
            contains[k, i] = of_lower_order(structures[i], structures[k])
    return contains


def within(part: Counter[str], whole: Counter[str]) -> bool:
    """Return whether one structure is a special case of another, including limits of its processes.

    >>> within(Counter({"WN": 1, "RW": 1}), Counter({"GM": 1, "WN": 1}))  # a slow GM is a random walk
    True
    """
    return _is_matched(_surplus(part, whole), _surplus(whole, part))


def of_lower_order(part: Counter[str], whole: Counter[str]) -> bool:
    """Return whether each term of one structure is a term of the other structure with the same or a lower order."""
    missing = _surplus(part, whole)
    return not missing or _is_matched(missing, _surplus(whole, part), limits=False)


def _surplus(one: Counter[str], other: Counter[str]) -> list[str]:
    """Return the terms that only the first structure has, faster than `one - other` (10 000 calls in a ranking)."""
    return [name for name, count in one.items() for _ in range(count - other.get(name, 0))]


def _is_matched(missing: list[str], spare: list[str], *, limits: bool = True) -> bool:
    """Return whether each missing term is a special case of a spare term, with a different spare term for each."""
    if not missing:
        return True
    first, *others = missing
    return any(
        first in _cases(name, limits) and _is_matched(others, [*spare[:k], *spare[k + 1 :]], limits=limits)
        for k, name in enumerate(spare)
    )


@lru_cache
def _cases(name: str, limits: bool) -> frozenset[str]:
    """Return the names of the special cases of a process and, with `limits`, of its limits."""
    kind = find_class(name)
    if kind is None:
        return frozenset()
    ends = (end for branch in kind.search(1024, 1.0) for end in (branch.low_acts_as, branch.high_acts_as))
    names = frozenset(smaller.name for smaller in kind.smaller())
    return names | frozenset(end for end in ends if end is not None) if limits else names
