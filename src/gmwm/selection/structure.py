"""Structures of models: which processes a sum has, how often, and which sums are parts of which."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import product

from gmwm.errors import ModelError
from gmwm.estimation.result import Fit
from gmwm.processes.base import Process
from gmwm.processes.model import Model
from gmwm.processes.ordered import find_class

MOST_CANDIDATES = 5000


def without_values(model: Model) -> Model:
    """The same sum with only the held values: a start of one candidate is nothing to another."""
    return Model(
        tuple(p.with_values(**{q.name: None for q in p.parameters if not p.is_fixed(q.name)}) for p in model.processes)
    )


def nested(general: Model) -> list[Model]:
    """Every sum of some of the terms of a general model, the largest first; held processes are in all of them.

    A process with an order is taken at every lower order too.

    >>> from gmwm import Model
    >>> [model.structure for model in nested(Model.parse("2*GM + WN"))]
    ['2*GM + WN', '2*GM', 'GM + WN', 'GM', 'WN']
    >>> [model.structure for model in nested(Model.parse("AR(2) + RW"))]
    ['AR(2) + RW', 'AR(2)', 'AR(1) + RW', 'AR(1)', 'RW']

    Raises
    ------
    ModelError
        If there is nothing to choose, or there are too many sums.
    """
    bare = without_values(general)
    held = [p for p in bare.processes if p.is_complete]
    free = Counter(p for p in bare.processes if not p.is_complete)
    if not free:
        raise ModelError(f"nothing to choose: every parameter of {general} is held; free one by leaving out fixed(…)")
    choices = [_choices(process, count) for process, count in free.items()]
    size = math.prod(map(len, choices))
    if size > MOST_CANDIDATES:
        raise ModelError(
            f"{general.structure} has {size - 1} models in it, more than the {MOST_CANDIDATES} that are compared; "
            "take a smaller one, or name the candidates: rank([…], data)"
        )
    chosen = ([process for part in parts for process in part] for parts in product(*choices))
    sums = [Model((*terms, *held)) for terms in chosen if terms]
    return sorted(sums, key=lambda model: -freedom(model))


def _choices(process: Process, count: int) -> list[list[Process]]:
    """What a sum may have of a term that is there so many times, most first."""
    every = [[process] * k for k in range(count, -1, -1)]
    if count > 1 or any(process.is_fixed(p.name) for p in process.parameters):
        return every
    return [[process], *([kind()] for kind in type(process).smaller()), []]


def freedom(model: Model) -> int:
    """Number of parameters to estimate."""
    return len(model.names) - len(model.fixed_names)


def terms_of(processes: Iterable[Process]) -> Counter[str]:
    """What a structure is made of: names of its processes, with the values that are held."""
    return Counter(str(process) for process in processes)


def structure_of(model: Model) -> Counter[str]:
    """The structure of a model, whatever values it has."""
    return terms_of(without_values(model).processes)


def shown_by(fit: Fit) -> Counter[str]:
    """The structure that the data show of a fitted model: without terms that are zero; others as what they act as."""
    bare = without_values(fit.model)
    shown, acted = Counter[str](), set[str]()
    for term, process in zip(bare.terms, bare.processes, strict=True):
        if term in fit.diagnostics.acts_as:
            acted.add(fit.diagnostics.acts_as[term])
        elif term not in fit.diagnostics.not_supported:
            shown[str(process)] += 1
    # However many terms act as white noise, say: together they are one.
    return shown | Counter(acted)


def within(part: Counter[str], whole: Counter[str]) -> bool:
    """Whether one structure is a case of another: its terms are there, or one that becomes it at an end of its domain.

    >>> within(Counter({"WN": 1, "RW": 1}), Counter({"GM": 1, "WN": 1}))  # a slow GM is a random walk
    True
    """
    missing = list((part - whole).elements())
    return _matched(missing, list((whole - part).elements()))


def of_lower_order(part: Counter[str], whole: Counter[str]) -> bool:
    """Whether one structure has terms of the other alone, each of its own order or a lower one."""
    return _matched(list((part - whole).elements()), list((whole - part).elements()), limits=False)


def _matched(missing: list[str], spare: list[str], *, limits: bool = True) -> bool:
    """Whether for each missing term there is a spare one of its own that is it for some values."""
    if not missing:
        return True
    first, *rest = missing
    return any(
        first in _cases(name, limits) and _matched(rest, [*spare[:k], *spare[k + 1 :]], limits=limits)
        for k, name in enumerate(spare)
    )


@lru_cache
def _cases(name: str, limits: bool) -> frozenset[str]:
    """Names of the processes that a process is for some values, and those it becomes at the ends of its domain."""
    kind = find_class(name)
    if kind is None:
        return frozenset()
    ends = (end for branch in kind.search(1024, 1.0) for end in (branch.low_acts_as, branch.high_acts_as))
    names = frozenset(smaller.name for smaller in kind.smaller())
    return names | frozenset(end for end in ends if end is not None) if limits else names


def largest_within(models: Sequence[Model], levels: int) -> Model:
    """The first of the models, largest first, that has no more parameters than there are levels."""
    for model in models:
        if freedom(model) <= levels:
            return model
    raise ModelError(
        f"the smallest candidate, {models[-1].structure}, has {freedom(models[-1])} parameters, but the wavelet "
        f"variance has only {levels} levels; record longer"
    )
