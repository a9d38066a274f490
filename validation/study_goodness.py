"""Size and power of the goodness-of-fit test.

The recordings of the study of coverage, fitted by the models that they come from, give the size of the test. Recordings
of two Gauss-Markov processes, fitted by one, give its power.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

import gmwm
from validation import recordings
from validation.legend import table_lines

NAME = "goodness"
SEED = recordings.SEED

POWER = "GM(beta=8.0, sigma2=6e-7) + GM(beta=0.15, sigma2={}) + WN(sigma2=2e-6)"
"""Fitted without the slower process, whose variance is 2e-7 / 2, / 4, … in turn."""
WITHOUT = "GM + WN"
DIVISORS = (1, 2, 4, 8, 16, 32)

DRAWS = 99
"""Simulated recordings of a bootstrap: with these, a p-value of a right model is one of 0.01, 0.02, …, alike likely."""


def run(reduced: bool = False) -> dict[str, Any]:
    """Shares of tests with a p-value below 5 % and 1 %, where the model is right and where it lacks a process."""
    count = recordings.count(reduced)
    rows = []
    for text in recordings.truths(reduced):
        structure = gmwm.Model.parse(text).sorted(recordings.RATE).structure
        for weighting in recordings.WEIGHTINGS:
            pvalues = recordings.outcomes(text, weighting, count)[:, -1, 0]
            rows.append(_row("size", "asymptotic", text, structure, weighting, pvalues))
    rows += _bootstrap(reduced) + _power(reduced)
    return {"samples": recordings.SAMPLES, "rate": recordings.RATE, "draws": DRAWS, "rows": rows}


def _bootstrap(reduced: bool) -> list[dict[str, Any]]:
    """Size of the test by simulated recordings."""
    rows = []
    for text in recordings.TRUTHS[:1] if reduced else recordings.TRUTHS[:2]:
        structure = gmwm.Model.parse(text).sorted(recordings.RATE).structure
        drawn = recordings.simulated(text, 5 if reduced else 150, SEED + 100)
        pvalues = np.array(recordings.everywhere(partial(_simulated_pvalue, structure), list(enumerate(drawn))))
        rows.append(_row("size", "bootstrap", text, structure, "diagonal", pvalues))
    return rows


def _power(reduced: bool) -> list[dict[str, Any]]:
    """Rejections of a model that lacks the slower of two Gauss-Markov processes."""
    rows = []
    for divisor in (1, 32) if reduced else DIVISORS:
        text = POWER.format(repr(2e-7 / divisor))
        drawn = recordings.simulated(text, 10 if reduced else 150, SEED + 200)
        for weighting in recordings.WEIGHTINGS[:1] if reduced else recordings.WEIGHTINGS:
            task = partial(_pvalue, WITHOUT, weighting)
            pvalues = np.array(recordings.everywhere(task, drawn))
            rows.append(_row("power", "asymptotic", text, WITHOUT, weighting, pvalues))
    return rows


def _pvalue(structure: str, weighting: str, variance: recordings.Array) -> float:
    return recordings.fitted(structure, variance, weighting).goodness_of_fit().pvalue


def _simulated_pvalue(structure: str, numbered: tuple[int, recordings.Array]) -> float:
    """By a bootstrap whose seed is the number of the recording: chance must not be the same in all of them."""
    seed, variance = numbered
    fit = recordings.fitted(structure, variance, "diagonal")
    return fit.goodness_of_fit(method="bootstrap", draws=DRAWS, rng=seed).pvalue


def _row(kind: str, method: str, truth: str, fitted: str, weighting: str, pvalues: recordings.Array) -> dict[str, Any]:
    return {
        "kind": kind,
        "method": method,
        "truth": truth,
        "fitted": fitted,
        "weighting": weighting,
        "recordings": int(pvalues.size),
        "at_5": float(np.mean(pvalues <= 0.05)),
        "at_1": float(np.mean(pvalues <= 0.01)),
        "median": float(np.median(pvalues)),
    }


def table(result: dict[str, Any]) -> str:
    """Markdown: the size of the test, then its power."""
    size = [r for r in result["rows"] if r["kind"] == "size"]
    power = [r for r in result["rows"] if r["kind"] == "power"]
    lines = [
        f"Recordings of {result['samples']} samples at {result['rate']:g} Hz are "
        "simulated. The fitted model is correct, so a test at the 5 % level should reject "
        "5 % of the recordings. The asymptotic test excludes the two coarsest levels. The bootstrap, with "
        f"{result['draws']} simulated recordings for each test, uses all levels.",
        "",
        *table_lines(
            "| model | method | weighting | recordings | rejected at 5 % | at 1 % | median p-value |",
            "| {fitted} | {method} | {weighting} | {recordings} | {at_5:.1%} | {at_1:.1%} | {median:.2f} |",
            size,
        ),
        "",
        f"The fitted model omits the slower Gauss-Markov process: {WITHOUT} is fitted to "
        "recordings of two such processes. If the slower process is too weak to be "
        "detected, a test at the 5 % level rejects as often as for a correct model.",
        "",
        *table_lines(
            "| truth | weighting | recordings | rejected at 5 % | at 1 % |",
            "| {truth} | {weighting} | {recordings} | {at_5:.1%} | {at_1:.1%} |",
            power,
        ),
    ]
    return "\n".join(lines)
