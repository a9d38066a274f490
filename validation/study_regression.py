"""Regression on conditions: coverage, false findings, and what a poorly known covariate costs.

Series are simulated with NumPy alone: six kinds of noise beside four courses of the temperature. The temperature has no
effect in the first part, so that every finding is false; intervals do not depend on the size of an effect.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

import gmwm

NAME = "regression"
SEED = 20261123
SAMPLES = 1 << 15
BLOCK = 32
"""Block whose means give the covariance matrix of generalised least squares."""

Noise = tuple[float, float, tuple[tuple[float, float], ...], float]
"""Variances of white noise and of a step of the walk, Gauss-Markov processes (correlation time, variance), B² of FN."""
Vector = NDArray[np.float64]
NOISES: dict[str, tuple[str, Noise]] = {
    "WN": ("WN", (1.0, 0.0, (), 0.0)),
    "WN + RW": ("WN + RW", (1.0, 4e-6, (), 0.0)),
    "WN + RW, strong": ("WN + RW", (1.0, 1e-3, (), 0.0)),
    "GM + WN": ("GM + WN", (1.0, 0.0, ((200.0, 0.05),), 0.0)),
    "GM + WN + RW": ("GM + WN + RW", (1.0, 1e-6, ((200.0, 0.05),), 0.0)),
    "WN + FN": ("WN + FN", (1.0, 0.0, (), 1e-3)),
}
COURSES = ("warm-up", "chamber steps", "day cycle", "independent walk")
DEPARTURES = (
    "none", "heavy tails", "gaps", "wrong samples", "steps of 1 °C", "reading noise 0.5 °C", "reading noise 2 °C",
    "readings held for 100 samples", "lag of 1500 samples ignored", "lag of 1500 samples estimated",
)  # fmt: skip
SLOPE = 0.1
"""Effect in the second part (1/°C)."""


def run(reduced: bool = False) -> dict[str, Any]:
    """Coverage and size for each noise and course, and the slope under each departure."""
    rows: list[dict[str, Any]] = []
    count = 4 if reduced else 24
    names, courses = (list(NOISES)[1:2], COURSES[:1]) if reduced else (list(NOISES), COURSES)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for place, name in enumerate(names):
            for turn, course in enumerate(courses):
                rng = np.random.default_rng([SEED, 0, place, turn])
                rows.append({"noise": name, "course": course, **_judged(name, course, count, rng)})
        for place, departure in enumerate(DEPARTURES[:2] if reduced else DEPARTURES):
            rng = np.random.default_rng([SEED, 1, place])
            rows.append({"departure": departure, **_departed(departure, count, rng)})
    return {"samples": SAMPLES, "rows": rows}


def temperature(course: str, rng: np.random.Generator, lag: int = 0) -> Vector:
    """A course of the temperature (°C), `lag` samples before; no lag of chamber steps and walks."""
    t = (np.arange(SAMPLES) - lag) / SAMPLES
    if course == "warm-up":
        return np.asarray(15 * (1 - np.exp(-5 * t)) + 1.5 * np.sin(6 * np.pi * t))
    if course == "chamber steps":
        levels = np.repeat(np.array([20.0, 40.0, 0.0, 60.0, -10.0, 30.0, 50.0, 10.0]), SAMPLES // 8)
        return np.asarray(lfilter([1 / 300], [1, 1 / 300 - 1], levels - 20.0))
    if course == "day cycle":
        return np.asarray(5 * np.sin(4 * np.pi * t + 0.3))
    return np.asarray(0.05 * np.cumsum(rng.normal(size=SAMPLES)))


def drawn(noise: Noise, rng: np.random.Generator, tails: float | None = None) -> Vector:
    """One series of noise; with `tails`, its white noise has Student's t distribution with so many degrees."""
    white, walk, markov, flicker = noise
    own = rng.normal(size=SAMPLES)
    if tails is not None:
        own = rng.standard_t(tails, size=SAMPLES) * np.sqrt((tails - 2) / tails)
    x = np.sqrt(white) * own + np.sqrt(walk) * np.cumsum(rng.normal(size=SAMPLES))
    for time, variance in markov:
        decay = np.exp(-1 / time)
        e = np.sqrt(variance * (1 - decay**2)) * rng.normal(size=SAMPLES)
        e[0] /= np.sqrt(1 - decay**2)
        x = x + lfilter([1.0], [1.0, -decay], e)
    if flicker:
        size = 8 * SAMPLES
        f = np.fft.rfftfreq(size)
        f[0] = np.inf
        z = rng.normal(size=f.size) + 1j * rng.normal(size=f.size)
        x = x + np.fft.irfft(z * np.sqrt(flicker / (2 * np.pi * f) / 2 * size), size)[:SAMPLES]
    return np.asarray(x)


