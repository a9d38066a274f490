"""Paired timing: two callables take turns in one process, and the median of their ratios is the result.

A ratio of neighbours in time cancels what both suffer from (clock, other processes); absolute times do not.
A bench module is a `bench_*.py` beside this file with one function, `cases() -> Iterable[Case]`.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Case:
    """One comparison.

    Parameters
    ----------
    name : str
        What is timed.
    run : callable
        The call that is timed; takes nothing, its result is thrown away.
    against : str
        What it is compared with.
    reference : callable
        The call it is compared with.
    repeats : int
        Number of pairs; one more pair comes first and is not counted.
    target : float or None
        The median ratio that is to be kept.
    bytes_moved : int
        Bytes that cannot but pass between memory and processor, 0 if not known: gives the share of the
        bandwidth of a plain copy.
    items : int
        Pieces of work, 0 if not known: gives the time of one.
    """

    name: str
    run: Callable[[], object]
    against: str
    reference: Callable[[], object]
    repeats: int = 21
    target: float | None = None
    bytes_moved: int = 0
    items: int = 0


@dataclass(frozen=True)
class Timing:
    """What a case took: seconds are medians, ratios are those of the pairs."""

    name: str
    against: str
    repeats: int
    seconds: float
    reference_seconds: float
    ratio_min: float
    ratio_median: float
    ratio_max: float
    target: float | None
    bandwidth_share: float | None
    nanoseconds_per_item: float | None


def seconds(call: Callable[[], object]) -> float:
    """Wall time of one call (s)."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def measure(case: Case, copy_bandwidth: float) -> Timing:
    """Time the case, its two sides taking turns, after a warm-up; `copy_bandwidth` in bytes/s."""
    seconds(case.run), seconds(case.reference)
    pairs = [(seconds(case.run), seconds(case.reference)) for _ in range(case.repeats)]
    ratios = [ours / theirs for ours, theirs in pairs]
    median = statistics.median(ours for ours, _ in pairs)
    return Timing(
        name=case.name,
        against=case.against,
        repeats=case.repeats,
        seconds=median,
        reference_seconds=statistics.median(theirs for _, theirs in pairs),
        ratio_min=min(ratios),
        ratio_median=statistics.median(ratios),
        ratio_max=max(ratios),
        target=case.target,
        bandwidth_share=case.bytes_moved / median / copy_bandwidth if case.bytes_moved else None,
        nanoseconds_per_item=1e9 * median / case.items if case.items else None,
    )


def copy_bandwidth(values: int = 10_000_000) -> float:
    """Bytes per second that `np.copyto` reads and writes, on arrays that no cache holds."""
    import numpy as np

    source, target = np.ones(values), np.zeros(values)
    best = min(seconds(lambda: np.copyto(target, source)) for _ in range(7))
    return 2 * source.nbytes / best


def table(timings: Iterable[Timing]) -> str:
    """The timings in columns."""
    rows = [("case", "against", "ms", "ref ms", "min", "MEDIAN", "max", "target", "bandwidth", "ns/item")]
    for t in timings:
        kept = "" if t.target is None else f"{t.target:g}" + ("" if t.ratio_median <= t.target else " MISSED")
        share = "" if t.bandwidth_share is None else f"{t.bandwidth_share:.0%}"
        item = "" if t.nanoseconds_per_item is None else f"{t.nanoseconds_per_item:.3f}"
        low, middle, high = (f"{r:.3f}" for r in (t.ratio_min, t.ratio_median, t.ratio_max))
        ours, theirs = f"{1e3 * t.seconds:.3f}", f"{1e3 * t.reference_seconds:.3f}"
        rows.append((t.name, t.against, ours, theirs, low, middle, high, kept, share, item))
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]

    def line(row: tuple[str, ...]) -> str:
        cells = (c.ljust(w) if k < 2 else c.rjust(w) for k, (c, w) in enumerate(zip(row, widths, strict=True)))
        return "  ".join(cells).rstrip()

    return "\n".join([line(rows[0]), "-" * len(line(rows[0])), *map(line, rows[1:])])


def as_json(timings: Iterable[Timing], bandwidth: float, machine: dict[str, str]) -> dict[str, Any]:
    """The same as plain data."""
    return {
        "machine": machine,
        "copy_bandwidth_bytes_per_s": bandwidth,
        "timings": [asdict(timing) for timing in timings],
    }
