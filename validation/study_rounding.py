"""Coarse outputs: what rounding does to white noise and to slow changes of the mean, and whether it is noticed.

White noise of standard deviation σ around a mean that wanders slowly is rounded to steps of several sizes. The mean
lies at the middle of a step, at a quarter, or at its edge.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import gmwm
from gmwm.recording.signals import Imu, Signal
from validation.legend import legend

NAME = "rounding"
SEED = 20261207

RATIOS = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0)
"""Steps in standard deviations of the noise."""
OFFSETS = (0.0, 0.25, 0.5)
"""Distances of the mean from the middle of a step, in steps."""
WANDER = 0.15
"""Amplitude of the slow change of the mean, in standard deviations of the noise."""
BLOCKS, LENGTH = 200, 4000


def run(reduced: bool = False) -> dict[str, Any]:
    """Noise and slow change of the output over those of the sensor, and the estimate of the noise before rounding."""
    blocks = 20 if reduced else BLOCKS
    rows = []
    for ratio in RATIOS[:2] if reduced else RATIOS:
        for offset in OFFSETS[:1] if reduced else OFFSETS:
            rng = np.random.default_rng([SEED, int(10 * ratio), int(100 * offset)])
            slow = np.repeat(WANDER / ratio * np.sin(2 * np.pi * np.arange(blocks) / 20), LENGTH)
            y = np.round(rng.normal(size=slow.size) / ratio + slow + offset)
            means, truth = y.reshape(blocks, -1).mean(axis=1), slow[::LENGTH]
            found = gmwm.inspect(Imu({"gyro_x": Signal(y * 1e-3, 100.0, "rad/s", "gyro_x")}))
            axis = found.axes["gyro_x"]
            codes = [r.code for r in found.remarks if r.code in ("coarse-output", "output-rounded")]
            white = float(np.mean(np.var(y.reshape(blocks, -1), axis=1)))
            rows.append({
                "ratio": ratio,
                "offset": offset,
                "noise": float(np.sqrt(white) * ratio),
                "sheppard": float(np.sqrt(white / (1 / ratio**2 + 1 / 12))),
                "gain": float(np.cov(means, truth)[0, 1] / np.var(truth, ddof=1)),
                "estimate": None if axis.before_rounding is None else axis.before_rounding / 1e-3 * ratio,
                "remark": codes[0] if codes else "",
            })  # fmt: skip
    return {"samples": blocks * LENGTH, "wander": WANDER, "rows": rows}


def table(result: dict[str, Any]) -> str:
    """Markdown: one line for each step and place of the mean."""
    lines = [
        f"The study rounds {result['samples']} samples to multiples of the LSB. The samples are white noise with the "
        f"standard deviation σ, and a slow change of the mean with an amplitude of {result['wander']:g} σ.",
        *legend(
            {
                "N / σ, N / √(σ² + LSB²/12)": (
                    "standard deviation of the output, divided by the standard deviation of the "
                    "noise, and by √(σ² + LSB²/12)"
                ),
                "slow change": "slow change of the output, divided by the slow change of the sensor",
                "estimate": (
                    "noise before rounding that `gmwm.inspect` finds, divided by σ; from 6 σ on it "
                    "may be an upper limit"
                ),
            }
        ),
        "",
        "| LSB/σ | mean | N / σ | N / √(σ² + LSB²/12) | slow change | estimate | remark |",
        "|---|---|---|---|---|---|---|",
    ]
    names = {0.0: "middle", 0.25: "a quarter", 0.5: "edge"}
    for r in result["rows"]:
        estimate = "" if r["estimate"] is None else f"{r['estimate']:.2f}"
        remark = f"`{r['remark']}`" if r["remark"] else ""
        lines.append(
            f"| {r['ratio']:g} | {names[r['offset']]} | {r['noise']:.3f} | {r['sheppard']:.3f} | {r['gain']:.2f} | "
            f"{estimate} | {remark} |"
        )
    return "\n".join(lines)
