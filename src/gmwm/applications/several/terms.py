"""Terms of a joint model of several signals: independent, common or shared noise of one process."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

from gmwm.base.errors import ModelError
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model, ModelLike
from gmwm.theory.processes.parameter import Branch
from gmwm.theory.processes.validation import function_of

Kind = Literal["own", "common", "shared"]
"""Kind of a term by its covariance matrix Σ between the signals: diagonal ("own", independent noise), Σ = ℓℓᵀ
("common"), or any positive semidefinite matrix ("shared")."""
_SHARED = re.compile(r"\s*(?:(\d+)\s*\*\s*)?(own|common|shared)\s*\((.*)\)\s*(?:\*\s*(\d+)\s*)?", re.DOTALL)


@dataclass(frozen=True, kw_only=True)
class JointTerm:
    """One term of a joint model of several signals."""

    label: str  # name of the term in results, such as "RW" or "GM[1]"; "common(GM)" if the model also has a term "GM"
    kind: Kind
    process: Process  # Process of the term. Its shape parameter may have a starting value or be fixed.

    @property
    def branch(self) -> Branch | None:
        """Map from the search coordinate to the shape parameter; None if the shape has no free parameter."""
        names = [p.name for p in self.process.nonlinear_parameters()]
        if not names or self.process.is_fixed(names[0]):
            return None
        return type(self.process).search(2, 1.0)[0]

    def __str__(self) -> str:
        return str(self.process) if self.kind == "own" else f"{self.kind}({self.process})"


def joint_terms(model: ModelLike) -> tuple[JointTerm, ...]:
    """Parse a joint model of several signals, such as "common(RW) + 2*GM + WN"."""
    parts = [str(model)] if not isinstance(model, str) else _summands(model)
    kinds: list[tuple[Kind, Process]] = []
    for part in parts:
        match = _SHARED.fullmatch(part)
        kind, text, times = ("own", part, 1) if match is None else (match[2], match[3], int(match[1] or match[4] or 1))
        assert kind in get_args(Kind)
        for process in _processes(text.strip(), str(model)) * times:
            _require_shape(process)
            kinds.append((kind, process))  # type: ignore[arg-type]
    keys = Counter((kind, process.name) for kind, process in kinds if not process.repeatable)
    repeated = [key for key, count in keys.items() if count > 1]
    if repeated:
        kind, name = repeated[0]
        term = name if kind == "own" else f"{kind}({name})"
        raise ModelError(
            f'the model "{model}" has {term} twice; two terms of this kind are the same as one', argument="model",
            got=str(model), advice=f"Write {term} once.",
        )  # fmt: skip
    return _label(kinds)


def _processes(text: str, model: str) -> tuple[Process, ...]:
    """The processes of one summand; its errors name the whole model."""
    if (word := re.match(r"(own|common|shared)\b\s*(\(?)", text)) is not None:
        name = word[1]
        nested = f"{name}(…) cannot be inside another term" if word[2] else f"{name} needs parentheses"
        raise ModelError(
            f'the model "{model}" cannot be read: {nested}', argument="model", got=model,
            advice=f"Write one sum of terms, such as {name}(RW) + WN.",
        )  # fmt: skip
    try:
        return Model.parse(text).processes
    except ModelError as error:
        advice = error.advice or "Terms are processes such as WN, and own(…), common(…) or shared(…) of processes."
        why = f"is wrong: {error.reason}" if text else "is empty"
        raise ModelError(f'a term of the model "{model}" {why}', argument="model", got=model, advice=advice) from None


def _summands(text: str) -> list[str]:
    """Split the text of a model at each plus sign outside parentheses and numbers."""
    parts, opened, start = [], list[int](), 0
    for k, letter in enumerate(text):
        if letter == "(":
            opened.append(k)
        elif letter == ")":
            if not opened:
                raise _unbalanced_error(text, k, "(")
            opened.pop()
        elif letter == "+" and not opened and text[max(k - 1, 0)] not in "eE":
            parts.append(text[start:k])
            start = k + 1
    if opened:
        raise _unbalanced_error(text, opened[-1], ")")
    return [*parts, text[start:]]


def _unbalanced_error(text: str, at: int, missing: str) -> ModelError:
    return ModelError(
        f'the model "{text}" has "{text[at]}" at character {at + 1} without "{missing}"', argument="model", got=text,
        advice=f'Add the missing "{missing}".',
    )  # fmt: skip


def _require_shape(process: Process) -> None:
    """Raise a ModelError unless a process is noise with at most one unknown shape parameter and no fixed scale."""
    free = [p.name for p in process.nonlinear_parameters() if not process.is_fixed(p.name)]
    scale = process.scale_parameter().name
    kind = type(process)
    if any(function_of(getattr(kind, name)) is not function_of(getattr(Process, name)) for name in ("mean", "line")):
        raise ModelError(f"{process.name} is no random noise, and cannot be a term of a joint model", argument="model")
    if process.is_fixed(scale):
        raise ModelError(f"{process.name}.{scale} cannot be fixed in a joint model", argument="model")
    if len(free) > 1 or (free and not type(process).search(2, 1.0)):
        raise ModelError(
            f"{process.name} has shape parameters that a joint model cannot search: {', '.join(free)}",
            argument="model", advice="Fix their values.",
        )  # fmt: skip


def _label(kinds_and_processes: list[tuple[Kind, Process]]) -> tuple[JointTerm, ...]:
    names = Counter(process.name for _, process in kinds_and_processes)
    kinds = Counter((kind, process.name) for kind, process in kinds_and_processes)
    seen: Counter[tuple[Kind, str]] = Counter()
    terms = []
    for kind, process in kinds_and_processes:
        label = process.name
        if names[label] > kinds[kind, label] and kind != "own":
            label = f"{kind}({label})"
        if kinds[kind, process.name] > 1:
            seen[kind, process.name] += 1
            label += f"[{seen[kind, process.name]}]"
        terms.append(JointTerm(label=label, kind=kind, process=process))
    return tuple(terms)


def with_kind(terms: tuple[JointTerm, ...], place: int, kind: Kind) -> tuple[JointTerm, ...]:
    """Return the terms with the kind of term number `place` changed."""
    return (*terms[:place], replace(terms[place], kind=kind), *terms[place + 1 :])


def sum_model(parts: list[Process]) -> Model:
    """Return the model of one signal as the sum of processes. Processes with the same shape are merged."""
    merged: dict[Any, Process] = {}
    for process in parts:
        key = (type(process), *process.nonlinear.tolist())
        if key in merged:
            scale = merged[key].scale + process.scale
            name = process.scale_parameter().name
            merged[key] = process.with_values(**{name: process.value_from(scale)})
        else:
            merged[key] = process
    return Model(tuple(merged.values()))
