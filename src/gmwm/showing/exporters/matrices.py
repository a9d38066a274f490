"""Convert state-space matrices to lists for a file."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from gmwm.base.errors import MissingTheoryError
from gmwm.theory.processes.model import Model


def has_matrices(model: Model, rate: float) -> bool:
    """Return whether every term of a model has a state-space form."""
    try:
        model.state_space(rate)
    except MissingTheoryError:
        return False
    return True


def rows(matrix: Iterable[Iterable[float]]) -> list[list[float]]:
    """Return a matrix as a list of rows, with full precision."""
    return np.asarray(matrix, dtype=np.float64).tolist()  # type: ignore[no-any-return]
