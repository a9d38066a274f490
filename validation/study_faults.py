"""Faults of a recording: how often each is found, named and undone, and how often clean noise gets such a remark.

Recordings of a gyroscope are simulated with NumPy alone (`validation/faults.py`), clean ones of nine kinds and faulty
ones of 35. Clean ones are inspected, and faulty ones are calibrated as a user does.
"""

from __future__ import annotations

import json
import os
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

import gmwm
from gmwm.measuring.inspection import inspect
from gmwm.measuring.outliers.cleaning import cleaned
from gmwm.recording.signals import Imu, Signal
from validation import faults
from validation.legend import legend

NAME = "faults"
SEED = 20261128
SAMPLES = 120_000
RECORDINGS = 100
"""Number of recordings of each kind."""
N = faults.WHITE / np.sqrt(faults.RATE)

NAMED: dict[str, str] = {
    "clipped": "output-clipped:noise", "clipped_both": "output-clipped:noise", "full_scale": "output-clipped:noise",
    "held_2": "fault-undone:held", "held_4": "fault-undone:held", "held_10": "fault-undone:held",
    "held_coarse": "fault-undone:held", "polled": "fault-undone:held", "lost": "fault-undone:repeated",
    "asleep": "fault-undone:frozen", "dead_start": "fault-undone:dead", "jump": "fault-undone:jumps",
    "jump_white": "fault-undone:jumps", "jumps": "fault-undone:jumps or level-steps:clear or level-steps:possible",
    "counter": "output-rounded:counter", "counter_exact": "output-rounded:counter", "wrapped": "fault-undone:wrapped",
    "wrapped_rare": "fault-undone:wrapped", "interpolated": "fault-undone:interpolated", "periodic": "trend:swing",
    "student_3": "heavy-tails:fit", "student_2.5": "heavy-tails:fit", "cauchy": "samples-replaced:spikes",
    "outliers_in_quantization": "outliers-found:small", "telegraph": "heavy-tails:levels",
    "moved_end": "recording-moved:moved or samples-replaced:knocks",
    "cic": "fault-undone:filtered", "cic_coarse": "fault-undone:filtered",
    "resampled": "fault-undone:resampled", "dithered": "lines:known", "pulses": "samples-replaced:knocks",
    "states": "samples-replaced:knocks", "second_warm_up": "level-steps:settles or level-steps:possible",
}  # fmt: skip
"""The remark that names each fault."""
TRUTH = dict.fromkeys(
    ("clipped", "clipped_both", "full_scale", "lost", "asleep", "dead_start", "jump", "jump_white", "jumps", "wrapped",
     "wrapped_rare", "interpolated", "periodic", "student_3", "student_2.5", "cauchy", "moved_end",
     "dithered", "pulses", "states", "second_warm_up", "none", "jumps_in_walk", "cic", "cic_coarse"), 1.0,
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
STATED = 15.0
"""Stated size of several jumps and of a second warm-up: what they reduce −2 log L by at their true times, less the
price of the search for these (`faults.visibility`). Below, a random walk describes the recording nearly as well."""

Row = dict[str, Any]


def run(reduced: bool = False) -> dict[str, Any]:
    """Remarks on clean and faulty recordings, and N of the faulty ones. The file that FAULTS_RECORDINGS names keeps the
    finished recordings."""
    count = 2 if reduced else RECORDINGS
    kinds = ("held_4", "jump_white") if reduced else tuple(faults.FAULTS)
    store = Store()
    return {
        "recordings": count, "samples": SAMPLES, "rate": faults.RATE,
        "clean": [_clean(kind, [store.recording(kind, seed) for seed in range(count)]) for kind in faults.CLEAN],
        "rows": [_faulty(kind, [store.recording(kind, seed) for seed in range(count)]) for kind in kinds],
    }  # fmt: skip


class Store:
    """The results of single recordings, which the file named by FAULTS_RECORDINGS keeps, if there is one."""

    def __init__(self) -> None:
        self._path = Path(os.environ.get("FAULTS_RECORDINGS", os.devnull))
        lines = self._path.read_text().splitlines() if self._path.exists() else []
        self._finished: dict[tuple[str, int], Row] = {(row["kind"], row["seed"]): row for row in map(json.loads, lines)}

    def recording(self, kind: str, seed: int) -> Row:
        """The result of one recording of a kind."""
        if (kind, seed) not in self._finished:
            row = {"kind": kind, "seed": seed} | _result(kind, seed)
            with self._path.open("a") as file:
                file.write(json.dumps(row) + "\n")
            self._finished[kind, seed] = row
        return self._finished[kind, seed]


def _imu(x: faults.Array) -> Imu:
    return Imu({"gyro_x": Signal(x, faults.RATE, "rad/s", axis="gyro_x")})


def _rng(kind: str, seed: int) -> faults.Rng:
    return np.random.default_rng((SEED, 1000 + list(faults.FAULTS).index(kind), seed))


def _codes(remarks: Any) -> set[str]:
    return {f"{remark.code}:{remark.facts['case']}" if "case" in remark.facts else remark.code for remark in remarks}


def _result(kind: str, seed: int) -> Row:
    """The remarks on one recording, and N and K of a faulty one: verdict, value, and ends of the interval."""
    if kind in faults.CLEAN:
        number = list(faults.CLEAN).index(kind)
        x = faults.CLEAN[kind](SAMPLES, np.random.default_rng((SEED, number, seed)))
        replaced = {"samples-replaced:knocks"} if len(cleaned(_imu(x)["gyro_x"]).knocks) else set()
        return {"remarks": sorted(FALSE & _codes(inspect(_imu(x)).remarks) | replaced)}
    x = faults.FAULTS[kind](SAMPLES, _rng(kind, seed))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gmwm.errors.GmwmWarning)
        try:
            calibration = gmwm.calibrate(_imu(x))
        except gmwm.errors.GmwmError:
            return {"remarks": [], "N": None, "K": None}
    entries, verdicts = calibration.datasheets["gyro_x"], calibration.number_verdicts["gyro_x"]
    numbers = {
        symbol: [verdicts[symbol].usability.value, entries[symbol].value, entries[symbol].low, entries[symbol].high]
        for symbol in ("N", "K")
    }
    return {"remarks": sorted(_codes(calibration.remarks))} | numbers


