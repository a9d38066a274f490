"""Bias and standard deviation of the estimates.

Recordings of known models are simulated and fitted; for each parameter, the mean and the spread of estimate / truth.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import gmwm
from validation.legend import table_lines

NAME = "recovery"
SEED = 20261122
RATE = 100.0

TRUTHS = (
    "WN(sigma2=4e-6) + RW(gamma2=1e-11)",
    "GM(beta=0.5, sigma2=2e-7) + WN(sigma2=4e-6)",
    "QN(q2=1e-6) + WN(sigma2=1e-6) + RW(gamma2=1e-11)",
    "GM(beta=10.0, sigma2=1e-6) + GM(beta=0.2, sigma2=3e-7) + WN(sigma2=1e-6)",
    "DR(omega=2e-8) + WN(sigma2=4e-6) + RW(gamma2=1e-12)",
    "AR1(phi=-0.5, sigma2=1e-6) + RW(gamma2=1e-11)",
)


def run(reduced: bool = False) -> dict[str, Any]:
    """Mean, standard deviation and bias in standard errors of estimate / truth, parameter by parameter."""
    recordings = 30 if reduced else 500
    samples = 100_000
    rows = []
    for text, sequence in zip(TRUTHS, np.random.SeedSequence(SEED).spawn(len(TRUTHS)), strict=True):
        truth = gmwm.Model.parse(text).sorted(RATE)
        paths = (np.random.default_rng(s) for s in sequence.spawn(recordings))
        fits = [gmwm.fit(truth.structure, truth.simulate(samples, RATE, rng), RATE, certify=False) for rng in paths]
        for name, value in truth.parameters.items():
            assert value is not None
            ratio = np.array([fit.parameters[name] for fit in fits]) / value
            error = float(ratio.std(ddof=1))
            rows.append({
                "model": truth.structure,
                "parameter": name,
                "truth": value,
                "mean": float(ratio.mean()),
                "median": float(np.median(ratio)),
                "spread": error,
                "bias_in_standard_errors": float((ratio.mean() - 1) / (error / np.sqrt(recordings))),
            })  # fmt: skip
    return {"recordings": recordings, "samples": samples, "rate": RATE, "rows": rows}


def table(result: dict[str, Any]) -> str:
    """Markdown: one line for each parameter of each model."""
    lines = [
        f"{result['recordings']} recordings of {result['samples']} samples at {result['rate']:g} Hz of each model are "
        "fitted with diagonal weighting, iterated until the weights match the estimate. The estimates of random walks "
        "and small decay rates have a skewed distribution, so their median and mean differ. The table has the "
        "estimates divided by the true value.",
        "",
        *table_lines(
            "| model | parameter | truth | mean | median | standard deviation | bias in its standard errors |",
            "| {model} | {parameter} | {truth:g} | {mean:.4f} | {median:.4f} | {spread:.4f} "
            "| {bias_in_standard_errors:+.1f} |",
            result["rows"],
        ),
    ]
    return "\n".join(lines)
