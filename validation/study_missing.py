"""Regression with gaps: errors and coverage of a trend, a season and a step with missing days.

Ten years of daily values, of which 18 % are missing in gaps that a Markov chain makes; white noise and flicker noise by
a fractional difference. The smallest possible errors are those of generalised least squares with the true covariance.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

import gmwm

NAME = "missing"
SEED = 20261201
RUNS = 60
DAYS = 3650
LOST, BACK = 0.01, 0.0456
"""Probabilities that a gap begins and that it ends on a day: 18 % are missing, 22 days a gap."""
LONG = 4 * DAYS
"""Days of flicker noise before and in the series."""

Array = NDArray[np.float64]


def columns() -> dict[str, Array]:
    """A velocity per year, a yearly season and a step."""
    t = np.arange(DAYS)
    turn = 2 * np.pi * t / 365.25
    return {"velocity": t / 365.25, "cosine": np.cos(turn), "sine": np.sin(turn), "step": 1.0 * (t >= 2000)}


TRUTH = {"velocity": 3.0, "cosine": 1.0, "sine": 2.0, "step": 8.0}
WEIGHTS = np.cumprod(np.r_[1.0, (np.arange(1, LONG) - 0.5) / np.arange(1, LONG)])
"""Weights of half an integration (Kasdin 1995)."""


def missing(rng: np.random.Generator) -> NDArray[np.bool_]:
    """Whether each day is missing."""
    draws, gap, days = rng.random(DAYS), False, []
    for draw in draws.tolist():
        gap = draw >= BACK if gap else draw < LOST
        days.append(gap)
    return np.array(days)


def noise(rng: np.random.Generator) -> Array:
    """White noise of 2 mm and flicker noise."""
    spectrum = np.fft.rfft(WEIGHTS, 2 * LONG) * np.fft.rfft(rng.normal(size=LONG), 2 * LONG)
    return np.asarray(2 * rng.normal(size=DAYS) + np.fft.irfft(spectrum, 2 * LONG)[LONG - DAYS : LONG])


def covariance() -> Array:
    """Covariance matrix of `noise`."""
    rows = np.array([np.sum(WEIGHTS[: LONG - DAYS] * WEIGHTS[k : LONG - DAYS + k]) for k in range(DAYS)])
    lag = np.abs(np.subtract.outer(np.arange(DAYS), np.arange(DAYS)))
    return np.asarray(rows[lag] + 4.0 * np.eye(DAYS))


def run(reduced: bool = False) -> dict[str, Any]:
    """Errors over the smallest possible ones, and coverage, of each coefficient."""
    sigma, x = covariance(), columns()
    errors, best, covered = [], [], []
    for k in range(2 if reduced else RUNS):
        rng = np.random.default_rng([SEED, k])
        here = ~missing(rng)
        series = sum(TRUTH[name] * column for name, column in x.items()) + noise(rng)
        signal = gmwm.Signal.from_missing(np.where(here, series, np.nan), 1.0)
        fit = gmwm.fit("WN + FN", signal, against={f"{name}:exact": column[here] for name, column in x.items()})
        entries = list(fit.regression.values())
        errors.append([entry.value - true for entry, true in zip(entries, TRUTH.values(), strict=True)])
        covered.append([low <= true <= high for (low, high), true in zip(
            (entry.interval() for entry in entries), TRUTH.values(), strict=True)])  # fmt: skip
        if k < 5:  # the errors hardly depend on the gaps
            design = np.column_stack([np.ones(here.sum()), *(column[here] for column in x.values())])
            inverse = cho_solve(cho_factor(sigma[np.ix_(here, here)]), design)
            best.append(np.sqrt(np.diag(np.linalg.inv(design.T @ inverse)))[1:])
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / np.mean(best, axis=0)
    shares = np.mean(covered, axis=0)
    return {"rows": [
        {"coefficient": name, "runs": len(errors), "ratio": float(ratio[k]), "covered": float(shares[k])}
        for k, name in enumerate(TRUTH)
    ]}  # fmt: skip


def table(result: dict[str, Any]) -> str:
    """Markdown: a line for each coefficient."""
    rows = result["rows"]
    ratios, shares = [row["ratio"] for row in rows], [row["covered"] for row in rows]
    lines = [
        f'`gmwm.fit("WN + FN", x, against=…)` was applied to {rows[0]["runs"]} series of ten years with 18 % of the '
        f"days missing. The errors are {min(ratios):.2f} to {max(ratios):.2f} times those of generalised least squares "
        f"with the true covariance. 95 % intervals contain the true value in {min(shares):.0%} to {max(shares):.0%}.",
        "",
        f"![Coverage of the intervals of each coefficient]({NAME}.svg)",
        "",
        "| coefficient | series | error / smallest possible | intervals with the true value |",
        "|---|---|---|---|",
        *(f"| {row['coefficient']} | {row['runs']} | {row['ratio']:.2f} | {row['covered']:.0%} |" for row in rows),
    ]
    return "\n".join(lines)


def draw(result: dict[str, Any], path: Path) -> None:
    """Coverage of each coefficient, beside 95 %."""
    from validation.pages import draw_coverage

    draw_coverage([(row["coefficient"], row["covered"], row["runs"]) for row in result["rows"]], path)
