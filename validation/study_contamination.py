"""Effect of 1 % outliers on classical and robust fits.

Recordings of a Gauss-Markov gyroscope with white noise are simulated, spoilt in three ways, and fitted. An estimate is
called recovered where it lies within the central 95 % of those that the same estimator gives on clean recordings.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import gmwm
from validation.legend import table_lines

NAME = "contamination"
SEED = 20261123
RATE = 100.0
SAMPLES = 20_000
TRUTH = gmwm.Model.parse("GM(beta=2.0, sigma2=1e-6) + WN(sigma2=4e-6)").sorted(RATE)
SIZE = 50 * 2e-3
"""Of what is added: fifty standard deviations of the white noise (rad/s)."""

Spoil = Callable[[NDArray[np.float64], np.random.Generator], NDArray[np.float64]]


def knocks(x: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """1 % of the time in knocks of a second: the unit rings, and is where it was when it stops."""
    length = round(RATE)
    seconds = x.size // length
    spoilt = x.copy()
    for start in length * rng.choice(seconds, seconds // 100, replace=False):
        ring = SIZE * np.exp(-np.arange(length) / (0.25 * length)) * rng.standard_normal(length)
        spoilt[start : start + length] += ring - ring.mean()
    return spoilt


def wrong_angles(x: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """A wrong reading of the angle: two neighbouring rates are wrong by as much, up and down. 1 % of the samples."""
    spoilt = x.copy()
    first = 2 * rng.choice(x.size // 2, x.size // 200, replace=False)
    error = SIZE * rng.choice([-1.0, 1.0], first.size)
    spoilt[first] += error
    spoilt[first + 1] -= error
    return spoilt


def spikes(x: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """1 % of the samples, each by itself, wrong up or down: white noise to all but the first four levels."""
    spoilt = x.copy()
    places = rng.choice(x.size, x.size // 100, replace=False)
    spoilt[places] += SIZE * rng.choice([-1.0, 1.0], places.size)
    return spoilt


SPOILS: dict[str, Spoil] = {
    "knocks": knocks,
    "wrong angles": wrong_angles,
    "single spikes": spikes,
}
ESTIMATORS: dict[str, dict[str, Any]] = {
    "classical": {},
    "robust, efficiency 0.6": {"robust": True, "efficiency": 0.6},
    "robust, efficiency 0.9": {"robust": True, "efficiency": 0.9},
}


def run(reduced: bool = False) -> dict[str, Any]:
    """For each estimator and kind of outliers: median of estimate / truth, and the share of estimates recovered."""
    clean, spoilt = (60, 15) if reduced else (200, 100)
    seeds = np.random.SeedSequence(SEED).spawn(1 + len(SPOILS))
    rows = []
    for estimator, options in ESTIMATORS.items():
        reference = _ratios(seeds[0], clean, None, options)
        low, high = np.quantile(reference, [0.025, 0.975], axis=0)
        for (kind, spoil), seed in zip(SPOILS.items(), seeds[1:], strict=True):
            ratios = _ratios(seed, spoilt, spoil, options)
            inside = (low <= ratios) & (ratios <= high)
            rows += [
                {
                    "estimator": estimator,
                    "outliers": kind,
                    "parameter": name,
                    "low": float(low[k]),
                    "high": float(high[k]),
                    "median": float(np.median(ratios[:, k])),
                    "recovered": float(inside[:, k].mean()),
                    "all_recovered": float(inside.all(axis=1).mean()),
                }
                for k, name in enumerate(TRUTH.parameters)
            ]
    return {"clean": clean, "spoilt": spoilt, "samples": SAMPLES, "rate": RATE, "model": str(TRUTH), "rows": rows}


def _ratios(
    seed: np.random.SeedSequence, recordings: int, spoil: Spoil | None, options: dict[str, Any]
) -> NDArray[np.float64]:
    """Estimate / truth, one row for each recording."""
    rows = []
    for child in seed.spawn(recordings):
        rng = np.random.default_rng(child)
        x = TRUTH.simulate(SAMPLES, RATE, rng)
        fit = gmwm.fit(TRUTH.structure, x if spoil is None else spoil(x, rng), RATE, certify=False, **options)
        rows.append([fit.parameters[name] for name in TRUTH.parameters])
    truth = [value for value in TRUTH.parameters.values() if value is not None]
    return np.array(rows) / np.array(truth)


def table(result: dict[str, Any]) -> str:
    """Markdown: one line for each estimator, kind of outliers and parameter."""
    lines = [
        f"{result['spoilt']} recordings of {result['samples']} samples at {result['rate']:g} Hz are simulated from "
        f"{result['model']}. Outliers of fifty standard deviations of the white noise are added to 1 % of the "
        "samples. An estimate is *recovered* if it is within the central 95 % of the estimates of the same estimator "
        f"from {result['clean']} clean recordings. A single spike affects 2^j coefficients of level j, so an "
        "estimator that works level by level cannot recover.",
        "",
        *table_lines(
            "| estimator | outliers | parameter | clean: estimate / truth | with outliers: median | recovered "
            "| all three |",
            "| {estimator} | {outliers} | {parameter} | {low:.3f} … {high:.3f} | {median:.3f} | {recovered:.0%} "
            "| {all_recovered:.0%} |",
            result["rows"],
        ),
    ]
    return "\n".join(lines)
