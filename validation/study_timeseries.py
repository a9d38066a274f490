"""Coverage of 95 % intervals of autoregressive and moving-average models.

Recordings of known models are simulated, measured and fitted from nothing but the model's name.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

import gmwm
from gmwm.fitting.estimation.simulated_curves import simulated_variances
from gmwm.measuring.covariance import Design
from validation import recordings
from validation.legend import legend, table_lines

NAME = "timeseries"
SEED = 20261129
RATE = 1.0
SAMPLES = 20_000
TRUTHS = (
    "AR(2, phi1=1.4, phi2=-0.6, sigma2=1.0)",
    "ARMA(2, 1, phi1=0.9, phi2=-0.3, theta1=0.5, sigma2=1.0)",
    "MA(2, theta1=0.6, theta2=0.3, sigma2=1.0)",
    "SARMA(1, 0, 1, 0, 12, phi1=0.5, sphi1=0.6, sigma2=1.0)",
    "AR1(phi=-0.7, sigma2=1.0) + WN(sigma2=1.0)",
)


def outcome(structure: str, weighting: str, variance: recordings.Array) -> recordings.Array:
    """(5, p) estimates, standard errors, ends of the intervals at 95 %, and p-value of one recording."""
    return recordings.outcome(structure, weighting, variance, samples=SAMPLES, rate=RATE)


def run(reduced: bool = False) -> dict[str, Any]:
    """Share of intervals that contain the true value, and the spread of estimates beside the standard errors."""
    count, truths = (20, TRUTHS[:1]) if reduced else (500, TRUTHS)
    design = Design(np.arange(1, SAMPLES.bit_length()), samples=SAMPLES, rate=RATE)
    rows = []
    for number, text in enumerate(truths):
        model = gmwm.Model.parse(text).sorted(RATE)
        drawn = simulated_variances(model, design, count, SEED + number)
        # The usual weights are "optimal" where a process has several parameters of its shape.
        for weighting in ("optimal",) if number else ("optimal", "diagonal"):
            found = np.array(recordings.everywhere(partial(outcome, model.structure, weighting), drawn))
            rejected = float(np.mean(found[:, 4, 0] <= 0.05))
            for k, (name, truth) in enumerate(model.parameters.items()):
                assert truth is not None
                estimate, error, low, high, _ = found[:, :, k].T
                rows.append({
                    "model": model.structure, "weighting": weighting, "parameter": name, "truth": truth,
                    "covered": float(np.mean((low <= truth) & (truth <= high))),
                    "below": float(np.mean(high < truth)), "above": float(np.mean(low > truth)),
                    "median": float(np.median(estimate)), "spread": float(estimate.std(ddof=1)),
                    "standard_error": float(np.median(error[np.isfinite(error)])), "rejected": rejected,
                })  # fmt: skip
    return {"recordings": count, "samples": SAMPLES, "rate": RATE, "rows": rows}


def table(result: dict[str, Any]) -> str:
    """Markdown: one line for each parameter of each model and weighting."""
    noise = 100 * np.sqrt(0.95 * 0.05 / result["recordings"])
    covered = [row["covered"] for row in result["rows"]]
    lines = [
        f"{result['recordings']} recordings of {result['samples']} samples at {result['rate']:g} Hz are simulated "
        "from each model and fitted without starting values. The 95 % intervals are asymptotic, and their coverage is "
        f"{min(covered):.1%} to {max(covered):.1%}.",
        *legend(
            {
                "covered": (f"share of intervals that contain the true value, with a standard error of {noise:.1f} %"),
                "low, high": "share of intervals that lie completely below or above the true value",
                "rejected": "share of goodness-of-fit tests that reject the model at the 5 % level",
            }
        ),
        "",
        *table_lines(
            "| model | weights | parameter | truth | covered | low | high | median | spread | standard error "
            "| rejected |",
            "| {model} | {weighting} | {parameter} | {truth:g} | {covered:.1%} | {below:.1%} | {above:.1%} "
            "| {median:.4f} | {spread:.4f} | {standard_error:.4f} | {rejected:.1%} |",
            result["rows"],
        ),
    ]
    return "\n".join(lines)
