"""Divide samples that arrive in chunks into panels of a fixed length, which do not depend on the chunks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gmwm.base.arrays import Vector

LEAST = 1 << 17
"""Smallest number of samples of a panel."""


def panel_length(rate: float) -> int:
    """Return the number of samples of a panel, a power of two.

    >>> panel_length(100.0), panel_length(4000.0)
    (131072, 524288)
    """
    return max(LEAST, 1 << int(np.ceil(np.log2(128.0 * rate))))


class Panels:
    """Divide one segment after the other into panels of `length` samples. The last panel of a segment can be shorter.

    >>> panels = Panels(4)
    >>> [part.tolist() for part in panels.divide(np.arange(6.0))], [part.tolist() for part in panels.end()]
    ([[0.0, 1.0, 2.0, 3.0]], [[4.0, 5.0]])
    """

    def __init__(self, length: int) -> None:
        self.length = length
        self._rest: list[Vector] = []
        self._held = 0

    def divide(self, values: Vector) -> Iterator[Vector]:
        """Add samples of the current segment, and yield the panels that are complete."""
        first = 0
        while self._held + values.size - first >= self.length:
            last = first + self.length - self._held
            yield self._join(values[first:last])
            first = last
        if first < values.size:
            # A copy, because the chunk may be reused by the reader.
            self._rest.append(values[first:].copy())
            self._held += values.size - first

    def end(self) -> Iterator[Vector]:
        """End the segment, and yield its last panel if it has samples."""
        if self._held:
            yield self._join(np.empty(0))

    def _join(self, values: Vector) -> Vector:
        joined = np.concatenate([*self._rest, values]) if self._rest else values
        self._rest, self._held = [], 0
        return np.ascontiguousarray(joined, dtype=np.float64)
