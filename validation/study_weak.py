"""Intervals and upper limits of a weak or absent random walk or drift.

Recordings are simulated with ever weaker random walks and drifts, and fitted with diagonal and with optimal weights:
the share of estimates that are zero, the share of intervals that begin at zero, and how often the truth lies within.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

import gmwm
from gmwm.fitting.estimation.asymptotic import sandwich_of
from gmwm.fitting.estimation.reweighting import implied_weights
from gmwm.measuring.covariance import covariance
from validation import recordings
from validation.legend import legend

NAME = "weak"
SEED = 20261202

LADDERS: tuple[tuple[str, str, tuple[float, ...]], ...] = (
    (
        "WN(sigma2=4e-6) + RW(gamma2={})",
        "RW.gamma2",
        (9.1e-12, 2.4e-12, 5.9e-13, 1.8e-13, 5.6e-14, 2.0e-14, 1.1e-14, 0.0),
    ),
    (
        "GM(beta=0.5, sigma2=2e-7) + WN(sigma2=4e-6) + RW(gamma2={})",
        "RW.gamma2",
        (1.3e-9, 9.3e-11, 1.6e-11, 4.1e-12, 1.2e-12, 4.2e-13, 2.3e-13, 0.0),
    ),
    (
        "DR(omega={}) + WN(sigma2=4e-6) + RW(gamma2=5e-11)",
        "DR.omega",
        (2.0e-7, 1.4e-7, 1.0e-7, 7.7e-8, 5.7e-8, 4.2e-8, 3.4e-8, 0.0),
    ),
)
"""Model, parameter, and its values: γ² or ω² with relative errors of 0.25, 0.35, 0.5, 0.7, 1, 1.5, 2 and infinity."""


def run(reduced: bool = False) -> dict[str, Any]:
    """Shares of estimates that are zero, of one-sided intervals, and of intervals that contain the true value; upper
    limits."""
    count = 12 if reduced else 150
    rows = []
    for place, (pattern, name, values) in enumerate(LADDERS):
        for value in (values[2], values[5]) if reduced else values:
            text = pattern.format(repr(value))
            structure = gmwm.Model.parse(text).sorted(recordings.RATE).structure
            drawn = recordings.simulated(text, count, SEED + place)
            for weighting in recordings.WEIGHTINGS[:1] if reduced else recordings.WEIGHTINGS:
                task = partial(limits, structure, weighting, name)
                estimate, low, high = np.array(recordings.everywhere(task, drawn)).T
                rows.append({
                    "model": structure,
                    "weighting": weighting,
                    "parameter": name,
                    "truth": value,
                    "relative_error": relative_error(text, name, weighting),
                    **shares(value, estimate, low, high),
                })  # fmt: skip
    return {"recordings": count, "samples": recordings.SAMPLES, "rate": recordings.RATE, "rows": rows}


def limits(structure: str, weighting: str, name: str, variance: recordings.Array) -> tuple[float, float, float]:
    """Estimate of one parameter from one recording, and the ends of its interval."""
    fit = recordings.fitted(structure, variance, weighting)
    return fit.parameters[name], *fit.confidence_intervals()[name]


def shares(
    truth: float, estimate: recordings.Array, low: recordings.Array, high: recordings.Array
) -> dict[str, float | None]:
    """What the intervals of many recordings come to; None where it has no meaning."""
    one_sided = low <= 0
    return {
        "zero": float(np.mean(estimate == 0)),
        "one_sided": float(np.mean(one_sided)),
        "covered": float(np.mean((low <= truth) & (truth <= high))),
        "limit_covers": float(np.mean(truth <= high)),
        "limit_covers_one_sided": float(np.mean(truth <= high[one_sided])) if np.any(one_sided) else None,
        "median_limit": float(np.median(high)),
        "unlimited": float(np.mean(np.isinf(high))),
    }


def relative_error(text: str, name: str, weighting: str) -> float | None:
    """Standard error of the variance, or of the square of the drift, over its value; None where that is zero."""
    model, design = gmwm.Model.parse(text).sorted(recordings.RATE), recordings.design()
    value = model.parameters[name]
    if not value:
        return None
    matrix = implied_weights(weighting, model, design)
    error = sandwich_of(model, design, matrix, covariance(model, design)).errors[name] / value
    return error if name.endswith("2") else 2 * error


def table(result: dict[str, Any]) -> str:
    """Markdown: one line for each value of each model and weighting."""
    lines = [
        f"{result['recordings']} recordings of {result['samples']} samples at "
        f"{result['rate']:g} Hz are simulated for each true value.",
        *legend(
            {
                "relative error": "theoretical standard error of γ² or ω², divided by its value",
                "one-sided": (
                    "share of intervals that extend from zero to a one-sided 95 % upper limit; the others are two-sided"
                ),
                "covered": "share of intervals that contain the true value, in all recordings",
                "limit holds": (
                    "share of intervals whose upper end is not below the true value, in all "
                    "recordings and among the one-sided intervals"
                ),
            }
        ),
        "",
        "| model | weighting | truth | relative error | zero | one-sided | covered | limit holds "
        "| of the one-sided | median limit | limit / truth |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for r in result["rows"]:
        error = "∞" if r["relative_error"] is None else f"{r['relative_error']:.2f}"
        alone = "" if r["limit_covers_one_sided"] is None else f"{r['limit_covers_one_sided']:.1%}"
        over = f"{r['median_limit'] / r['truth']:.1f}" if r["truth"] else ""
        lines.append(
            f"| {r['model']} | {r['weighting']} | {r['parameter']} = {r['truth']:g} | {error} | {r['zero']:.1%} "
            f"| {r['one_sided']:.1%} | {r['covered']:.1%} | {r['limit_covers']:.1%} | {alone} "
            f"| {r['median_limit']:.2g} | {over} |"
        )
    return "\n".join(lines)
