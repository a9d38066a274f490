"""Size and power of the test for outliers, on clean and on coarsely rounded recordings.

Units of six axes are simulated, each axis rounded in one of two ways or not at all: every sample to the nearest step
("rate"), or the angle, whose differences are the samples ("angle"). Steps are in standard deviations of what is rough
in the signal, √(var(x_t − x_{t−1}) / 2), and where the mean lies between two steps is drawn. A unit is a false alarm if
one axis is called contaminated.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

import gmwm
from gmwm.measuring.outliers import contamination
from validation.legend import legend
from validation.recordings import RATE, Array, everywhere
from validation.study_contamination import SAMPLES, SIZE, SPOILS, TRUTH

NAME = "contamination-test"
SEED = 20261207
AXES = 6
LEVEL = 0.05

TRUTHS = {
    "WN + RW": "WN(sigma2=1.0) + RW(gamma2=1e-4)",
    "GM + WN": "GM(beta=0.5, sigma2=0.1) + WN(sigma2=1.0)",
    "2*GM + WN + QN": "GM(beta=8.0, sigma2=0.6) + GM(beta=0.15, sigma2=0.2) + WN(sigma2=2.0) + QN(q2=1.0)",
    "strong QN": "QN(q2=1.0) + WN(sigma2=1e-3)",
    "DR + WN": "DR(omega=1e-4) + WN(sigma2=1.0)",
    "RW": "RW(gamma2=1.0)",
}
STEPS = (("none", 0.0), ("rate", 0.5), ("rate", 1.0), ("rate", 2.0), ("rate", 4.0), ("angle", 1.0), ("angle", 4.0))
DEVIATIONS = (2.0, 5.0, 10.0, 50.0)
"""Sizes of what is added, in standard deviations of the white noise."""


def run(reduced: bool = False) -> dict[str, Any]:
    """Share of false alarms for each model, rounding and length; share of spoilt recordings that are found."""
    units = {10_000: 10} if reduced else {10_000: 100, 100_000: 30}
    truths = list(TRUTHS)[:2] if reduced else list(TRUTHS)
    steps = STEPS[::2] if reduced else STEPS
    rows = [
        _false_alarms(truth, rounding, step, samples, count)
        for samples, count in units.items()
        for truth in truths
        for rounding, step in steps
    ]
    found = [
        _found(kind, deviations, 20 if reduced else 200)
        for kind in ("nothing", *SPOILS)
        for deviations in (DEVIATIONS if kind != "nothing" else (0.0,))
    ]
    return {"rows": rows, "found": found, "axes": AXES, "samples": SAMPLES, "model": str(TRUTH)}


def _false_alarms(truth: str, rounding: str, step: float, samples: int, units: int) -> dict[str, Any]:
    seeds = [(SEED, list(TRUTHS).index(truth), STEPS.index((rounding, step)), samples, k) for k in range(units * AXES)]
    out = np.array(everywhere(partial(_judged, TRUTHS[truth], rounding, step, samples), seeds))
    alarms = out[:, 0].reshape(units, AXES)
    return {
        "model": truth,
        "rounding": rounding,
        "step": step,
        "samples": samples,
        "units": units,
        "units_alarmed": float(alarms.any(axis=1).mean()),
        "axes_alarmed": float(out[:, 1].mean()),
        "levels_tested": float(out[:, 2].mean()),
    }


def _judged(text: str, rounding: str, step: float, samples: int, seed: tuple[int, ...]) -> Array:
    """Contaminated among six; contaminated by itself; number of levels tested."""
    rng = np.random.default_rng(seed)
    x = gmwm.Model.parse(text).simulate(samples, RATE, rng)
    if rounding != "none":
        q = step * np.sqrt(np.var(np.diff(x)) / 2)
        if rounding == "rate":
            x = q * np.rint(x / q + rng.uniform())
        else:
            # A mean rate of part of a step, so that the angle does not stay at one.
            x = q * np.diff(np.rint(np.cumsum(x / q + rng.uniform())))
    six = contamination(_curves(x), size=LEVEL, comparisons=AXES)
    # A p-value of one recording is a sixth of that of six.
    return np.array([six.contaminated, six.pvalue / AXES <= LEVEL, np.count_nonzero(six.tested)], dtype=np.float64)


def _curves(x: Array) -> tuple[gmwm.WaveletVariance, gmwm.WaveletVariance]:
    """The two curves alone, so that the ratio decides and not the bursts in the samples."""
    return gmwm.wavelet_variance(x, RATE), gmwm.wavelet_variance(x, RATE, robust=True)


def _found(kind: str, deviations: float, recordings: int) -> dict[str, Any]:
    seeds = [(SEED, 100 + [*SPOILS, kind].index(kind), round(deviations), k) for k in range(recordings)]
    out = np.array(everywhere(partial(_spoilt, kind, deviations), seeds))
    return {
        "outliers": kind,
        "deviations": deviations,
        "recordings": recordings,
        "found": float(out[:, 0].mean()),
        "excess": float(np.median(out[:, 1])),
    }


def _spoilt(kind: str, deviations: float, seed: tuple[int, ...]) -> Array:
    """Contaminated among six; the largest excess of a level that is tested."""
    rng = np.random.default_rng(seed)
    x = TRUTH.simulate(SAMPLES, RATE, rng)
    if kind != "nothing":
        x += deviations * 2e-3 / SIZE * (SPOILS[kind](x, rng) - x)
    verdict = contamination(_curves(x), size=LEVEL, comparisons=AXES)
    return np.array([verdict.contaminated, verdict.excess[verdict.tested].max()])


def table(result: dict[str, Any]) -> str:
    """Markdown: false alarms of each model, rounding and length; then what is found."""
    lines = [
        f"Devices with {result['axes']} axes at {RATE:g} Hz are tested at the {100 * LEVEL:g} % level per device. "
        "Either the rate or the angle is rounded. The test uses only the two curves; from a signal, `contamination` "
        "also requires bursts or isolated wrong samples ([study](tails.md)).",
        *legend(
            {
                "step": "quantization step in standard deviations of the high-frequency noise",
                "devices alarmed": "share of devices with at least one axis that is classified as contaminated",
                "axes alarmed": (
                    f"share of single axes that are classified as contaminated, each tested at {100 * LEVEL:g} %"
                ),
                "levels": (
                    "mean number of tested levels; the others have too few coefficients or are "
                    "dominated by the rounding"
                ),
            }
        ),
        "",
        "| model | samples | rounding | step | devices | devices alarmed | axes alarmed | levels |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {r['model']} | {r['samples']} | {r['rounding']} | {r['step']:g} | {r['units']} "
        f"| {100 * r['units_alarmed']:.1f} % | {100 * r['axes_alarmed']:.1f} % | {r['levels_tested']:.1f} |"
        for r in result["rows"]
    ]
    for samples in sorted({r["samples"] for r in result["rows"]}):
        part = [r for r in result["rows"] if r["samples"] == samples]
        units, axes = (np.mean([r[name] for r in part]) for name in ("units_alarmed", "axes_alarmed"))
        count = sum(r["units"] for r in part)
        lines.append(f"| all | {samples} | | | {count} | {100 * units:.1f} % | {100 * axes:.1f} % | |")
    lines += [
        "",
        f"Recordings of {result['samples']} samples are simulated from {result['model']}. In each, 1 % of the samples "
        "are outliers of the given size in standard deviations of the white noise. Each recording stands for one of "
        "the six axes of a unit.",
        *legend(
            {
                "found": "share of the recordings that are classified as contaminated",
                "excess": (
                    "largest excess of the classical over the robust variance among the tested "
                    "levels; median over the recordings"
                ),
            }
        ),
        "",
        "| outliers | deviations | found | excess |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| {r['outliers']} | {r['deviations']:g} | {100 * r['found']:.0f} % | {100 * r['excess']:.0f} % |"
        for r in result["found"]
    ]
    return "\n".join(lines)
