"""Samples of a recording that are stored before they are processed, by segment."""

from __future__ import annotations

import numpy as np

from gmwm._arrays import Vector

SMALL = 4096
"""Chunks with fewer samples are copied into a buffer of this size, so that single samples do not each need an array."""


class HeldSamples:
    """Samples in the order of their arrival, divided into segments by gaps.

    Examples
    --------
    >>> held = HeldSamples()
    >>> held.add(np.array([1.0, 2.0]))
    >>> held.gap()
    >>> held.add(np.array([3.0]))
    >>> held.joined(), held.lengths, held.ended
    ([array([1., 2.]), array([3.])], (2, 1), False)
    """

    def __init__(self) -> None:
        self._segments: list[list[Vector]] = [[]]
        self._lengths, self._size = [0], 0
        self._buffer, self._used = np.empty(0), 0

    def __len__(self) -> int:
        """Return the number of samples."""
        return self._size

    @property
    def lengths(self) -> tuple[int, ...]:
        """Number of samples of each segment. Directly after a gap, the last number is 0."""
        return tuple(self._lengths)

    @property
    def ended(self) -> bool:
        """Whether the last sample is followed by a gap."""
        return len(self._lengths) > 1 and not self._lengths[-1]

    def add(self, x: Vector) -> None:
        """Add samples to the current segment. A writable array is copied, because its owner can change it."""
        if x.size >= SMALL:
            self._flush()
            self._segments[-1].append(x.copy() if x.flags.writeable else x)
        else:
            if self._used + x.size > self._buffer.size:
                self._flush()
                self._buffer = np.empty(SMALL)
            self._buffer[self._used : self._used + x.size] = x
            self._used += x.size
        self._lengths[-1] += x.size
        self._size += x.size

    def gap(self) -> None:
        """End the current segment."""
        self._flush()
        if self._lengths[-1]:
            self._segments.append([])
            self._lengths.append(0)

    def joined(self) -> list[Vector]:
        """Return the samples of each segment as one array."""
        self._flush()
        self._segments = [segment if len(segment) < 2 else [np.concatenate(segment)] for segment in self._segments]
        return [segment[0] for segment in self._segments if segment]

    def _flush(self) -> None:
        if self._used:
            self._segments[-1].append(self._buffer[: self._used].copy())
            self._buffer, self._used = np.empty(0), 0
