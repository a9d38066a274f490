"""Faults of a recording: how often each is found, named and undone, and how often clean noise gets such a remark.

Recordings of a gyroscope are simulated with NumPy alone (`validation/faults.py`), clean ones of seven kinds and faulty
ones of 32. Clean ones are inspected, and faulty ones are calibrated as a user does.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

import gmwm
from gmwm.measuring.inspection import inspect
from gmwm.recording.signals import Imu, Signal
from validation import faults
from validation.legend import legend

NAME = "faults"
SEED = 20261128
SAMPLES = 120_000
N = faults.WHITE / np.sqrt(faults.RATE)

NAMED: dict[str, str] = {
    "clipped": "output-clipped:noise", "clipped_both": "output-clipped:noise", "full_scale": "output-clipped:noise",
    "held_2": "fault-undone:held", "held_4": "fault-undone:held", "held_10": "fault-undone:held",
    "held_coarse": "fault-undone:held", "polled": "fault-undone:held", "lost": "fault-undone:repeated",
    "asleep": "fault-undone:frozen", "dead_start": "fault-undone:dead", "jump": "fault-undone:jumps",
    "jump_white": "fault-undone:jumps", "jumps": "fault-undone:jumps or level-steps:possible", "counter": "output-rounded:counter",
    "counter_exact": "output-rounded:counter", "wrapped": "fault-undone:wrapped",
    "wrapped_rare": "fault-undone:wrapped", "interpolated": "fault-undone:interpolated", "periodic": "trend:swing",
    "student_3": "heavy-tails:fit", "student_2.5": "heavy-tails:fit", "cauchy": "samples-replaced:spikes",
    "outliers_in_quantization": "outliers-found:small", "telegraph": "heavy-tails:levels",
    "moved_end": "recording-moved:moved or samples-replaced:knocks", "cic": "fault-undone:filtered", "cic_coarse": "fault-undone:filtered",
    "resampled": "fault-undone:resampled", "dithered": "lines:known",
}  # fmt: skip
"""The remark that names each fault."""
TRUTH = dict.fromkeys(
    ("clipped", "clipped_both", "full_scale", "lost", "asleep", "dead_start", "jump", "jump_white", "jumps", "wrapped",
     "wrapped_rare", "interpolated", "periodic", "student_3", "student_2.5", "cauchy", "moved_end",
     "dithered", "jumps_in_walk", "cic", "cic_coarse"), 1.0,
) | {"held_2": 2**0.5, "held_4": 2.0, "held_10": 10**0.5, "polled": 1.6**0.5, "resampled": 1.6**0.5} | {
    "outliers_in_quantization": 1.0884}  # fmt: skip
"""True N over that of the white noise at the rate of the log. For other kinds, N depends on the fault. Quantization
noise of three times the white noise is part of N: `filter_numbers` of the true model."""
K = (
    {**dict.fromkeys(TRUTH, faults.WALK * faults.RATE**0.5), "jump_white": 0.0, "jumps": 0.0, "periodic": 0.0}
    | {
        kind: faults.WALK * faults.RATE**0.5 / TRUTH[kind]
        for kind in ("held_2", "held_4", "held_10", "polled", "resampled")
    }
    | {"jumps_in_walk": 3 * faults.WALK * faults.RATE**0.5, "outliers_in_quantization": 2.79e-6}
)
"""True K of the kinds whose N is known."""
FALSE = (
    {code for codes in NAMED.values() for code in codes.split(" or ")} | {"level-steps:clear", "level-steps:possible"}
) - {
    "heavy-tails:fit",
    "samples-replaced:spikes",
    "samples-replaced:knocks",
    "lines:known",
}
"""Remarks that a clean recording should not have."""

Row = dict[str, Any]


def run(reduced: bool = False) -> dict[str, Any]:
    """Remarks on clean and faulty recordings, and N of the faulty ones."""
    clean, faulty = (3, 1) if reduced else (30, 12)
    kinds = ("held_4", "jump_white") if reduced else tuple(faults.FAULTS)
    return {
        "clean_recordings": clean, "recordings": faulty, "samples": SAMPLES, "rate": faults.RATE,
        "clean": [_clean(number, kind, clean) for number, kind in enumerate(faults.CLEAN)],
        "rows": [_faulty(number, kind, faulty) for number, kind in enumerate(kinds)],
    }  # fmt: skip


def _imu(x: faults.Array) -> Imu:
    return Imu({"gyro_x": Signal(x, faults.RATE, "rad/s", axis="gyro_x")})


def _codes(remarks: Any) -> set[str]:
    return {f"{remark.code}:{remark.facts['case']}" if "case" in remark.facts else remark.code for remark in remarks}


def _clean(number: int, kind: str, count: int) -> Row:
    """Share of clean recordings with any remark on a fault, and the remarks."""
    found: list[set[str]] = []
    for seed in range(count):
        x = faults.CLEAN[kind](SAMPLES, np.random.default_rng((SEED, number, seed)))
        found.append(FALSE & _codes(inspect(_imu(x)).remarks))
    names = sorted(set().union(*found))
    return {"kind": kind, "any": float(np.mean([bool(codes) for codes in found])), "remarks": names}


def _faulty(number: int, kind: str, count: int) -> Row:
    """Share of faulty recordings whose fault is named, verdicts of N, and N over the truth where it can be used."""
    named, uses, ratios, covered, held = [], [], [], [], []
    truth = TRUTH.get(kind)
    for seed in range(count):
        x = faults.FAULTS[kind](SAMPLES, np.random.default_rng((SEED, 1000 + number, seed)))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", gmwm.errors.GmwmWarning)
            try:
                calibration = gmwm.calibrate(_imu(x))
            except gmwm.errors.GmwmError:
                named.append(False)
                uses.append("do not use")
                continue
        named.append(not _codes(calibration.remarks).isdisjoint(NAMED.get(kind, "").split(" or ")))
        entry, verdict = calibration.datasheets["gyro_x"]["N"], calibration.number_verdicts["gyro_x"]["N"]
        uses.append(verdict.usability.value)
        walk, use = calibration.datasheets["gyro_x"]["K"], calibration.number_verdicts["gyro_x"]["K"].usability.value
        if kind in K:
            inside = (walk.low or 0.0) <= K[kind] <= (np.inf if walk.high is None else walk.high)
            held.append(
                use == "do not use" or (K[kind] <= (walk.high or np.inf) if use == "use as a bound" else inside)
            )
        if truth is not None and verdict.usability.value != "do not use":
            low = 0.0 if verdict.usability.value == "use as a bound" or entry.low is None else entry.low
            ratios.append(entry.value / N / truth)
            covered.append(low <= truth * N <= (np.inf if entry.high is None else entry.high))
    return {
        "kind": kind, "remark": NAMED.get(kind), "named": float(np.mean(named)) if kind in NAMED else None,
        "use": uses.count("use") / count, "bound": uses.count("use as a bound") / count,
        "n": float(np.median(ratios)) if ratios else None, "covered": float(np.mean(covered)) if covered else None,
        "k": float(np.mean(held)) if held else None,
    }  # fmt: skip


def table(result: dict[str, Any]) -> str:
    """The result as Markdown."""

    def share(value: float | None) -> str:
        return "" if value is None else f"{value:.0%}"

    lines = [
        f"{result['recordings']} recordings with each fault and {result['clean_recordings']} clean ones of each kind "
        f"are simulated in plain NumPy, with {result['samples']} samples at {result['rate']:g} Hz. The table shows how "
        "often the remark names the fault, how often N can be used or is a bound, and the median of N over the truth "
        "and the coverage of its 95 % interval in these recordings. The last column is the share of recordings in "
        "which K is inside its interval or below its bound, or must not be used.",
        "",
        "| fault | remark | named | N used | N bound | N / truth | covered | K right |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        ratio = "" if row["n"] is None else f"{row['n']:.3f}"
        remark = f"`{row['remark']}`" if row["remark"] else ""
        cells = (row["kind"].replace("_", " "), remark, share(row["named"]), share(row["use"]), share(row["bound"]))
        lines.append(f"| {' | '.join((*cells, ratio, share(row['covered']), share(row['k'])))} |")
    lines += ["", "| clean recordings | with a remark on a fault | remarks |", "|---|---|---|"]
    for row in result["clean"]:
        names = ", ".join(f"`{name}`" for name in row["remarks"])
        lines.append(f"| {row['kind'].replace('_', ' ')} | {row['any']:.1%} | {names} |")
    return "\n".join([*lines, "", *legend(
        {"named": "share of recordings with the remark", "N / truth": "median over recordings whose N is not refused"}
    )])  # fmt: skip
