"""Trends of the mean: how often noise is taken for a trend, and how often a warm-up is found.

Recordings of 33 minutes are simulated with NumPy alone: white noise, random walks, Gauss-Markov processes and flicker
noise of many strengths, with and without a warm-up a·e^(−t/τ). Each is inspected as a user's file is.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import gmwm
from gmwm.recording.signals import Imu, Signal
from validation.legend import legend, table_lines

NAME = "trends"
SEED = 20261206

DURATION, RATE = 1980.0, 14.0
SAMPLES = int(DURATION * RATE)
HOUR = np.radians(1.0) / 3600
"""deg/h in rad/s."""

# N (deg/√h), K (deg/h/√h), Gauss-Markov processes (T_c in s, standard deviation in deg/h), B of flicker noise (deg/h).
Noise = tuple[float, float, tuple[tuple[float, float], ...], float]
NULLS: dict[str, Noise] = {
    "WN": (0.2, 0.0, (), 0.0),
    "WN + weak RW": (0.2, 2.0, (), 0.0),
    "WN + RW": (0.2, 10.0, (), 0.0),
    "WN + RW, moderate": (0.2, 30.0, (), 0.0),
    "WN + RW, strong": (0.2, 100.0, (), 0.0),
    "RW": (0.0, 100.0, (), 0.0),
    "WN + FN, weak": (0.2, 0.0, (), 5.0),
    "WN + FN": (0.2, 0.0, (), 30.0),
    "WN + FN, strong": (0.2, 0.0, (), 200.0),
    "WN + FN + RW": (0.2, 20.0, (), 20.0),
    "GM 5 s + WN": (0.27, 0.0, ((5.0, 29.0),), 0.0),
    "GM 20 s + WN + RW": (0.2, 5.0, ((20.0, 20.0),), 0.0),
    "GM 100 s + WN + RW": (0.15, 5.0, ((100.0, 10.0),), 0.0),
    "GM 300 s + WN": (0.2, 0.0, ((300.0, 15.0),), 0.0),
    "GM 1500 s + WN": (0.2, 0.0, ((1500.0, 30.0),), 0.0),
    "2 GM + WN + RW": (0.2, 10.0, ((5.0, 20.0), (100.0, 20.0)), 0.0),
}
"""Noise without a trend."""
FOUND: tuple[str, ...] = (
    "WN", "WN + RW", "WN + RW, moderate", "GM 5 s + WN", "GM 100 s + WN + RW", "GM 300 s + WN", "2 GM + WN + RW",
)  # fmt: skip
"""Noise to which warm-ups are added."""
WARM_UPS = ((206.0, 600.0), (103.0, 600.0), (52.0, 600.0), (206.0, 200.0), (103.0, 200.0))
"""Sizes (deg/h) and time constants (s)."""


def run(reduced: bool = False) -> dict[str, Any]:
    """Share of recordings with a remark on a trend: of noise alone, and with warm-ups of several sizes."""
    rows: list[dict[str, Any]] = []
    count = 4 if reduced else 300
    for place, (name, noise) in enumerate(list(NULLS.items())[:2] if reduced else NULLS.items()):
        rng = np.random.default_rng([SEED, 0, place])
        found = [inspected(drawn(noise, rng)) for _ in range(count)]
        rows.append({"noise": name, "size": 0.0, "tau": None, **shares(found, noise[1])})
    count = 4 if reduced else 60
    for place, name in enumerate(FOUND[:1] if reduced else FOUND):
        for turn, (size, tau) in enumerate(WARM_UPS[:1] if reduced else WARM_UPS):
            rng = np.random.default_rng([SEED, 1, place, turn])
            course = size * HOUR * np.exp(-np.arange(SAMPLES) / RATE / tau)
            found = [inspected(drawn(NULLS[name], rng) + course) for _ in range(count)]
            rows.append({"noise": name, "size": size, "tau": tau, **shares(found, NULLS[name][1])})
    worst = max((row["found"] for row in rows if not row["size"]), default=0.0)
    return {"duration": DURATION, "rate": RATE, "false": worst, "rows": rows}


def drawn(noise: Noise, rng: np.random.Generator) -> NDArray[np.float64]:
    """One recording of noise (rad/s)."""
    white, walk, markov, flicker = noise
    x = rng.normal(size=SAMPLES) * white * 60 * np.sqrt(RATE)
    x += np.cumsum(rng.normal(size=SAMPLES)) * walk / 60 / np.sqrt(RATE)
    for time, sd in markov:
        x += _markov(np.exp(-1 / (time * RATE)), rng) * sd
    if flicker:
        # The two-sided spectral density is B²/(2π|f|); eight times the length, so that no period is seen.
        size = 8 * SAMPLES
        f = np.fft.rfftfreq(size, 1 / RATE)
        f[0] = np.inf
        z = rng.normal(size=f.size) + 1j * rng.normal(size=f.size)
        x += np.fft.irfft(z * np.sqrt(flicker**2 / (2 * np.pi * f) / 2 * size * RATE), size)[:SAMPLES]
    return np.asarray(x * HOUR)


def _markov(decay: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """A Gauss-Markov process of variance 1, by doubling steps: x_t = Σ decay^k e_{t−k}."""
    x = rng.normal(size=SAMPLES) * np.sqrt(1 - decay**2)
    x[0] /= np.sqrt(1 - decay**2)
    step, power = 1, decay
    while step < SAMPLES and power > 1e-12:
        x[step:] = x[step:] + power * x[:-step]
        step, power = 2 * step, power**2
    return x


def inspected(x: NDArray[np.float64]) -> tuple[str, float, float, float, float]:
    """Code of the remark on a trend, or ""; size (deg/h), τ (s), and K with the trend and its limit (deg/h/√h)."""
    found = gmwm.inspect(Imu({"gyro_x": Signal(x, RATE, "rad/s", "gyro_x")}))
    codes = [r.code for r in found.remarks if r.code in ("warm-up", "trend", "linear-trend")]
    if not codes:
        return "", np.nan, np.nan, np.nan, np.nan
    (trend,) = found.trends
    tau = np.nan if trend.tau is None else trend.tau
    return codes[0], trend.size / HOUR, tau, trend.walk_with_trend / HOUR * 60, trend.walk_limit / HOUR * 60


def shares(found: list[tuple[str, float, float, float, float]], walk: float) -> dict[str, Any]:
    """Shares of the remarks, and medians over the recordings with a warm-up."""
    codes = np.array([one[0] for one in found])
    numbers = np.array([one[1:] for one in found])[codes == "warm-up"]
    middle = [float(x) for x in np.median(numbers, axis=0)] if len(numbers) else [None] * 4
    return {
        "recordings": len(found),
        "found": float(np.mean(codes != "")),
        "warm_up": float(np.mean(codes == "warm-up")),
        "walk": walk,
        "median_size": middle[0],
        "median_tau": middle[1],
        "walk_with": middle[2],
        "walk_limit": middle[3],
        "covered": float(np.mean(numbers[:, 3] >= walk)) if len(numbers) else None,
    }


def table(result: dict[str, Any]) -> str:
    """Markdown: false alarms for each noise, and detections for each noise and warm-up."""
    nulls = [row for row in result["rows"] if not row["size"]]
    power = [row for row in result["rows"] if row["size"]]
    lines = [
        f"Recordings of {result['duration'] / 60:.0f} min at {result['rate']:g} Hz are inspected with `gmwm.inspect`. "
        "*Found* is the share of recordings with a remark on a trend (`warm-up`, `trend` or `linear-trend`).",
        "",
        (f"The first table is for noise without a trend. The largest share is {result['false']:.1%}."),
        "",
        *table_lines(
            "| noise | K (deg/h/√h) | recordings | found | `warm-up` |",
            "| {noise} | {walk:g} | {recordings} | {found:.1%} | {warm_up:.1%} |",
            nulls,
        ),
        "",
        "The second table is for noise with a warm-up a·e^(−t/τ). The medians and the "
        "coverage include the recordings with the remark `warm-up`.",
        *legend(
            {
                "K with": "K fitted to the means without a term for the warm-up",
                "limit": "95 % upper limit of K with a term for the warm-up",
                "holds": "share of these limits that are not below the true K",
            }
        ),
        "",
        "| noise | a (deg/h) | τ (s) | found | `warm-up` | median a | median τ | K true | K with | limit | holds |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for r in power:
        medians = ("", "", "", "", "")
        if r["median_size"] is not None:
            medians = (
                f"{r['median_size']:.0f}", f"{r['median_tau']:.0f}", f"{r['walk_with']:.0f}", f"{r['walk_limit']:.1f}",
                f"{r['covered']:.0%}",
            )  # fmt: skip
        lines.append(
            f"| {r['noise']} | {r['size']:g} | {r['tau']:g} | {r['found']:.0%} | {r['warm_up']:.0%} | {medians[0]} | "
            f"{medians[1]} | {r['walk']:g} | {medians[2]} | {medians[3]} | {medians[4]} |"
        )
    return "\n".join(lines)