def truth(noise: Noise) -> dict[str, float]:
    """The true parameters by name."""
    white, walk, markov, flicker = noise
    found = {"WN.sigma2": white, "RW.gamma2": walk, "FN.b2": flicker}
    for time, variance in markov:
        found |= {"GM.beta": 1 / time, "GM.sigma2": variance}
    return {name: value for name, value in found.items() if value}


def exact_error(noise: Noise, course: Vector) -> float | None:
    """Standard error of generalised least squares with the covariance matrix of block means; None for flicker noise."""
    white, walk, markov, flicker = noise
    if flicker:
        return None
    lags = np.abs(np.arange(-SAMPLES + 1, SAMPLES))
    k = white * (lags == 0) - walk / 2 * lags
    for time, variance in markov:
        k = k + variance * np.exp(-lags / time)
    triangle = (BLOCK - np.abs(np.arange(-BLOCK + 1, BLOCK))) / BLOCK**2
    means = np.convolve(k, triangle, mode="same")[SAMPLES - 1 :: BLOCK]
    n = SAMPLES // BLOCK
    matrix = means[np.abs(np.subtract.outer(np.arange(n), np.arange(n)))]
    difference = np.diff(np.eye(n), axis=0)
    x = difference @ course.reshape(n, BLOCK).mean(axis=1)
    return float(1 / np.sqrt(x @ np.linalg.solve(difference @ matrix @ difference.T, x)))


def _judged(name: str, course: str, count: int, rng: np.random.Generator) -> dict[str, Any]:
    text, noise = NOISES[name]
    wanted = truth(noise)
    found = []
    for _ in range(count):
        own = temperature(course, rng)
        signal = gmwm.Signal(drawn(noise, rng), 1.0)
        fit = gmwm.fit(text, signal, against={"temperature": own}, weighting="optimal", certify=False)
        assert fit.regression is not None
        one = fit.regression["temperature"]
        low, high = one.interval()
        intervals = fit.confidence_intervals()
        covers = [
            name in intervals and intervals[name][0] <= value <= intervals[name][1] for name, value in wanted.items()
        ]
        exact = exact_error(noise, own) if course == "independent walk" or not found else found[0][3]
        walk = fit.parameters["RW.gamma2"] / noise[1] if noise[1] else np.nan
        found.append(
            (low <= 0 <= high, fit.regression.pvalue, one.value, exact, covers, walk, fit.goodness_of_fit().pvalue)
        )
    exacts = np.array([np.nan if one[3] is None else one[3] for one in found])
    ratio = np.sqrt(np.mean((np.array([one[2] for one in found]) / exacts) ** 2))
    walks = np.array([one[5] for one in found])
    return {
        "series": count,
        "covered": float(np.mean([one[0] for one in found])),
        "false": float(np.mean([one[1] < 0.05 for one in found])),
        "error": None if np.isnan(ratio) else float(ratio),
        "noise_covered": dict(zip(wanted, np.mean([one[4] for one in found], axis=0).tolist(), strict=True)),
        "walk": None if np.isnan(walks).all() else float(np.sqrt(np.median(walks))),
        "rejected": float(np.mean([one[6] < 0.05 for one in found])),
    }


