"""Coverage of 95 % confidence intervals.

Recordings of known models are simulated and fitted, with diagonal and with optimal weights; for each parameter, the
share of intervals that contain the true value, and the standard errors that the fits report beside the spread of the
estimates.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import gmwm
from validation import recordings
from validation.legend import legend, table_lines

NAME = "coverage"
SEED = recordings.SEED


def run(reduced: bool = False) -> dict[str, Any]:
    """Share of intervals that contain the true value, lie below it and above it; estimates and standard errors /
    truth."""
    count = recordings.count(reduced)
    rows = []
    for text in recordings.truths(reduced):
        model = gmwm.Model.parse(text).sorted(recordings.RATE)
        for weighting in recordings.WEIGHTINGS:
            found = recordings.outcomes(text, weighting, count)
            for k, (name, truth) in enumerate(model.parameters.items()):
                assert truth is not None
                estimate, error, low, high, _ = found[:, :, k].T
                reported = error[np.isfinite(error)]
                rows.append({
                    "model": model.structure,
                    "weighting": weighting,
                    "parameter": name,
                    "truth": truth,
                    "covered": float(np.mean((low <= truth) & (truth <= high))),
                    "below": float(np.mean(high < truth)),
                    "above": float(np.mean(low > truth)),
                    "one_sided": float(np.mean((low <= 0) | ~np.isfinite(high))),
                    "mean": float(estimate.mean() / truth),
                    "median": float(np.median(estimate) / truth),
                    "spread": float(estimate.std(ddof=1) / truth),
                    "standard_error": float(np.median(reported) / truth),
                })  # fmt: skip
    return {"recordings": count, "samples": recordings.SAMPLES, "rate": recordings.RATE, "rows": rows}


def table(result: dict[str, Any]) -> str:
    """Markdown: one line for each parameter of each model and weighting."""
    noise = 100 * np.sqrt(0.95 * 0.05 / result["recordings"])
    worst = min(r["covered"] for r in result["rows"]), max(r["covered"] for r in result["rows"])
    lines = [
        f"{result['recordings']} recordings of {result['samples']} samples at {result['rate']:g} Hz are simulated "
        "from each model and fitted with both weightings. The 95 % intervals are asymptotic, and their coverage is "
        f"{worst[0]:.1%} to {worst[1]:.1%}.",
        *legend(
            {
                "covered": (f"share of intervals that contain the true value, with a standard error of {noise:.1f} %"),
                "low, high": "share of intervals that lie completely below or above the true value",
                "median, spread": "median and standard deviation of the estimates, divided by the true value",
                "standard error": "median of the reported standard errors, divided by the true value",
            }
        ),
        "",
        *table_lines(
            "| model | weighting | parameter | truth | covered | low | high | median | spread | standard error |",
            "| {model} | {weighting} | {parameter} | {truth:g} | {covered:.1%} | {below:.1%} | {above:.1%} "
            "| {median:.4f} | {spread:.4f} | {standard_error:.4f} |",
            result["rows"],
        ),
    ]
    return "\n".join(lines)
