"""State-space matrices of a model, as lists for a file."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from gmwm.processes.model import Model


def has_matrices(model: Model) -> bool:
    """Return whether every term has a state-space form."""
    return model.has("state_space")


def require_matrices(axis: str, model: Model) -> None:
    """Raise an error if a term has no state-space form."""
    if not has_matrices(model):
        missing = next(p for p in model.processes if not p.has("state_space"))
        raise missing.missing("state_space").at(axis)


def rows(matrix: Iterable[Iterable[float]]) -> list[list[float]]:
    """Return a matrix as lists, with all digits."""
    return np.asarray(matrix, dtype=np.float64).tolist()  # type: ignore[no-any-return]
