"""Group lines whose frequencies are multiples of one frequency."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from gmwm.measuring.spectrum.line import Line

HIGHEST = 40
"""Highest harmonic that the search considers."""


def grouped(lines: Iterable[Line], resolution: float) -> tuple[Line, ...]:
    """Return the lines sorted by frequency, with the harmonic k and the fundamental f₀ of the lines of a group.

    The frequency of such a line differs from k f₀ by at most the resolution (Hz) plus three standard errors. The
    fundamental with the most harmonics is chosen first.
    """
    waiting = sorted(lines, key=lambda line: line.frequency)
    done: list[Line] = []
    while waiting:
        first, members = max(
            ((one, _multiples(one, waiting, resolution)) for one in waiting), key=lambda found: len(found[1])
        )
        if len(members) < 2:
            break
        done += [replace(line, harmonic=k, fundamental=first.frequency) for line, k in members]
        taken = [id(line) for line, _ in members]
        waiting = [line for line in waiting if id(line) not in taken]
    return tuple(sorted([*done, *waiting], key=lambda line: line.frequency))


def _multiples(first: Line, lines: Iterable[Line], resolution: float) -> list[tuple[Line, int]]:
    """Return the lines at multiples of the frequency of `first`, including `first`, each with its multiple k."""
    found = []
    for line in lines:
        k = round(line.frequency / first.frequency)
        tolerance = resolution + 3 * (line.frequency_error + k * first.frequency_error)
        # A tolerance above a quarter of f₀ would find a multiple for any line.
        if 1 <= k <= HIGHEST and abs(line.frequency - k * first.frequency) <= tolerance < first.frequency / 4:
            found.append((line, k))
    return found
