"""Samples of a recording that are stored before they are processed, by segment."""

from __future__ import annotations

from typing import Any

import numpy as np

from gmwm.base import _core
from gmwm.base.arrays import Vector


class HeldSamples:
    """Samples in the order of their arrival, divided into segments by gaps.

    Chunks with fewer samples than `buffer` are copied into it. `inbox` has the buffer and the number of samples in it;
    chunks can be appended to it directly.

    >>> held = HeldSamples()
    >>> held.add(np.array([1.0, 2.0]))
    >>> held.gap()
    >>> held.add(np.array([3.0]))
    >>> held.segments(), held.lengths, held.ends_with_gap
    ([array([1., 2.]), array([3.])], (2, 1), False)
    """

    def __init__(self, buffer: Vector | None = None) -> None:
        # Default size of the buffer of small chunks, so that single samples do not each need an array.
        size = 4096
        self._segments: list[list[Vector]] = [[]]
        self._lengths, self._size = [0], 0
        self._small = size if buffer is None else buffer.size
        self._place(np.empty(size) if buffer is None else buffer)

    def __getstate__(self) -> dict[str, Any]:
        self._flush()
        return {name: value for name, value in self.__dict__.items() if name not in ("_buffer", "inbox")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._place(np.empty(0))

    def __len__(self) -> int:
        """Return the number of samples."""
        return self._size + self.inbox.used

    @property
    def lengths(self) -> tuple[int, ...]:
        """Number of samples of each segment. Directly after a gap, the last number is 0."""
        return (*self._lengths[:-1], self._lengths[-1] + self.inbox.used)

    @property
    def ends_with_gap(self) -> bool:
        """Whether the last sample is followed by a gap."""
        return len(self._lengths) > 1 and not self.lengths[-1]

    def add(self, x: Vector) -> None:
        """Add samples to the current segment. A writable array is copied, because its owner can change it."""
        if self.inbox.append(x, self._small):
            return
        self._flush()
        if x.size < self._small:
            self._place(np.empty(self._small))
            self.inbox.append(x, self._small)
        else:
            self._store(x.copy() if x.flags.writeable else x)

    def gap(self) -> None:
        """End the current segment."""
        self._flush()
        if self._lengths[-1]:
            self._segments.append([])
            self._lengths.append(0)

    def segments(self) -> list[Vector]:
        """Return the samples of each segment as one array."""
        self._flush()
        self._segments = [segment if len(segment) < 2 else [np.concatenate(segment)] for segment in self._segments]
        return [segment[0] for segment in self._segments if segment]

    def _flush(self) -> None:
        """Move the used part of the buffer to the segment, without a copy."""
        used = self.inbox.used
        if used:
            self._store(self._buffer[:used])
            self._place(self._buffer[used:])

    def _place(self, buffer: Vector) -> None:
        """Use another buffer for small chunks."""
        self._buffer, self.inbox = buffer, _core.Inbox(buffer)

    def _store(self, x: Vector) -> None:
        self._segments[-1].append(x)
        self._lengths[-1] += x.size
        self._size += x.size