def _departed(departure: str, count: int, rng: np.random.Generator) -> dict[str, Any]:
    text, noise = NOISES["WN + RW"]
    slopes, covered, walks = [], [], []
    for _ in range(count):
        own = temperature("warm-up", rng)
        x = drawn(noise, rng, 3.0 if departure == "heavy tails" else None)
        seen, form, felt = own, "temperature", own
        if departure == "steps of 1 °C":
            seen = np.round(own)
        elif departure.startswith("reading noise"):
            seen = own + float(departure.split()[2]) * rng.normal(size=SAMPLES)
        elif departure.startswith("readings held"):
            seen = np.repeat((own + 0.2 * rng.normal(size=SAMPLES))[::100], 100)[:SAMPLES]
        elif departure.startswith("lag"):
            felt = temperature("warm-up", rng, 1500)
            form = "temperature:lag" if departure.endswith("estimated") else form
        elif departure == "wrong samples":
            x[rng.integers(SAMPLES, size=10)] += 30.0
        y = x + SLOPE * felt
        signal = gmwm.Signal(y, 1.0)
        if departure == "gaps":
            missing = np.zeros(SAMPLES, dtype=bool)
            for first in rng.integers(SAMPLES - 200, size=8):
                missing[first : first + 200] = True
            signal = gmwm.Signal.from_missing(np.where(missing, np.nan, y), 1.0)
            seen = seen[~missing]
        try:
            fit = gmwm.fit(
                text,
                signal,
                against={form: seen},
                weighting="optimal",
                certify=False,
            )
        except gmwm.errors.DataError:
            continue
        assert fit.regression is not None
        one = fit.regression["temperature"]
        low, high = one.interval()
        slopes.append(one.value / SLOPE)
        covered.append(low <= SLOPE <= high)
        walks.append(fit.parameters["RW.gamma2"] / noise[1])
    return {
        "series": count,
        "accepted": len(slopes) / count,
        "slope": float(np.median(slopes)) if slopes else None,
        "covered": float(np.mean(covered)) if slopes else None,
        "walk": float(np.sqrt(np.median(walks))) if slopes else None,
    }


def table(result: dict[str, Any]) -> str:
    """Markdown: coverage and size, and the departures."""
    lines = [
        f"Series of {result['samples']} samples, simulated with NumPy alone, each fitted with `gmwm.fit` and "
        "`against`. The temperature has no effect. Covered: 95 % intervals of the slope that contain zero. False: "
        "F tests with p < 5 %. Error: root mean square error of the slope over the standard error of generalised least "
        "squares with the true covariance matrix. Noise covered: lowest share of 95 % intervals of a noise parameter "
        "that contain the truth. K: median over truth. Rejected: goodness-of-fit tests with p < 5 %.",
        "",
        "| noise | temperature | series | covered | false | error | noise covered | K | rejected |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        if "noise" in row:
            numbers = ["" if row[name] is None else f"{row[name]:.2f}" for name in ("error", "walk")]
            shares = [f"{row[name]:.0%}" for name in ("covered", "false", "rejected")]
            least = f"{min(row['noise_covered'].values()):.0%}"
            cells = (row["noise"], row["course"], row["series"], *shares[:2], numbers[0], least, numbers[1], shares[2])
            lines.append(f"| {' | '.join(map(str, cells))} |")
    lines += [
        "",
        f"WN + RW with a warm-up and a slope of {SLOPE:g} per °C. Accepted: series whose temperature is known at "
        "enough scales. Slope, K: medians over truth. Covered: 95 % intervals of the slope. Wrong samples: ten, 30 "
        "standard deviations away.",
        "",
        "| departure | series | accepted | slope | covered | K |",
        "|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        if "departure" in row:
            cells = [row["departure"], row["series"], f"{row['accepted']:.0%}"]
            cells += ["", "", ""] if row["slope"] is None else [
                f"{row['slope']:.3f}", f"{row['covered']:.0%}", f"{row['walk']:.2f}",
            ]  # fmt: skip
            lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines)
