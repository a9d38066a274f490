"""Change a model: add or remove a term, or hold a parameter fixed. All functions return the new model as text."""

from __future__ import annotations

from gmwm.base.errors import OptionError
from gmwm.fitting.estimation.result import Fit
from gmwm.theory.processes import Model, Process
from gmwm.theory.processes.parameter import Fixed


def adding(model: str, term: str) -> str:
    """Return a model with a term added.

    >>> adding("GM + WN", "GM")
    '2*GM + WN'
    """
    processes = (*Model.parse(model).processes, *Model.parse(term).processes)
    names = [process.name for process in processes]
    return str(Model(tuple(sorted(processes, key=lambda process: names.index(process.name)))))


def removing(fit: Fit, term: str) -> str:
    """Return the model of a fit without a term."""
    remaining = tuple(process for name, process in _terms(fit).items() if name != term)
    if not remaining:
        raise OptionError(
            "a model needs at least one term", argument="model", got=term, advice="Add another term first."
        )
    return str(Model(remaining))


def holding(fit: Fit, parameter: str) -> str:
    """Return the model of a fit with a parameter held fixed at its estimate. If it was held before, it becomes free."""
    term, _, name = _parts(fit, parameter)
    process = _terms(fit)[term]
    value = None if process.is_fixed(name) else Fixed(fit.parameters[parameter])
    return replacing(fit, term, process.with_values(**{name: value}))


def held_at(fit: Fit, parameter: str, text: str) -> str:
    """Return the model of a fit with a parameter held fixed at a given value."""
    term, _, name = _parts(fit, parameter)
    try:
        value = float(text)
    except ValueError:
        raise OptionError(argument="model", expected=f"a number for {parameter}", got=text) from None
    return replacing(fit, term, _terms(fit)[term].with_values(**{name: Fixed(value)}))


def _parts(fit: Fit, parameter: str) -> tuple[str, str, str]:
    """Divide the name of a parameter of a fit into term, point and name."""
    if parameter not in fit.parameters:
        raise OptionError(argument="model", expected=f"one of {', '.join(fit.parameters)}", got=parameter)
    return parameter.rpartition(".")


def replacing(fit: Fit, term: str, process: Process) -> str:
    """Return the model of a fit with the process of a term replaced."""
    return str(Model(tuple((_terms(fit) | {term: process}).values())))


def _terms(fit: Fit) -> dict[str, Process]:
    """Return the processes of a fit by term, with values for the held parameters only."""
    return {
        term: process.with_values(**{p.name: None for p in process.parameters if not process.is_fixed(p.name)})
        for term, process in zip(fit.model.terms, fit.model.processes, strict=True)
    }
