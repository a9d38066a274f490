"""Replace each term of a fit that the data cannot distinguish from another process by this process."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from gmwm.fitting.estimation.result import Fit
from gmwm.theory.filters import find_filter
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.equivalence import likeness
from gmwm.theory.processes.model import Model
from gmwm.theory.processes.parameter import Fixed


def translated(fit: Fit) -> tuple[Fit, tuple[str, ...]]:
    """Replace each term that acts as another process by this process, and merge it with a term of this process.

    For example, a Gauss-Markov term that acts as white noise becomes white noise, and its variance is added to that of
    the white noise of the model. Standard errors of the sum then follow from the new model.

    Returns
    -------
    fit : Fit
        The fit with the new model.
    labels : tuple of str
        For each term of the new model, its label in the original fit, such as "WN + GM[1]" for a merged term.
    """
    wv = fit.wavelet_variance
    processes = dict(zip(fit.model.terms, fit.model.processes, strict=True))
    like = {term: likeness(processes[term], name, levels=wv.levels, rate=wv.rate, filter=find_filter(wv.filter))
            for term, name in fit.diagnostics.acts_as.items()}  # fmt: skip
    acting = {term: other for term, other in like.items() if other is not None}
    if not acting:
        return fit, fit.model.terms
    merged = dict(processes)
    for kind in dict.fromkeys(type(other) for other in acting.values()):
        alike = {t: acting.get(t, p) for t, p in processes.items() if isinstance(acting.get(t, p), kind)}
        merged = {t: p for t, p in merged.items() if t not in alike}
        label = " + ".join(t for t, p in alike.items() if p.scale > 0) or next(iter(alike))
        merged[label] = _sum(kind, alike.values(), [processes[t] for t in alike])
    model = Model(tuple(merged.values()))
    rest = {term: name for term, name in fit.diagnostics.acts_as.items() if term not in acting}
    labels = dict(zip(merged, model.terms, strict=True))
    none = tuple(labels[t] for t in merged if merged[t].scale == 0)
    written = replace(
        fit,
        model=model,
        parameters={name: float(value) for name, value in model.parameters.items() if value is not None},
        decomposition=model.decomposition(wv.levels, wv.rate, wv.filter),
        diagnostics=replace(fit.diagnostics, acts_as={labels[t]: n for t, n in rest.items()}, not_supported=none),
    )
    return written, tuple(merged)


def _sum(kind: type[Process], parts: Iterable[Process], written_as: Iterable[Process]) -> Process:
    """Return one process of class `kind` whose scale is the sum of the scales of several processes.

    It is held fixed if all processes in the original model (`written_as`) were held.
    """
    value = kind.value_from(sum(part.scale for part in parts))
    held = all(process.is_fixed(process.scale_parameter().name) for process in written_as)
    return kind(**{kind.scale_parameter().name: Fixed(value) if held else value})
