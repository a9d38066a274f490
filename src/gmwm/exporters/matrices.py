"""State-space matrices of a model: in steps of a sample, and continuous in time where its terms are."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from gmwm._arrays import Matrix
from gmwm.errors import MissingTheoryError
from gmwm.processes.model import Model
from gmwm.statespace import StateSpace


@dataclass(frozen=True)
class Continuous:
    """dx/dt = A x + w, w of density Qc; y = H x + v, v of density Rc, whose mean over Δt has the variance Rc/Δt.

    Parameters
    ----------
    A : (p, p) array, in 1/s
    Qc : (p, p) array, in u²/s
    H : (1, p) array
    Rc : (1, 1) array, in u²/Hz
    left_out : tuple of str
        Terms that exist in steps only.
    """

    A: Matrix
    Qc: Matrix
    H: Matrix
    Rc: Matrix
    left_out: tuple[str, ...] = ()


def discrete(model: Model, rate: float) -> tuple[StateSpace, tuple[str, ...]]:
    """The sum in steps of a sample, and the term that each state belongs to.

    Raises
    ------
    MissingTheoryError
        If a term has no state-space form.
    """
    spaces = [p.state_space(rate) for p in model.processes]
    labels = tuple(t for t, space in zip(model.terms, spaces, strict=True) for _ in range(space.states))
    return StateSpace.sum(spaces), labels


def continuous(model: Model, rate: float) -> Continuous:
    """The sum in continuous time: the process whose samples have the F and Q of each term.

    A = f ln F, and Q = ∫₀^Δt e^(As) Qc e^(Aᵀs) ds solved for Qc.
    """
    parts, left_out = [], []
    for term, process in zip(model.terms, model.processes, strict=True):
        space = process.state_space(rate)
        found = _continuous(space, rate)
        if found is None:
            left_out.append(term)
        else:
            parts.append(found)
    # The sum of discrete systems puts the blocks of A, Qc, H and Rc where they belong as well.
    joined = StateSpace.sum(parts)
    return Continuous(joined.F, joined.Q, joined.H, joined.R, tuple(left_out))


def _continuous(space: StateSpace, rate: float) -> StateSpace | None:
    """A, Qc, H and Rc in the places of F, Q, H and R; None where no continuous system has such steps."""
    from scipy.linalg import expm, logm

    p = space.states
    if p == 0:
        return StateSpace(F=[], Q=[], H=[], R=space.R / rate)
    values = np.linalg.eigvals(space.F)
    # Steps that forget or turn over have no logarithm: quantization noise, an alternating autoregression.
    if np.any(np.abs(values) < np.finfo(float).tiny) or np.any((values.imag == 0) & (values.real <= 0)):
        return None
    a = rate * (np.log(space.F) if p == 1 else np.real(logm(space.F)))
    turn = np.kron(a, np.eye(p)) + np.kron(np.eye(p), a)
    # ∫₀^Δt e^(turn s) ds is the upper right block of the exponential of [[turn, I], [0, 0]] Δt.
    whole = np.zeros((2 * p * p, 2 * p * p))
    whole[: p * p, : p * p], whole[: p * p, p * p :] = turn, np.eye(p * p)
    gain = expm(whole / rate)[: p * p, p * p :]
    density = np.linalg.solve(gain, space.Q.ravel()).reshape(p, p)
    return StateSpace(F=a, Q=(density + density.T) / 2, H=space.H, R=space.R / rate)


def has_matrices(model: Model) -> bool:
    """Whether every term has a state-space form."""
    return model.has("state_space")


def require_matrices(axis: str, model: Model) -> None:
    """An error where a term has no state-space form."""
    if not has_matrices(model):
        lacking = next(p for p in model.processes if not p.has("state_space"))
        raise MissingTheoryError(f"{axis}: {lacking.missing('state_space')}")


def rows(matrix: Iterable[Iterable[float]]) -> list[list[float]]:
    """A matrix as lists, with all digits."""
    return np.asarray(matrix, dtype=np.float64).tolist()  # type: ignore[no-any-return]
