"""State-space matrices of a model, as lists for a file."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from gmwm.errors import MissingTheoryError
from gmwm.processes.model import Model


def has_matrices(model: Model, rate: float) -> bool:
    """Return whether every term has a state-space form at its values."""
    try:
        model.state_space(rate)
    except MissingTheoryError:
        return False
    return True


def rows(matrix: Iterable[Iterable[float]]) -> list[list[float]]:
    """Return a matrix as lists, with all digits."""
    return np.asarray(matrix, dtype=np.float64).tolist()  # type: ignore[no-any-return]
