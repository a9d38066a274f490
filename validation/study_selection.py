"""Model selection: how often the true model is recommended.

Recordings of known models are simulated, and every model within a general one is ranked on each.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

import gmwm
from gmwm.choosing.selection.structure import structure_of, within
from gmwm.fitting.estimation.simulated_curves import simulated_variances
from gmwm.measuring.covariance import Design
from validation import recordings
from validation.legend import legend

NAME = "selection"
SEED = 20261203
SAMPLES = 200_000
RATE = 100.0
GENERAL = "4*GM + WN + QN + RW + DR"

TRUTHS = (
    "WN(sigma2=4e-6) + RW(gamma2=1e-10)",
    "GM(beta=0.5, sigma2=2e-7) + WN(sigma2=4e-6)",
    "GM(beta=20.0, sigma2=2e-6) + GM(beta=1.0, sigma2=6e-7) + WN(sigma2=2e-6) + RW(gamma2=1e-9)",
)
"""Models of which no term can be left out without the loss rising by 30 or more, on average."""


def run(reduced: bool = False) -> dict[str, Any]:
    """What was recommended, and what was in the equivalent set, for each truth and weighting."""
    count, draws = (4, 100) if reduced else (200, 500)
    design = Design(np.arange(1, SAMPLES.bit_length()), samples=SAMPLES, rate=RATE)
    rows = []
    for place, text in enumerate(TRUTHS[:2] if reduced else TRUTHS):
        truth = gmwm.Model.parse(text).sorted(RATE)
        drawn = simulated_variances(truth, design, count, SEED + place)
        for weighting in ("optimal",) if reduced else ("optimal", "diagonal"):
            chosen = recordings.everywhere(partial(_selected, weighting, draws, truth.structure), list(drawn))
            recommended = [c["recommended"] for c in chosen]
            rows.append({
                "model": truth.structure,
                "weighting": weighting,
                "recommended": float(np.mean([r == truth.structure for r in recommended])),
                "least": float(np.mean([c["least"] == truth.structure for c in chosen])),
                "in_set": float(np.mean([c["in_set"] for c in chosen])),
                "set_size": float(np.median([c["size"] for c in chosen])),
                "largest_set": max(c["size"] for c in chosen),
                "under": float(np.mean([c["under"] for c in chosen])),
                "over": float(np.mean([c["over"] for c in chosen])),
                "others": {r: recommended.count(r) for r in sorted(set(recommended)) if r != truth.structure},
            })  # fmt: skip
    return {"recordings": count, "samples": SAMPLES, "rate": RATE, "general": GENERAL, "draws": draws, "rows": rows}


def _selected(weighting: str, draws: int, truth: str, variance: recordings.Array) -> dict[str, Any]:
    """What comes out for one recording."""
    wv = gmwm.WaveletVariance.from_values(variance, samples=SAMPLES, rate=RATE)
    ranking = gmwm.select(GENERAL, wv, weighting=weighting, draws=draws)  # type: ignore[arg-type]
    wanted = structure_of(gmwm.Model.parse(truth))
    chosen = structure_of(ranking.recommended.model)
    return {
        "recommended": ranking.recommended.structure,
        "least": ranking.best.structure,
        "in_set": any(structure_of(c.model) == wanted for c in ranking.equivalent),
        "size": len(ranking.equivalent),
        "under": chosen != wanted and within(chosen, wanted),
        "over": chosen != wanted and within(wanted, chosen),
    }


def table(result: dict[str, Any]) -> str:
    """Markdown: one line for each truth and weighting."""
    lines = [
        f"{result['recordings']} recordings of {result['samples']} samples at {result['rate']:g} Hz are simulated "
        f"from each model. gmwm ranks every model within {result['general']}, with {result['draws']} draws.",
        *legend(
            {
                "recommended": "share of recordings in which the true model is recommended",
                "least criterion": "share of recordings in which the true model has the smallest criterion",
                "in the set": "share of recordings in which the true model is among the equivalent models",
                "under": (
                    "share of recordings in which the recommended model lacks a term of the true model and has "
                    "no other term"
                ),
                "over": "share of recordings in which the recommended model has all terms of the true model and more",
            }
        ),
        "",
        "| truth | weighting | recommended | least criterion | in the set | median size of the set | largest | under "
        "| over | recommended instead |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for r in result["rows"]:
        others = ", ".join(f"`{name}` ({times})" for name, times in r["others"].items())
        lines.append(
            f"| {r['model']} | {r['weighting']} | {r['recommended']:.1%} | {r['least']:.1%} | {r['in_set']:.1%} "
            f"| {r['set_size']:g} | {r['largest_set']} | {r['under']:.1%} | {r['over']:.1%} | {others} |"
        )
    return "\n".join(lines)
