"""Several recordings of one unit: sizes and powers of the tests, and intervals, by simulators in plain NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

import gmwm
from gmwm.applications.several.same import level_ratios
from gmwm.base.statistics import holm
from gmwm.fitting.estimation.intervals import confidence_intervals
from gmwm.fitting.estimation.recordings import deviations, half_widths
from gmwm.measuring.covariance.tails import excess_covariance, with_common_tails
from gmwm.recording.signals import Signal
from validation.legend import legend
from validation.study_cross import Array

NAME = "recordings"
SEED = 20261125
REPEATS, FEW = 1000, 300
RATE = 100.0
MODELS = {"WN": "WN", "GM + WN": "GM + WN", "RW + WN": "WN + RW", "t with 5 degrees of freedom": "WN"}
SIZES = ((3, 10_000, REPEATS), (3, 100_000, REPEATS), (2, 10_000, FEW), (6, 10_000, FEW))
"""Recordings, samples of each, repeats."""
POWERS: Sequence[tuple[str, str, tuple[float, float, float]]] = (
    ("WN", "σ² ± 3 %", (0.03, 0.0, 0.0)),
    ("RW + WN", "γ² ± 40 %", (0.0, 0.4, 0.0)),
    ("RW + WN", "γ² ± 80 %", (0.0, 0.8, 0.0)),
    ("GM + WN", "β ± 40 %", (0.0, 0.4, 0.0)),
    ("GM + WN", "σ²_GM ± 40 %", (0.0, 0.0, 0.4)),
)
"""Kind, what varies between the recordings, and the standard deviations of the logarithms."""
SPREADS = (0.0, 0.5, 1.0, 2.0, 5.0, 20.0)
"""Spread between recordings over the standard error of one."""


def recording(kind: str, rng: np.random.Generator, n: int, moved: Array) -> Array:
    """One recording with the logarithms of its variances moved."""
    if kind.startswith("t with"):
        return rng.standard_t(5, n) / np.sqrt(5 / 3)
    x = np.exp(moved[0] / 2) * rng.standard_normal(n)
    if kind == "RW + WN":
        x += np.cumsum(np.sqrt(1e-3 * np.exp(moved[1])) * rng.standard_normal(n))
    if kind == "GM + WN":
        phi, deviation = np.exp(-2.0 * np.exp(moved[1]) / RATE), np.sqrt(0.25 * np.exp(moved[2]))
        start = deviation * rng.standard_normal(1)
        steps = deviation * np.sqrt(1 - phi**2) * rng.standard_normal(n)
        x += lfilter([1.0], [1, -phi], steps, zi=phi * start)[0]
    return x


def run(reduced: bool = False) -> dict[str, Any]:
    """Rates at which equal and different recordings seem to differ, and coverage of the intervals."""
    share = 0.01 if reduced else 1.0
    sizes = []
    for k, kind in enumerate(MODELS):
        for count, n, repeats in SIZES if not reduced else SIZES[:1]:
            rng = np.random.default_rng([SEED, k, count, n])
            found = [_tests(kind, rng, count=count, n=n) for _ in range(max(int(share * repeats), 2))]
            sizes.append({"kind": kind, "recordings": count, "samples": n, "repeats": len(found), **_rates(found)})
    powers = []
    for k, (kind, what, spread) in enumerate(POWERS):
        rng = np.random.default_rng([SEED, 100 + k])
        found = [_tests(kind, rng, count=4, n=10_000, spread=spread) for _ in range(max(int(share * FEW), 2))]
        powers.append({"kind": kind, "what": what, "repeats": len(found), **_rates(found)})
    return {"rows": sizes, "powers": powers, "intervals": _intervals(share), "fits": _fits(share)}


def _rates(found: list[tuple[float, float, float]]) -> dict[str, float]:
    pvalues = np.array(found)
    both = 2 * np.min(pvalues[:, :2], axis=1)
    columns = {"parameters": pvalues[:, 0], "model_free": pvalues[:, 1], "both": both, "fit": pvalues[:, 2]}
    return {name: float(np.mean(column <= 0.05)) for name, column in columns.items()}


def _tests(
    kind: str, rng: np.random.Generator, *, count: int, n: int, spread: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[float, float, float]:
    """p-values of equal parameters, of equal curves and of the pooled goodness-of-fit test."""
    curves = {}
    for r in range(count):
        signal = Signal(recording(kind, rng, n, np.array(spread) * rng.standard_normal(3)), RATE)
        wv = gmwm.wavelet_variance(signal)
        curves[str(r)] = replace(wv, excess=excess_covariance(signal, wv)) if kind.startswith("t with") else wv
    fit = gmwm.fit(MODELS[kind], list(with_common_tails(curves).values()), weighting="optimal", certify=False)
    rows = level_ratios(fit.wavelet_variance.recordings)
    free = holm([np.nan if row.pvalue is None else row.pvalue for row in rows])
    return deviations(fit).pvalue, float(np.nanmin(free)), fit.goodness_of_fit().pvalue


def _intervals(share: float) -> list[dict[str, Any]]:
    """Coverage of the interval of the mean of normal recordings with known errors, by numbers alone."""
    rows = []
    repeats = max(int(4000 * share), 200)
    for count in (2, 3, 5, 10):
        for spread in SPREADS:
            rng = np.random.default_rng([SEED, 200, count, int(10 * spread)])
            x = np.sqrt(1 + spread**2) * rng.standard_normal((repeats, count))
            half = half_widths(x, np.ones_like(x))
            inside = np.abs(x.mean(axis=1)) <= half
            alone = np.abs(x.mean(axis=1)) <= 1.959964 / np.sqrt(count)
            width = float(np.median(half)) * np.sqrt(count) / (1.959964 * np.sqrt(1 + spread**2))
            rows.append({"recordings": count, "spread": spread, "repeats": repeats, "covered": float(inside.mean()),
                         "without": float(alone.mean()), "width": width})  # fmt: skip
    return rows


def _fits(share: float) -> list[dict[str, Any]]:
    """Coverage of the intervals of fits to recordings whose variances differ."""
    rows = []
    for k, (kind, name, truth, spread) in enumerate((
        ("WN", "WN.sigma2", 1.0, (0.1, 0.0, 0.0)),
        ("RW + WN", "RW.gamma2", 1e-3, (0.0, 0.4, 0.0)),
    )):  # fmt: skip
        rng, inside = np.random.default_rng([SEED, 300 + k]), []
        for _ in range(max(int(share * FEW), 2)):
            curves = [
                gmwm.wavelet_variance(recording(kind, rng, 10_000, np.array(spread) * rng.standard_normal(3)), RATE)
                for _ in range(4)
            ]
            fit = gmwm.fit(MODELS[kind], curves, weighting="optimal", certify=False)
            low, high = confidence_intervals(fit)[name]
            # The mean of the variances is exp(spread²/2) times the median.
            inside.append(low <= truth * np.exp(max(spread) ** 2 / 2) <= high)
        rows.append({"kind": kind, "parameter": name, "spread": max(spread), "repeats": len(inside),
                     "covered": float(np.mean(inside))})  # fmt: skip
    return rows


def table(result: dict[str, Any]) -> str:
    """Markdown: the four tables."""
    lines = [
        "Equal recordings are simulated in plain NumPy and fitted together with their "
        "true model. For noise with heavy tails, the fit uses the covariance that `calibrate` measures.",
        *legend(
            {
                "parameters": "share of repeats in which the test of equal parameters rejects at the 5 % level",
                "curves": "the same for the test without a model",
                "both": "share of repeats in which `Replicates.differs` is true",
                "fit": "share of repeats in which the goodness-of-fit test of the pooled curve rejects",
            }
        ),
        "",
        "| noise | recordings | samples of each | repeats | parameters | curves | both | fit |",
        "|---|---|---|---|---|---|---|---|",
        *(
            f"| {r['kind']} | {r['recordings']} | {r['samples']} | {r['repeats']} | {_shares(r)} |"
            for r in result["rows"]
        ),
        "",
        "Four recordings of 10 000 samples each have parameters whose logarithms differ by "
        "normally distributed amounts.",
        "",
        "| noise | difference | repeats | parameters | curves | both | fit |",
        "|---|---|---|---|---|---|---|",
        *(f"| {r['kind']} | {r['what']} | {r['repeats']} | {_shares(r)} |" for r in result["powers"]),
        "",
        "The table has the coverage of the 95 % interval of the mean over recordings. The estimate from each "
        "recording has a normal error with standard deviation 1, and the recordings have the given spread.",
        *legend(
            {
                "without": "coverage of intervals that ignore the spread",
                "width": "median width, divided by the width of an interval with a known spread",
            }
        ),
        "",
        "| recordings | spread | repeats | covered | without | width |",
        "|---|---|---|---|---|---|",
        *(
            f"| {r['recordings']} | {r['spread']:g} | {r['repeats']} | {100 * r['covered']:.1f} % | "
            f"{100 * r['without']:.1f} % | {r['width']:.2f} |"
            for r in result["intervals"]
        ),
        "",
        "The table has the same coverage for fits to four recordings of 10 000 samples.",
        "",
        "| noise | parameter | spread | repeats | covered |",
        "|---|---|---|---|---|",
        *(
            f"| {r['kind']} | {r['parameter']} | {100 * r['spread']:.0f} % | {r['repeats']} | "
            f"{100 * r['covered']:.1f} % |"
            for r in result["fits"]
        ),
    ]
    return "\n".join(lines)


def _shares(row: dict[str, Any]) -> str:
    return " | ".join(f"{100 * row[name]:.1f} %" for name in ("parameters", "model_free", "both", "fit"))
