"""Checks of a process class before it is registered."""

from __future__ import annotations

from collections.abc import Mapping
from inspect import isfunction, ismethod, signature
from typing import TYPE_CHECKING, Any

from gmwm.base.errors import ModelError
from gmwm.base.text import defined_anew, is_own

if TYPE_CHECKING:
    from gmwm.theory.processes.base import Process


def function_of(method: Any) -> Any:
    """Return the plain function of a method or class method."""
    return getattr(method, "__func__", method)


def check_members(cls: type[Process], wavelet_variance_sources: tuple[str, ...]) -> None:
    """Raise ModelError unless the class has a name, a title, parameters, one scale parameter and a wavelet variance."""
    if missing := [name for name in ("name", "title", "parameters") if not hasattr(cls, name)]:
        raise ModelError(
            f"{cls.__name__} must define name, title and parameters; {missing[0]} is missing", argument=missing[0]
        )
    if sum(p.scale_power is not None for p in cls.parameters) != 1:
        raise ModelError(
            f"{cls.__name__}.parameters must have exactly one parameter with a scale_power", argument="parameters"
        )
    if not cls.has("wavelet_variance"):
        sources = ", ".join(wavelet_variance_sources)
        raise ModelError(f"{cls.__name__} must define at least one of shape, {sources}", argument="shape")


def check_name(cls: type[Process], registry: Mapping[str, type[Process]]) -> None:
    """Raise ModelError if another class has this name in any case; a class that is defined again replaces the older
    one."""
    older = next((process for name, process in registry.items() if name.casefold() == cls.name.casefold()), None)
    if older is None:
        return
    if not defined_anew(cls, older) or older.name != cls.name:
        raise ModelError(
            f"the name {older.name} belongs to {older.__module__}.{older.__qualname__}"
            f"{', a process of gmwm' if is_own(older) else ''}",
            argument="name",
            got=cls.name,
            advice="Give {process} another name.",
            process=cls.__qualname__,
        )


def check_calls(cls: type[Process], base: type[Process]) -> None:
    """Raise ModelError if a method does not accept the arguments of the method of `Process` that it overrides."""
    for name, method in vars(cls).items():
        expected = getattr(base, name, None)
        if name.startswith("_") or not isfunction(function_of(method)) or not callable(expected):
            continue
        signatures = {
            n: p for n, p in signature(expected).parameters.items() if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
        }
        needed = [name for name, p in signatures.items() if p.default is p.empty]
        try:
            own_signature = signature(getattr(cls, name))
            own_signature.bind(*needed)
            own_signature.bind(*signatures)
        except TypeError as error:
            of_class = ismethod(expected)
            written = ", ".join(
                (["cls"] if of_class else []) + [f"{w}=…" if w not in needed else w for w in signatures]
            )
            raise ModelError(
                f"{cls.__name__}.{name} must be {'a class method, ' if of_class else ''}{name}({written}); "
                f"it is {name}{signature(function_of(method))}",
                argument=name,
            ) from error