def _clean(kind: str, recordings: list[Row]) -> Row:
    """Share of clean recordings with any remark on a fault, and the remarks."""
    names = Counter(name for row in recordings for name in row["remarks"])
    return {"kind": kind, "any": float(np.mean([bool(row["remarks"]) for row in recordings])), "remarks": dict(names)}


def _covers(number: list[Any], truth: float) -> bool:
    """Whether the interval of a number, or its bound, holds the truth; None has no end."""
    usability, _, low, high = number
    return bool(
        (usability == "use as a bound" or (low or 0.0) <= truth) and truth <= (np.inf if high is None else high)
    )


def _faulty(kind: str, recordings: list[Row]) -> Row:
    """Share of faulty recordings whose fault is named, verdicts of N, and N over the truth where it can be used."""
    names, truth = NAMED.get(kind, "").split(" or "), TRUTH.get(kind)
    measured = [row for row in recordings if row["N"] is not None]
    uses = [row["N"][0] for row in measured]
    used = [row["N"] for row in measured if row["N"][0] != "do not use"] if truth is not None else []
    ratios = [number[1] / N / (truth or 1.0) for number in used]
    exact = [abs(ratio - 1) <= 0.02 for ratio, number in zip(ratios, used, strict=True) if number[0] == "use"]
    held = [row["K"][0] == "do not use" or _covers(row["K"], K[kind]) for row in measured if kind in K]

    def mean(values: list[bool]) -> float | None:
        return float(np.mean(values)) if values else None

    named = [bool({*names} & {*row["remarks"]}) for row in recordings] if kind in NAMED else []
    large = [_is_large(kind, row["seed"]) for row in recordings]
    return {
        "kind": kind, "remark": NAMED.get(kind), "named": mean(named), "large": int(sum(large)),
        "passed": mean([not one for one, of_size in zip(named, large, strict=False) if of_size]),
        "use": uses.count("use") / len(recordings), "bound": uses.count("use as a bound") / len(recordings),
        "n": float(np.median(ratios)) if ratios else None, "exact": mean(exact),
        "covered": mean([_covers(number, (truth or 1.0) * N) for number in used]), "k": mean(held),
    }  # fmt: skip


def _is_large(kind: str, seed: int) -> bool:
    """Whether the fault of a recording is above the stated size."""
    if kind not in faults.COURSES:
        return True
    x, courses = (of[kind](SAMPLES, _rng(kind, seed)) for of in (faults.FAULTS, faults.COURSES))
    return faults.visibility(x, courses) > STATED


def table(result: dict[str, Any]) -> str:
    """The result as Markdown."""

    def share(value: float | None) -> str:
        return "" if value is None else f"{value:.0%}"

    lines = [
        f"Plain NumPy simulates {result['recordings']} recordings of each fault and clean kind, with "
        f"{result['samples']} samples at {result['rate']:g} Hz. The table shows how often the fault is named, the "
        "verdicts of N, its median over the truth, its share within 2 %, its coverage, and how often K is right. "
        f"Faults that a random walk hides are large if they reduce −2 log L by {STATED:g} beside it: "
        + "; ".join(
            f"{row['large']} of the {row['kind'].replace('_', ' ')}, of which {share(row['passed'])} are not named"
            for row in result["rows"]
            if row["kind"] in faults.COURSES
        )
        + ".",
        "",
        "| fault | remark | named | N used | N bound | N / truth | within 2 % | covered | K right |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        ratio = "" if row["n"] is None else f"{row['n']:.3f}"
        remark = " or ".join(f"`{name}`" for name in (row["remark"] or "").split(" or ") if name)
        cells = (row["kind"].replace("_", " "), remark, share(row["named"]), share(row["use"]), share(row["bound"]))
        lines.append(f"| {' | '.join((*cells, ratio, share(row['exact']), share(row['covered']), share(row['k'])))} |")
    lines += ["", "| clean recordings | with a remark on a fault | remarks |", "|---|---|---|"]
    for row in result["clean"]:
        names = ", ".join(f"`{name}` ({count})" for name, count in row["remarks"].items())
        lines.append(f"| {row['kind'].replace('_', ' ')} | {row['any']:.1%} | {names} |")
    return "\n".join([*lines, "", *legend(
        {"named": "share of recordings with the remark", "N / truth": "median over recordings whose N is not refused"}
    )])  # fmt: skip
