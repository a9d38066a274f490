"""Consistency of filters: coverage of the intervals of claimed over real error.

The noise is simulated in NumPy and SciPy. The true ratio is the claimed error over the root mean square error of all
recordings together.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

import gmwm

NAME = "consistency"
SEED = 20261130
RUNS = 300
SAMPLES, RATE = 9000, 10.0
FILTER = gmwm.Model.parse("WN(sigma2=1) + RW(gamma2=1e-4)")
"""Noise that the filter assumes, per sample."""
KINDS = ("its own noise", "a walk three times as large", "a Gauss-Markov bias of 10 s")

Array = NDArray[np.float64]


def noise(kind: str, rng: np.random.Generator) -> Array:
    """A recording of 15 minutes at rest, with white noise of variance 1 and a slow one."""
    steps = rng.normal(size=SAMPLES)
    if kind == KINDS[2]:
        decay = np.exp(-1 / (10.0 * RATE))
        slow = lfilter([np.sqrt(1 - decay**2)], [1, -decay], 0.3 * steps)
    else:
        slow = np.cumsum((0.03 if kind == KINDS[1] else 0.01) * steps)
    return np.asarray(rng.normal(size=SAMPLES) + slow)


def run(reduced: bool = False) -> dict[str, Any]:
    """The true ratio, the coverage of its interval and the verdicts, for each noise and horizon."""
    rows = []
    for place, kind in enumerate(KINDS):
        errors = []
        for k in range(6 if reduced else RUNS):
            signal = gmwm.Signal(noise(kind, np.random.default_rng([SEED, place, k])), RATE, "rad/s", "gyro_x")
            result = gmwm.monitor.consistency({"gyro_x": FILTER}, {"gyro_x": signal}, filter="model")
            errors.append(result["gyro_x"].errors)
        for horizon, every in zip((error.horizon for error in errors[0]), zip(*errors, strict=True), strict=True):
            truth = every[0].claimed / np.sqrt(np.mean([error.real**2 for error in every]))
            rows.append({
                "noise": kind, "horizon": horizon, "runs": len(every), "ratio": float(truth),
                "covered": float(np.mean([error.low <= truth <= error.high for error in every])),
                "verdicts": {name: float(np.mean([error.verdict == name for error in every]))
                             for name in ("consistent", "overconfident", "cautious", "undecided")},
            })  # fmt: skip
    return {"rows": rows}


def table(result: dict[str, Any]) -> str:
    """Markdown: a line for each noise and horizon."""
    rows = result["rows"]
    shares = [row["covered"] for row in rows]
    wrong = max(row["verdicts"]["overconfident"] for row in rows if row["noise"] == KINDS[0])
    lines = [
        f"`gmwm.monitor.consistency` ran a filter of white noise and a random walk on recordings of 15 min. 95 % "
        f"intervals contain the true ratio of claimed and real error in {min(shares):.0%} to {max(shares):.0%} of "
        f"{rows[0]['runs']} recordings. A filter of the true noise is called overconfident in at most {wrong:.1%}.",
        "",
        f"![Coverage of the intervals for each noise and horizon]({NAME}.svg)",
        "",
        "| noise | horizon (s) | recordings | claimed / real | intervals with the true ratio | consistent | "
        "overconfident | undecided |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        verdicts = row["verdicts"]
        shown = " | ".join(f"{verdicts[name]:.0%}" for name in ("consistent", "overconfident", "undecided"))
        cells = f"{row['runs']} | {row['ratio']:.2f} | {row['covered']:.0%}"
        lines.append(f"| {row['noise']} | {row['horizon']:g} | {cells} | {shown} |")
    return "\n".join(lines)


def draw(result: dict[str, Any], path: Path) -> None:
    """Coverage for each noise and horizon, beside 95 %."""
    from validation.pages import draw_coverage

    draw_coverage(
        [(f"{row['noise']}, {row['horizon']:g} s", row["covered"], row["runs"]) for row in result["rows"]], path
    )
