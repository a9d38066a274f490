"""Shared noise of several axes: size of the test, coverage of correlations, power, by simulators in plain NumPy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from gmwm.applications.several import cross
from validation.legend import legend

NAME = "cross"
SEED = 20261123
REPEATS = 1000
LONG = 200
"""Repeats with 10^5 samples; the first three kinds of noise have `REPEATS`."""
RATE = 100.0
AXES = ("gyro_x", "gyro_y", "gyro_z")

Array = NDArray[np.float64]
Make = Callable[[np.random.Generator, int, int], Array]


def white(rng: np.random.Generator, d: int, n: int) -> Array:
    return rng.standard_normal((d, n))


def walk(rng: np.random.Generator, d: int, n: int) -> Array:
    return np.cumsum(0.03 * rng.standard_normal((d, n)), axis=1)


def markov(rng: np.random.Generator, d: int, n: int) -> Array:
    """A Gauss-Markov process with a correlation time of 1 s and variance 1."""
    phi = np.exp(-1 / RATE)
    start = rng.standard_normal((d, 1))
    return lfilter([np.sqrt(1 - phi**2)], [1, -phi], rng.standard_normal((d, n)), axis=1, zi=phi * start)[0]


def flicker(rng: np.random.Generator, d: int, n: int) -> Array:
    """Noise with density 1/f, from the spectrum of twice the length."""
    f = np.fft.rfftfreq(2 * n)
    f[0] = f[1]
    spectrum = np.fft.rfft(rng.standard_normal((d, 2 * n)), axis=1) / np.sqrt(2 * np.pi * f)
    return np.asarray(np.fft.irfft(spectrum, axis=1)[:, :n])


def heavy(rng: np.random.Generator, d: int, n: int) -> Array:
    return rng.standard_t(5, (d, n)) / np.sqrt(5 / 3)


def filtered(rng: np.random.Generator, d: int, n: int) -> Array:
    """White noise after a low-pass of second order with a resonance."""
    return lfilter([0.4], [1, -0.9, 0.5], rng.standard_normal((d, n + 200)), axis=1)[:, 200:]


INDEPENDENT: dict[str, Make] = {
    "WN": white,
    "GM + WN": lambda rng, d, n: white(rng, d, n) + markov(rng, d, n),
    "RW + WN": lambda rng, d, n: white(rng, d, n) + walk(rng, d, n),
    "WN + flicker": lambda rng, d, n: white(rng, d, n) + 0.2 * flicker(rng, d, n),
    "t with 5 degrees of freedom": heavy,
    "WN, low-pass with resonance": filtered,
    "rounded to 2 standard deviations": lambda rng, d, n: 2 * np.round(white(rng, d, n) / 2),
    "axes of three different kinds": lambda rng, d, n: np.concatenate(
        [white(rng, 1, n), white(rng, 1, n) + markov(rng, 1, n), 100 * (white(rng, 1, n) + walk(rng, 1, n))]
    ),
}
SHARED: dict[str, tuple[Make, Make, float]] = {
    "WN, ρ = 0.05": (white, lambda rng, d, n: np.zeros((d, n)), 0.05),
    "WN, ρ = 0.9": (white, lambda rng, d, n: np.zeros((d, n)), 0.9),
    "GM of ρ = 0.3, own WN": (markov, white, 0.3),
    "RW of ρ = 0.6, own WN": (walk, white, 0.6),
}
"""What is shared, what is not, and the correlation of what is shared."""


def run(reduced: bool = False) -> dict[str, Any]:
    """Rates of false findings, and of findings and coverage where noise is shared."""
    repeats, long = (20, 4) if reduced else (REPEATS, LONG)
    rows = []
    for k, (name, make) in enumerate(INDEPENDENT.items()):
        for n, count in ((10_000, repeats), (100_000, repeats if k < 3 else long)):
            for robust in (False, True) if n == 10_000 and k < 3 else (False,):
                times = count // 4 if robust else count
                rng = np.random.default_rng([SEED, k, n])
                found = [len(_crossed(make(rng, 3, n), robust).shared) > 0 for _ in range(times)]
                rows.append(
                    {"kind": name, "samples": n, "robust": robust, "repeats": times, "false": float(np.mean(found))}
                )
    shared = [_shared_row(k, name, repeats // 2) for k, name in enumerate(SHARED)]
    return {"rows": rows, "shared": shared}


def _crossed(x: Array, robust: bool = False) -> Any:
    return cross(dict(zip(AXES, x, strict=False)), rate=RATE, robust=robust)


def _shared_row(place: int, name: str, repeats: int) -> dict[str, Any]:
    common, own, rho = SHARED[name]
    n = 10_000
    rng = np.random.default_rng([SEED, 100 + place])
    truth = _true(common, own, rho, n)
    hits, covered, total = 0, np.zeros(truth.size), np.zeros(truth.size)
    mixing = np.array([[1.0, 0.0], [rho, np.sqrt(1 - rho**2)]])
    for _ in range(repeats):
        found = _crossed(mixing @ common(rng, 2, n) + own(rng, 2, n))
        hits += bool(found.shared)
        low, high = (limits[AXES[:2]][: truth.size] for limits in (found.lower, found.upper))
        seen = np.isfinite(low)
        covered[seen] += ((low <= truth) & (truth <= high))[seen]
        total += seen
    share = covered[total > 0.9 * repeats] / total[total > 0.9 * repeats]
    return {
        "kind": name, "repeats": repeats, "found": hits / repeats,
        "covered": float(np.mean(share)), "least": float(np.min(share)), "most": float(np.max(share)),
    }  # fmt: skip


def _true(common: Make, own: Make, rho: float, n: int) -> Array:
    """Correlation at each level, from the mean squares of the coefficients of long records."""
    rng = np.random.default_rng([SEED, 999])
    parts = []
    for make in (common, own):
        x = make(rng, 40, 4 * n)
        path = np.cumsum(x, axis=1)
        halves = [1 << k for k in range(11)]
        parts.append([np.mean((path[:, 2 * h :] - 2 * path[:, h:-h] + path[:, : -2 * h]) ** 2) for h in halves])
    shared, alone = np.array(parts)
    return np.asarray(rho * shared / (shared + alone))


def table(result: dict[str, Any]) -> str:
    """Markdown: the two tables."""
    lines = [
        "Three signals of 10 000 or 100 000 samples are simulated in plain NumPy and passed to `gmwm.cross` with its "
        "defaults: the covariance of each signal is estimated from the signal itself. *False* is the share of "
        "recordings of independent signals in which the test at the 5 % level finds shared noise.",
        "",
        "| noise of each axis | samples | estimate | recordings | false |",
        "|---|---|---|---|---|",
        *(
            f"| {r['kind']} | {r['samples']} | {'robust' if r['robust'] else 'classical'} | {r['repeats']} | "
            f"{100 * r['false']:.1f} % |"
            for r in result["rows"]
        ),
        "",
        "Two signals of 10 000 samples each share noise.",
        *legend(
            {
                "found": "share of recordings in which the test finds the shared noise",
                "covered": "share of 95 % intervals that contain the true correlation, mean over the levels",
                "of one level": "smallest and largest of these shares among the levels",
            }
        ),
        "",
        "| shared noise | recordings | found | covered | of one level |",
        "|---|---|---|---|---|",
        *(
            f"| {r['kind']} | {r['repeats']} | {100 * r['found']:.0f} % | {100 * r['covered']:.1f} % | "
            f"{100 * r['least']:.1f} to {100 * r['most']:.1f} % |"
            for r in result["shared"]
        ),
    ]
    return "\n".join(lines)
