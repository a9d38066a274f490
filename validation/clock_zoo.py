"""Time stamps of many kinds of loggers, in plain NumPy, with their true rate and their true gaps.

A record holds the stamps as a file would hold them. `lost` has the row after each gap and the number of samples lost
there. A gap is placed to the row, except where the stamps do not show the row: within a burst that was delivered at
once, or next to a stamp that jitter moved by half a sample. `within` is this uncertainty in rows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[Any]


@dataclass(frozen=True)
class Record:
    """Time stamps, their unit, and the truth; `declared` is the rate that a user would pass."""

    stamps: Vector
    unit: str
    rate: float
    lost: tuple[tuple[int, int], ...] = ()
    within: int = 0
    declared: float | None = None
    change: float | None = None
    expects: str = ""
    cuts: tuple[int, ...] = field(default=())


def kept(n: int, places: Vector, lengths: Vector | int = 1) -> Vector:
    """Indices of n samples that are left if samples are lost before these places."""
    lost = np.zeros(n, dtype=np.int64)
    lost[places] = lengths
    return np.arange(n) + np.cumsum(lost)


def of(k: Vector) -> tuple[tuple[int, int], ...]:
    """Rows after a gap and the number of samples lost, from the indices of the samples."""
    steps = np.diff(k)
    return tuple((int(row) + 1, int(steps[row]) - 1) for row in np.flatnonzero(steps > 1))


def spread(rng: np.random.Generator, n: int, count: int, apart: int = 60) -> Vector:
    """Random places, at least `apart` rows from each other and from the ends."""
    free = rng.choice(n // apart - 3, size=count, replace=False)
    return np.sort((free + 1) * apart + rng.integers(0, apart // 2, count))


def by_chance(rng: np.random.Generator, n: int, share: float) -> Vector:
    """Indices of n samples of which a share is lost at random, each by itself."""
    k = np.flatnonzero(rng.random(int(1.05 * n / (1 - share)) + 100) >= share)[:n]
    return k - k[0]


def whole(t: Vector, per_second: float, *, up: bool = False) -> Vector:
    """Stamps as whole numbers of a unit, rounded down (or to the nearest)."""
    return np.floor(t * per_second + (0.5 if up else 1e-6)).astype(np.int64)


def polled(
    true: Vector, rng: np.random.Generator, every: float, late: float, apart: float, pauses: float = 0.0
) -> Vector:
    """Arrival times if a host reads what has come since it last did, `apart` seconds between two samples.

    Reads are `every` seconds apart, with a deviation `late`; a share of `pauses` waits 0.1 s to 0.5 s longer.
    """
    out, now, i = np.empty(true.size), float(true[0]), 0
    while i < true.size:
        now += every + late * rng.standard_normal() + (rng.uniform(0.1, 0.5) if rng.random() < pauses else 0.0)
        j = int(np.searchsorted(true, now, side="right"))
        out[i:j] = now + apart * np.arange(j - i)
        now, i = (max(now, float(out[j - 1])) if j > i else now), max(i, j)
    return out


def coarse(rate: float, per_second: int, unit: str, losses: int = 0, jitter: float = 0.0, n: int = 20_000):
    """Stamps in whole units; `jitter` in sampling intervals."""

    def make(rng: np.random.Generator) -> Record:
        k = kept(n, spread(rng, n, losses), rng.integers(1, 6, losses)) if losses else np.arange(n)
        t = k / rate + rng.uniform(0, 1e-3 / rate) + jitter / rate * rng.standard_normal(n)
        t = np.maximum.accumulate(t - t[0] + 5 / rate) if jitter else t
        blur = per_second / rate < 1 or jitter > 0.15
        near = int(np.ceil(rate / per_second)) if rate > per_second else 0
        within = max(near, 3 if 0 < jitter <= 0.15 and per_second / rate < 10 else 0, 4 if jitter > 0.15 else 0)
        stamps = whole(t, per_second)
        if unit == "cs":
            return Record(stamps * 10, "ms", rate, of(k), within=within)
        return Record(stamps, unit, rate, of(k), within=within if losses and (blur or jitter) else 0)

    return make


def fine(
    rate: float, share: float = 0.0, jitter: float = 0.0, n: int = 20_000, per_second: int = 10**6, unit: str = "us"
):
    """Stamps of a fine unit with jitter (in sampling intervals), a share lost at random."""

    def make(rng: np.random.Generator) -> Record:
        k = by_chance(rng, n, share) if share else np.arange(n)
        t = (k + 3 + np.clip(jitter * rng.standard_normal(n), -0.45, 0.45)) / rate
        return Record(whole(t, per_second), unit, rate, of(k))

    return make


def bursts(
    rate: float, size: int, apart: float, losses: int = 0, *, wait: float = 0.0, per_second: int = 10**6,
    unit: str = "us", n: int = 20_000,
):  # fmt: skip
    """Bursts of a fixed number of samples; each loss removes a whole burst or some samples before one."""

    def make(rng: np.random.Generator) -> Record:
        places = spread(rng, n // size, losses, 12) * size if losses else np.empty(0, dtype=int)
        k = kept(n, places, rng.integers(1, 2 * size, losses)) if losses else np.arange(n)
        ends = np.repeat(k.reshape(-1, size)[:, -1], size) / rate + np.repeat(
            wait * rng.exponential(size=n // size), size
        )
        t = np.maximum.accumulate(ends) + np.tile(np.arange(size) * apart, n // size)
        return Record(whole(t, per_second), unit, rate, of(k), within=2 * size if losses else 0)

    return make


def serial(rate: float, every: float, late: float, apart: float, pauses: float = 0.0, losses: int = 0, n: int = 60_000):
    """A host that polls a serial line, with pauses; losses of some samples between two reads."""

    def make(rng: np.random.Generator) -> Record:
        places = spread(rng, n, losses, 800) if losses else np.empty(0, dtype=int)
        k = kept(n, places, rng.integers(3, 30, losses)) if losses else np.arange(n)
        t = polled(k / rate, rng, every, late=late, apart=apart, pauses=pauses)
        batch = int(np.ceil((every + 4 * late + (0.5 if pauses else 0)) * rate)) + 2
        return Record(np.round(t, 9), "s", rate, of(k), within=batch if losses else 0)

    return make


def wireless(rate: float, delay: float, losses: int = 0, n: int = 20_000):
    """Packets in order with delays of a heavy tail (s), as over Wi-Fi; losses of some packets."""

    def make(rng: np.random.Generator) -> Record:
        k = kept(n, spread(rng, n, losses, 300), rng.integers(2, 30, losses)) if losses else np.arange(n)
        t = np.maximum.accumulate(k / rate + delay * rng.lognormal(-1.0, 1.2, n))
        return Record(whole(t, 1e6), "us", rate, of(k), within=int(np.ceil(8 * delay * rate)) + 2)

    return make


def wrapped(rate: float, per_second: int, unit: str, losses: int = 0, bits: int = 32, n: int = 20_000):
    """A counter of 32 bits that wraps around in the middle of the record."""

    def make(rng: np.random.Generator) -> Record:
        k = kept(n, spread(rng, n, losses), rng.integers(1, 9, losses)) if losses else np.arange(n)
        t = whole(k / rate, per_second) + 2**bits - int(rng.uniform(0.2, 0.8) * n / rate * per_second)
        return Record(t % 2**bits, unit, rate, of(k))

    return make


def summer_time(hours: int, losses: int = 0, n: int = 20_000, rate: float = 100.0):
    """Stamps that leap by an hour where summer time begins or ends."""

    def make(rng: np.random.Generator) -> Record:
        k = kept(n, spread(rng, n, losses), rng.integers(1, 9, losses)) if losses else np.arange(n)
        leap = int(rng.integers(n // 4, n // 2))
        t = (k + 0.01 * rng.standard_normal(n)) / rate + 3600.0 * hours * (np.arange(n) >= leap) + 1.7e9
        return Record(np.round(t, 6), "s", rate, of(k), cuts=(leap,) if hours < 0 else ())

    return make


def two_rates(first: float, second: float, n: int = 20_000):
    """A rate that changes: an error that states its time."""

    def make(rng: np.random.Generator) -> Record:
        cut = int(n * rng.uniform(0.3, 0.7))
        t = np.cumsum(np.repeat([0.0, 1 / first, 1 / second], [1, cut, n - cut - 1])) + 100.0
        t = t + 0.02 / max(first, second) * rng.standard_normal(n)
        return Record(whole(t, 1e6), "us", first, change=cut / first, expects="changes")

    return make


def regular(every: int, declared: float | None, rate: float = 100.0, n: int = 20_000, unit: str = "us"):
    """Every n-th row is missing: 100 Hz with losses, or a lower rate; only the user knows."""

    def make(rng: np.random.Generator) -> Record:
        k = np.flatnonzero(np.arange(n + n // (every - 1)) % every != every - 1)[:n]
        t = (k + 0.02 * rng.standard_normal(n)) / rate + 1
        lower = declared is not None and declared < rate
        return Record(
            whole(t, 1e6), unit, declared or rate, () if lower else of(k), declared=declared,
            expects="" if declared else "rate-ambiguous",
        )  # fmt: skip

    return make


def drifting(rate: float, ppm: float, losses: int, n: int = 60_000, jitter: float = 0.03):
    """A clock that is off by some ppm and wanders; the rate is the mean one."""

    def make(rng: np.random.Generator) -> Record:
        k = kept(n, spread(rng, n, losses), rng.integers(1, 9, losses)) if losses else np.arange(n)
        wander = np.cumsum(np.cumsum(rng.standard_normal(n)))
        wander *= ppm * 1e-6 / np.max(np.abs(np.diff(wander)))
        t = (k * (1 + ppm * 1e-6) + wander + 5 + jitter * rng.standard_normal(n)) / rate
        true = rate * (n - 1) / ((k[-1] * (1 + ppm * 1e-6) + wander[-1] - wander[0]) * (n - 1) / k[-1])
        return Record(whole(t, 1e6), "us", true, of(k))

    return make


def spoiled(kind: str, rate: float = 100.0, n: int = 5000):
    """One stamp that repeats, steps back or is late; or stamps that stay the same in blocks."""

    def make(rng: np.random.Generator) -> Record:
        t = np.arange(n) / rate + 10
        row = int(rng.integers(100, n - 100))
        if kind == "duplicate":
            t[row] = t[row - 1]
        elif kind == "backward":
            t[row] -= 2.5 / rate
        elif kind == "late":
            rows = rng.choice(n - 2, 50, replace=False) + 1
            t[rows] += 0.9 / rate
        elif kind == "blocks":
            t = 10 + np.arange(n) // 10 * 10 / rate
        return Record(whole(t, 1e6, up=True), "us", rate)

    return make


def windows(rate: float, tick: float, declared: bool, losses: int = 0, n: int = 20_000):
    """Stamps of a host clock with a tick longer than a sample, such as 15.625 ms."""

    def make(rng: np.random.Generator) -> Record:
        k = kept(n, spread(rng, n, losses, 400), rng.integers(3, 90, losses)) if losses else np.arange(n)
        t = np.floor((k + rng.random()) / rate / tick) * tick
        near = int(np.ceil(tick * rate))
        return Record(np.round(t, 6), "s", rate, of(k), within=near, declared=rate if declared else None)

    return make


def gaps(rate: float, n: int = 20_000):
    """A few long gaps, from a second to a day."""

    def make(rng: np.random.Generator) -> Record:
        k = kept(n, spread(rng, n, 6), rng.integers(int(rate), int(3600 * rate), 6))
        return Record(whole((k + 0.02 * rng.standard_normal(n)) / rate + 1, 1e6), "us", rate, of(k))

    return make


KINDS: dict[str, Callable[[np.random.Generator], Record]] = {
    "1000 Hz in whole ms": coarse(1000.0, 1000, "ms"),
    "1000 Hz in whole ms, 25 losses": coarse(1000.0, 1000, "ms", 25),
    "1000 Hz in whole ms, jitter 0.1 ms": coarse(1000.0, 1000, "ms", 0, 0.1),
    "1000 Hz in whole ms, jitter 0.1 ms, 25 losses": coarse(1000.0, 1000, "ms", 25, 0.1),
    "1000 Hz in whole ms, jitter 0.3 ms": coarse(1000.0, 1000, "ms", 0, 0.3),
    "1000 Hz in whole ms, jitter 0.3 ms, 25 losses": coarse(1000.0, 1000, "ms", 25, 0.3),
    "1000.3 Hz in whole ms": coarse(1000.3, 1000, "ms"),
    "999.3 Hz in whole ms": coarse(999.3, 1000, "ms"),
    "200 Hz in whole ms, 25 losses": coarse(200.0, 1000, "ms", 25),
    "500 Hz in whole ms, 25 losses": coarse(500.0, 1000, "ms", 25),
    "500.1 Hz in whole ms, jitter 0.1 ms, 25 losses": coarse(500.1, 1000, "ms", 25, 0.05),
    "2000 Hz in whole ms": coarse(2000.0, 1000, "ms"),
    "2000 Hz in whole ms, 25 losses": coarse(2000.0, 1000, "ms", 25),
    "833 Hz in whole ms, 25 losses": coarse(833.0, 1000, "ms", 25),
    "128 Hz in whole ms, 25 losses": coarse(128.0, 1000, "ms", 25),
    "1600 Hz in whole ms, jitter 0.1 ms, 25 losses": coarse(1600.0, 1000, "ms", 25, 0.16),
    "128 Hz in hundredths of a second": coarse(128.0, 100, "cs"),
    "90 Hz in hundredths of a second": coarse(90.0, 100, "cs"),
    "400 Hz in us, jitter 1 %, 1 % lost": fine(400.0, 0.01, 0.01),
    "200 Hz in ns, 0.1 % lost": fine(200.0, 0.001, 0.0, per_second=10**9, unit="ns"),
    "100 Hz in us, jitter 10 %, 0.1 % lost": fine(100.0, 0.001, 0.1),
    "100 Hz in us, jitter 10 %, 10 % lost": fine(100.0, 0.1, 0.1),
    "100 Hz in us, jitter 15 %, 1 % lost": fine(100.0, 0.01, 0.15),
    "100 Hz in us, 30 % lost": fine(100.0, 0.3, 0.0),
    "100 Hz in us, jitter 10 %, 50 % lost": fine(100.0, 0.5, 0.1),
    "100 Hz in us, jitter 5 %, 60 % lost": fine(100.0, 0.6, 0.05),
    "8000 Hz in us, jitter 5 %, 0.5 % lost": fine(8000.0, 0.005, 0.05),
    "10 Hz in ms, jitter 5 %, 1 % lost": fine(10.0, 0.01, 0.05, per_second=1000, unit="ms"),
    "200 rows of 100 Hz, 2 % lost": fine(100.0, 0.02, 0.0, n=200),
    "1000 Hz in bursts of 8 (USB)": bursts(1000.0, 8, 2e-6),
    "1000 Hz in bursts of 8 (USB), 12 losses": bursts(1000.0, 8, 2e-6, 12),
    "400 Hz in bursts of 10, late by 1 ms, in ms": bursts(400.0, 10, 0.0, wait=1e-3, per_second=1000, unit="ms"),
    "400 Hz in bursts of 10, late by 1 ms, 12 losses": bursts(400.0, 10, 1e-4, 12, wait=1e-3),
    "99.32 Hz polled every 48 ms (serial)": serial(99.32, 0.048, 0.004, 0.002),
    "99.32 Hz polled, 0.2 % of reads pause": serial(99.32, 0.048, 0.004, 0.002, 0.002),
    "99.32 Hz polled, 1 % of reads pause": serial(99.32, 0.048, 0.004, 0.002, 0.01),
    "99.32 Hz polled, 0.2 % of reads pause, 12 losses": serial(99.32, 0.048, 0.004, 0.002, 0.002, 12),
    "1000 Hz polled every 16 ms, 0.1 % of reads pause": serial(1000.0, 0.016, 0.001, 5e-5, 0.001),
    "200 Hz over Wi-Fi, delays of 2 ms": wireless(200.0, 0.002),
    "200 Hz over Wi-Fi, delays of 2 ms, 12 losses": wireless(200.0, 0.002, 12),
    "100 Hz over Wi-Fi, delays of 20 ms": wireless(100.0, 0.02),
    "250 Hz in us, 32 bits wrap around": wrapped(250.0, 10**6, "us"),
    "250 Hz in us, 32 bits wrap around, 25 losses": wrapped(250.0, 10**6, "us", 25),
    "1000 Hz in ms, 32 bits wrap around": wrapped(1000.0, 10**3, "ms"),
    "summer time begins": summer_time(1),
    "summer time begins, 25 losses": summer_time(1, 25),
    "summer time ends": summer_time(-1),
    "two rates, 100 Hz and 50 Hz": two_rates(100.0, 50.0),
    "two rates, 200 Hz and 250 Hz": two_rates(200.0, 250.0),
    "every 10th row missing": regular(10, None),
    "every 10th row missing, 100 Hz declared": regular(10, 100.0),
    "every 10th row missing, 90 Hz declared": regular(10, 90.0),
    "100 ppm and wander, 25 losses": drifting(200.0, 100.0, 25),
    "one stamp repeated": spoiled("duplicate"),
    "one stamp too early": spoiled("backward"),
    "single stamps late": spoiled("late"),
    "stamps the same in blocks of 10": spoiled("blocks"),
    "100 Hz on a clock of 15.625 ms": windows(100.0, 0.015625, False),
    "1000 Hz in hundredths of a second, declared, 12 losses": windows(1000.0, 0.01, True, 12),
    "1000 Hz in hundredths of a second, 12 losses": windows(1000.0, 0.01, False, 12),
    "long gaps": gaps(100.0),
}
"""Kinds of clocks by name; each makes a record from a generator of random numbers."""

LIMITS: dict[str, Callable[[np.random.Generator], Record]] = {
    "1000 Hz in whole ms, jitter 0.1 ms, 100 losses": coarse(1000.0, 1000, "ms", 100, 0.1),
    "100 Hz in us, jitter 20 %, 1 % lost": fine(100.0, 0.01, 0.2),
    "100 Hz in us, jitter 20 %, 5 % lost": fine(100.0, 0.05, 0.2),
}
"""Kinds in which jitter hides some losses, or the row of a loss: two losses next to each other are found as one."""


def mistakes(record: Record, rate: float, rows: list[int], lengths: list[int]) -> dict[str, float]:
    """Relative error of the rate, gaps that were missed, invented, misplaced, and of wrong length."""
    found, used = dict(zip(rows, lengths, strict=True)), set[int]()
    missed = wrong = off = 0
    for row, n in record.lost:
        near = sorted(range(-record.within, record.within + 1), key=abs)
        best = next((row + shift for shift in near if row + shift in found and row + shift not in used), None)
        if best is None:
            missed += 1
            continue
        used.add(best)
        off += best != row
        wrong += found[best] != n
    invented = len([row for row in rows if row not in used and row not in record.cuts])
    return {
        "rate": rate / record.rate - 1, "missed": missed, "invented": invented, "moved": off, "length": wrong,
        "gaps": len(record.lost),
    }  # fmt: skip
