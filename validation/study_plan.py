"""Standard errors of gmwm.plan compared with simulated fits.

Recordings of known models are simulated in three lengths and fitted; the scatter of estimate / truth is put beside the
relative standard error that gmwm.plan gives, without a simulation, for the same length.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import gmwm
from gmwm.base.arrays import Vector
from gmwm.fitting.estimation.simulated_curves import simulated_variances
from gmwm.measuring.covariance import Design
from validation.legend import legend

NAME = "plan"
SEED = 20270118
RATE = 100.0

TRUTHS = (
    "WN(sigma2=4e-6) + RW(gamma2=1e-10)",
    "GM(beta=0.5, sigma2=2e-7) + WN(sigma2=4e-6)",
    "GM(beta=8.0, sigma2=1e-6) + WN(sigma2=4e-6) + RW(gamma2=4e-10)",
)
SAMPLES = (10_000, 100_000, 400_000)
NORMAL = (0.158655, 0.841345)
"""Quantiles of a normal distribution one standard deviation to either side."""


def run(reduced: bool = False) -> dict[str, Any]:
    """The planned relative error of each parameter, and the scatter found, plain and by quantiles."""
    recordings = 60 if reduced else 1000
    lengths = SAMPLES[1:2] if reduced else SAMPLES
    rows = []
    for m, text in enumerate(TRUTHS):
        truth = gmwm.Model.parse(text)
        planned = gmwm.plan(truth, duration=max(lengths) / RATE, rate=RATE)
        for samples in lengths:
            # Neither the length nor the model of another row moves the seed of this one.
            seed = SEED + 10 * m + SAMPLES.index(samples)
            fits = fitted(truth, samples, recordings, seed)
            errors = planned.at(samples / RATE)
            for name, ratio in fits.items():
                low, median, high = np.quantile(ratio, (NORMAL[0], 0.5, NORMAL[1]))
                found = float(high - low) / 2
                rows.append({
                    "model": truth.structure,
                    "parameter": name,
                    "samples": samples,
                    "plan": errors[name],
                    "quantiles": found,
                    "standard_deviation": float(ratio.std(ddof=1)),
                    "median": float(median),
                    "quantiles_over_plan": found / errors[name],
                    "standard_deviation_over_plan": float(ratio.std(ddof=1)) / errors[name],
                })  # fmt: skip
    return {"recordings": recordings, "rate": RATE, "truths": list(TRUTHS), "rows": rows}


def fitted(truth: gmwm.Model, samples: int, recordings: int, seed: int) -> dict[str, Vector]:
    """Estimate / truth of each parameter in many recordings."""
    levels = samples.bit_length() - 1
    design = Design(np.arange(1, levels + 1), samples, RATE)
    measured = simulated_variances(truth, design, recordings, seed)
    fits = [
        gmwm.fit(truth.structure, gmwm.WaveletVariance.from_values(row, samples, RATE), certify=False)
        for row in measured
    ]
    return {
        name: np.array([fit.parameters[name] for fit in fits]) / value
        for name, value in truth.parameters.items()
        if value is not None
    }


def table(result: dict[str, Any]) -> str:
    """Markdown: one line for each parameter of each model and length."""
    seen = [row for row in result["rows"] if row["plan"] <= 0.3]
    worst = max(abs(row["quantiles_over_plan"] - 1) for row in seen)
    models = "; ".join(f"`{text}`" for text in result["truths"])
    lines = [
        f"{result['recordings']} recordings of each length at {result['rate']:g} Hz are simulated and fitted with "
        f"diagonal weighting, from these models: {models}. If the planned standard error is at most 30 %, the "
        f"simulated one (*quantiles*) differs from it by at most {100 * worst:.0f} %. Above 30 %, estimates are "
        "skewed and sometimes zero, and a standard error is of little use.",
        *legend(
            {
                "plan": "relative standard error from the exact covariance, without a simulation",
                "quantiles": ("half the distance between the 15.87 % and the 84.13 % quantile of estimate / truth"),
                "standard deviation": "standard deviation of estimate / truth",
            }
        ),
        "",
        "| model | parameter | samples | plan | quantiles | standard deviation | quantiles / plan | median |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {r['model']} | {r['parameter']} | {r['samples']} | {_percent(r['plan'])} | {_percent(r['quantiles'])} "
        f"| {_percent(r['standard_deviation'])} | {r['quantiles_over_plan']:.2f} | {r['median']:.3f} |"
        for r in result["rows"]
    ]
    return "\n".join(lines)


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"
