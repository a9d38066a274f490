"""Replace intervals that determine nothing, and values that a recording cannot have, in the numbers of a datasheet."""

from __future__ import annotations

import math
from dataclasses import replace

from gmwm.choosing.datasheets.entry import Entry

WIDEST = 10.0
"""Largest ratio of the ends of an interval. A wider interval is a limit, or the number is not determined. Pinned by
tests/test_plausible.py."""


def plausible(entry: Entry, rate: float, samples: int, resonance: float | None = None) -> Entry:
    """Return a number whose interval lies in the range that a recording can show, and is not too wide. A frequency is
    between 0 and half the sampling rate, a correlation time between one sample and the length of the recording, and the
    quality factor of a resonance at most its frequency (`resonance`, Hz) times this length. If the ends of an interval
    then differ by more than a factor of `WIDEST`, the strength of a noise becomes an upper limit, and a time, a
    frequency or a quality factor is not determined."""
    if entry.held or entry.low is None or entry.high is None or entry.upper_only or entry.value <= 0:
        return entry
    duration = samples / rate
    ranges = {
        "s": (1 / rate, duration),
        "Hz": (0.0, rate / 2),
        "1": (0.0, (rate / 2 if resonance is None else min(resonance, rate / 2)) * duration),
    }
    least, most = ranges.get(entry.unit, (0.0, math.inf))
    low, high = max(entry.low, least), min(entry.high, most)
    if low <= high <= WIDEST * low and least <= entry.value <= most:
        return replace(entry, low=low, high=high)
    if entry.unit in ranges:
        return replace(entry, low=0.0, high=math.inf, upper_only=True)
    return replace(entry, low=0.0, upper_only=True)
