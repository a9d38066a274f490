"""Test whether two recordings have the same noise: its size and its power, by simulators in plain NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np

from gmwm.applications.several import same
from validation.study_cross import INDEPENDENT, RATE, Array, Make, walk, white

NAME = "same"
SEED = 20261124
REPEATS = 1000
LONG = 200
"""Repeats with 10^5 samples; the first three kinds of noise have `REPEATS`."""


def _louder(rng: np.random.Generator, d: int, n: int) -> Array:
    return 1.05 * white(rng, d, n)


def _wandering(rng: np.random.Generator, d: int, n: int) -> Array:
    return white(rng, d, n) + np.sqrt(2) * walk(rng, d, n)


OTHER: dict[str, tuple[str, Make]] = {
    "WN, 5 % higher deviation": ("WN", _louder),
    "RW of twice the variance, same WN": ("RW + WN", _wandering),
}
"""What the second recording is, and what the first one is."""


def run(reduced: bool = False) -> dict[str, Any]:
    """Rates at which the same noise, and different noise, seem to differ."""
    repeats, long = (20, 4) if reduced else (REPEATS, LONG)
    rows = []
    for k, (name, make) in enumerate(INDEPENDENT.items()):
        if name == "axes of three different kinds":
            continue
        most = repeats if k < 3 else long
        for lengths, count in (((10_000, 10_000), repeats), ((10_000, 3_000), repeats), ((100_000, 100_000), most)):
            rng = np.random.default_rng([SEED, k, *lengths])
            found = [_differ(make(rng, 1, lengths[0]), make(rng, 1, lengths[1])) for _ in range(count)]
            rows.append({"kind": name, "samples": lengths, "repeats": count, "false": float(np.mean(found))})
    power = []
    for k, (name, (first, make)) in enumerate(OTHER.items()):
        rng = np.random.default_rng([SEED, 100 + k])
        found = [_differ(INDEPENDENT[first](rng, 1, 10_000), make(rng, 1, 10_000)) for _ in range(repeats // 4)]
        power.append({"kind": name, "repeats": repeats // 4, "found": float(np.mean(found))})
    return {"rows": rows, "power": power}


def _differ(x: Array, y: Array) -> bool:
    return same(x[0], y[0], rate=RATE).differs


def table(result: dict[str, Any]) -> str:
    """Markdown: the two tables."""
    lines = [
        "Two recordings of the same noise are simulated in plain NumPy and compared by `gmwm.same` with its defaults. "
        "*False* is the share of pairs in which the test at the 5 % level finds a difference.",
        "",
        "| noise | samples | pairs | false |",
        "|---|---|---|---|",
        *(
            f"| {r['kind']} | {r['samples'][0]} and {r['samples'][1]} | {r['repeats']} | {100 * r['false']:.1f} % |"
            for r in result["rows"]
        ),
        "",
        "These pairs of recordings of 10 000 samples differ. *Found* is the share of "
        "pairs in which the test finds the difference.",
        "",
        "| difference | pairs | found |",
        "|---|---|---|",
        *(f"| {r['kind']} | {r['repeats']} | {100 * r['found']:.0f} % |" for r in result["power"]),
    ]
    return "\n".join(lines)
