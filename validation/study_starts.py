"""Random starting values of the paper compared with the convex method.

The paper's Appendix A fits 3*GM to 100 … 10⁶ samples from starting values that are exact, or the best of 1 000, 10 000
and 20 000 draws. Here, for recordings of a known 3*GM, classical and robust, under the paper's Ω = diag((upper −
lower)⁻²), the objective that each start leads to over that of the convex route, which is the proven optimum. How long
each takes is in `python -m benchmarks --only starts`.
"""

from __future__ import annotations

import warnings
from functools import partial
from typing import Any

import numpy as np

import gmwm
from validation import recordings

NAME = "starts"
SEED = 20261128
RATE = 100.0
TRUTH = "GM(beta=20.0, sigma2=1e-6) + GM(beta=1.0, sigma2=1e-6) + GM(beta=0.05, sigma2=1e-6)"
LENGTHS = (100, 1_000, 10_000, 100_000, 1_000_000)
DRAWS = (1_000, 10_000, 20_000)
REACHED = 1e-6
"""An objective within this share of the optimum has reached it."""

Task = tuple[int, int, bool]


def outcome(draws: tuple[int, ...], task: Task) -> list[float]:
    """Objectives over that of the convex route: from the exact values, then from each number of draws."""
    number, samples, robust = task
    rng = np.random.default_rng([SEED, number, samples])
    truth = gmwm.Model.parse(TRUTH)
    wv = gmwm.wavelet_variance(truth.simulate(samples, RATE, rng), RATE, robust=robust)
    omega = (wv.upper - wv.lower) ** -2.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gmwm.errors.FitWarning)
        best = gmwm.fit(truth.structure, wv, weighting=omega)
        # Where there are as many parameters as levels the fit may be perfect, but for rounding.
        floor = 1e-9 * len(wv)
        starts = [gmwm.fit(truth, wv, weighting=omega)]
        starts += [
            gmwm.fit(truth.structure, wv, weighting=omega, certify=False, start=gmwm.estimation.Sampled(g, number))
            for g in draws
        ]
    return [max(fit.objective, floor) / max(best.objective, floor) for fit in starts]


def run(reduced: bool = False) -> dict[str, Any]:
    """For each length and start: how often it reaches the optimum, and the median and worst ratio of objectives."""
    count, lengths, draws = (5, LENGTHS[:2], DRAWS[:1]) if reduced else (100, LENGTHS, DRAWS)
    tasks = [(k, n, robust) for robust in (False, True) for n in lengths[robust:] for k in range(count)]
    found = recordings.everywhere(partial(outcome, draws), tasks)
    rows = []
    for robust in (False, True):
        for n in lengths[robust:]:
            ratios = np.array(
                [r for r, (_, m, is_robust) in zip(found, tasks, strict=True) if (m, is_robust) == (n, robust)]
            )
            for column, start in enumerate(("exact values", *(f"{g} draws" for g in draws))):
                rows.append({
                    "samples": n, "robust": robust, "start": start,
                    "reached": float(np.mean(ratios[:, column] <= 1 + REACHED)),
                    "median": float(np.median(ratios[:, column])),
                    "worst": float(ratios[:, column].max()),
                    "least": float(ratios[:, column].min()),
                })  # fmt: skip
    return {"recordings": count, "model": TRUTH, "rate": RATE, "rows": rows}


def table(result: dict[str, Any]) -> str:
    """Markdown: one line for each length and start."""
    least = min(row["least"] for row in result["rows"])
    lines = [
        f"{result['recordings']} recordings of {result['model']} at {result['rate']:g} Hz are simulated for each "
        "length, and fitted with the diagonal weights of the paper. The table has the objective divided by the "
        "objective of the convex method, which needs no starting values. *Reached* is the share of recordings with a "
        f"ratio of at most 1 + 1e-6. The smallest ratio minus 1 is {least - 1:+.1e}.",
        "",
        "| variance | samples | start | reached | median | worst |",
        "|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {'robust' if r['robust'] else 'classical'} | {r['samples']} | {r['start']} | {r['reached']:.0%} "
        f"| {r['median']:.6f} | {r['worst']:.4g} |"
        for r in result["rows"]
    ]
    return "\n".join(lines)
