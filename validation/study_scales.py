"""Virtual sensors over a range of scales: predicted and achieved noise in other recordings.

The arrays are those of the study of virtual sensors: four units with white noise and walks that they share in part.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gmwm.applications.several import fuse
from validation.study_fusion import exact, simulated

NAME = "scales"
SEED = 20261202
RUNS = 300
UNITS = 4
HORIZONS: tuple[tuple[str, float | tuple[float, float]], ...] = (
    ("2 s", 2.0), ("4096 s", 4096.0), ("2 to 4096 s", (2.0, 4096.0)),
)  # fmt: skip
"""Scales at which the weights minimise the variance."""


def run(reduced: bool = False) -> dict[str, Any]:
    """Achieved over predicted variance at all scales, and the mean squared inverse gain from 2 to 4096 s."""
    rows = []
    for name, horizon in HORIZONS:
        weights, predicted = [], []
        for k in range(6 if reduced else RUNS):
            virtual = fuse(simulated(np.random.default_rng([SEED, k]), UNITS), 1.0, horizon=horizon)["gyro_x"]
            weights.append(virtual.weights)
            predicted.append(virtual.variance)
        tau = np.asarray(virtual.tau)
        gamma = exact(UNITS, tau)
        achieved = np.einsum("ka,jab,kb->kj", np.array(weights), gamma, np.array(weights))
        average = gamma.sum(axis=(1, 2)) / UNITS**2
        inside = (tau >= 2) & (tau <= 4096)
        goal = achieved[:, inside] / average[inside]
        rows.append({
            "horizon": name, "runs": len(weights), "tau": tau.tolist(),
            "ratio": (achieved.mean(axis=0) / np.mean(predicted, axis=0)).tolist(),
            "over_average": np.sqrt(achieved.mean(axis=0) / average).tolist(), "goal": float(goal.mean()),
            "best": _best(gamma[inside], average[inside]),
        })  # fmt: skip
    return {"rows": rows}


def _best(gamma: Any, average: Any) -> float:
    """Smallest mean of the squared inverse gain that static weights reach, from the true matrices."""
    total = np.mean(gamma / average[:, None, None], axis=0)
    return float(1 / np.linalg.inv(total).sum())


def table(result: dict[str, Any]) -> str:
    """Markdown: a line for each choice of scales."""
    rows = result["rows"]
    ratios = [ratio for row in rows for ratio in row["ratio"][:12]]
    last = rows[-1]
    lines = [
        f"`gmwm.fuse(…, horizon=(2.0, 4096.0))` was applied to {last['runs']} recordings of an array of four units. Up "
        f"to 4096 s, the variance in other recordings is {min(ratios):.2f} to {max(ratios):.2f} times the predicted "
        f"one. The mean of 1/gain² from 2 to 4096 s is {last['goal'] / last['best']:.2f} times the smallest possible "
        f"one; with the weights for {rows[0]['horizon']} alone it is {rows[0]['goal'] / last['best']:.2f}, and for "
        f"{rows[1]['horizon']} alone {rows[1]['goal'] / last['best']:.2f} times.",
        "",
        f"![Deviation of the virtual sensor, divided by the deviation of the average, at each scale]({NAME}.svg)",
        "",
        "| weights for | recordings | achieved / predicted variance | mean of 1/gain², 2 to 4096 s | over the best |",
        "|---|---|---|---|---|",
    ]
    for row in rows:
        lines.append(
            f"| {row['horizon']} | {row['runs']} | {min(row['ratio'][:12]):.2f} to {max(row['ratio'][:12]):.2f} | "
            f"{row['goal']:.2f} | {row['goal'] / row['best']:.2f} |"
        )
    return "\n".join(lines)


def draw(result: dict[str, Any], path: Path) -> None:
    """Deviation of each virtual sensor over that of the average of the units, in other recordings."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.5, 2.8), layout="constrained")
    axes = figure.subplots()
    for row in result["rows"]:
        axes.semilogx(row["tau"], row["over_average"], marker="o", markersize=3, label=f"weights for {row['horizon']}")
    axes.axhline(1.0, color="black", linewidth=0.8)
    axes.set_xlabel("scale (s)")
    axes.set_ylabel("deviation / average")
    axes.legend()
    with mpl.rc_context({"svg.hashsalt": path.stem, "svg.fonttype": "none"}):
        figure.savefig(path, metadata={"Date": None})
