"""Validation of the definition and the arguments of processes, and of the terms of a model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from inspect import isfunction, ismethod, signature
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Integers, Vector, as_whole_number
from gmwm.base.errors import ModelError, OptionError
from gmwm.base.text import defined_anew, is_own

if TYPE_CHECKING:
    from gmwm.theory.processes.base import Process
    from gmwm.theory.processes.model import Model


@cache
def fields_of(kind: type[Process]) -> tuple[str, ...]:
    """Return the names of the fields of a class, which `dataclasses.replace` looks up in each call."""
    return tuple(field.name for field in fields(kind))  # type: ignore[arg-type]


def as_lags(lags: ArrayLike) -> Integers:
    """Check lags, which are integers (samples) of any sign and shape, and return them as an array."""
    array = np.asarray(lags)
    if array.dtype.kind not in "iu":
        raise OptionError(
            argument="lags", expected="integers (samples)", got=lags,
            advice="Convert a time in seconds with `round(time * rate)`.",
        )  # fmt: skip
    return array.astype(np.int64)


def as_clusters(clusters: ArrayLike) -> Integers:
    """Check cluster sizes, which are integers (samples) of at least 1, and return them as an array."""
    array = np.asarray(clusters)
    if array.dtype.kind not in "iu" or np.any(array < 1):
        raise OptionError(
            argument="clusters", expected="whole numbers of samples from 1", got=clusters,
            advice="Convert a time in seconds with `round(time * rate)`.",
        )  # fmt: skip
    return array.astype(np.int64)


def as_frequencies(frequencies: ArrayLike, rate: float) -> Vector:
    """Check that frequencies (Hz) are within ±rate/2, and return them as an array."""
    f = np.asarray(frequencies, dtype=np.float64)
    # The end of a grid up to the Nyquist frequency can exceed it by a rounding error.
    if not np.all(np.abs(f) <= 0.5 * rate * (1 + 1e-12)):
        raise OptionError(
            argument="frequencies",
            expected=f"within ±{rate / 2:g} Hz, which is half the rate of {rate:g} Hz",
            got=frequencies,
        )
    return f


def as_rng(rng: object) -> np.random.Generator:
    """Return `rng` if it is a NumPy Generator, or a Generator created from an integer or a SeedSequence."""
    if isinstance(rng, np.random.Generator):
        return rng
    return np.random.default_rng(rng if isinstance(rng, np.random.SeedSequence) else as_seed(rng))


def as_seed(rng: Any) -> int:
    """Return an integer seed, drawn if a Generator: parallel work needs one, and results record it.

    >>> as_seed(3), as_seed(np.random.default_rng(1)) == as_seed(np.random.default_rng(1))
    (3, True)
    """
    if isinstance(rng, np.random.Generator):
        return int(rng.integers(2**63))
    expected = "zero or a positive integer, or a numpy.random.Generator"
    return as_whole_number(rng, "rng", 0, expected=expected)


def as_paths(n: int, paths: int | None) -> tuple[int, int]:
    """Check the number of samples and the number of paths, and return both; None means one path."""
    n = as_whole_number(n, "n", 1, expected="a positive integer")
    return n, 1 if paths is None else as_whole_number(paths, "paths", 1, expected="a positive integer")


def shape_of_paths(n: int, paths: int | None) -> tuple[int, ...]:
    """Return the shape of simulated paths: (n,) if `paths` is None, and (paths, n) otherwise."""
    return (n,) if paths is None else (paths, n)


def require_distinct_terms(processes: tuple[Process, ...]) -> None:
    """Raise ModelError if data cannot distinguish two terms, or if one process occurs in two parametrisations."""
    _require_repeatable(processes)
    _require_one_parametrisation(processes)


def _require_repeatable(processes: tuple[Process, ...]) -> None:
    counts = Counter(p.name for p in processes)
    if len(counts) == len(processes):
        return
    for name, count in counts.items():
        process = next(p for p in processes if p.name == name)
        if count > 1 and not process.repeatable:
            raise ModelError(
                f"{name} cannot be repeated {count} times, because no data can distinguish the terms",
                argument="processes", got=name, advice="Write `{instead}` once.",
                instead=process.instead_of_repeats(count), count=count,
            )  # fmt: skip
    repeated = [p for p in processes if counts[p.name] > 1]
    fixed = [p for p in repeated if all(p.is_fixed(q.name) for q in p.nonlinear_parameters())]
    for a, b in combinations(fixed, 2):
        if type(a) is type(b) and _have_same_shape(a, b):
            held = ", ".join(f"{p.name}={getattr(a, p.name)}" for p in a.nonlinear_parameters())
            raise ModelError(
                f"two terms {a.name} are both fixed at {held}, so that no data can distinguish them",
                advice="Fix them at different values, fix one of them only, or fix their variances too.",
                name=a.name,
            )


def _have_same_shape(a: Process, b: Process) -> bool:
    shapes = [p.name for p in a.nonlinear_parameters()]
    scale = a.scale_parameter().name
    held = all(getattr(a, name) == getattr(b, name) for name in shapes)
    return held and not (a.is_fixed(scale) and b.is_fixed(scale))


def _require_one_parametrisation(processes: tuple[Process, ...]) -> None:
    chosen: dict[str, str] = {}
    for process in processes:
        if process.parametrises is not None and chosen.setdefault(process.parametrises, process.name) != process.name:
            first = chosen[process.parametrises]
            raise ModelError(
                f"{first} and {process.name} are two parametrisations of one process ({process.parametrises})",
                advice="Write all such terms as {first}, or all as {second}.", first=first, second=process.name,
            )  # fmt: skip


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
    """Raise ModelError if another class has this name in any case; a class defined again replaces the older one."""
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


def require_values(model: Model, what: str, advice: str) -> None:
    """Raise a ModelError if a parameter of a model has no value. `what` needs the values, such as "a simulation"."""
    missing = [name for name, value in model.parameters.items() if value is None]
    if missing:
        raise ModelError(f"{what} of {model} needs a value for {', '.join(missing)}", advice=advice)
