"""Joint models of several signals: size and power of the tests, coverage, by a simulator in plain NumPy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from gmwm.applications.several import fit_joint
from validation.legend import legend

NAME = "joint"
SEED = 20261125
REPEATS = 1000
AXES = ("gyro_x", "gyro_y", "gyro_z")
RATE = 100.0
BETA = 2.0
"""Inverse correlation time of the Gauss-Markov process (1/s)."""

Array = NDArray[np.float64]
Make = Callable[[np.random.Generator, int], Array]


def white(rng: np.random.Generator, n: int) -> Array:
    return rng.standard_normal((3, n))


def walk(rng: np.random.Generator, n: int) -> Array:
    return np.cumsum(0.03 * rng.standard_normal((3, n)), axis=1)


def markov(rng: np.random.Generator, n: int) -> Array:
    phi = np.exp(-BETA / RATE)
    start = rng.standard_normal((3, 1))
    return lfilter([np.sqrt(1 - phi**2)], [1, -phi], rng.standard_normal((3, n)), axis=1, zi=phi * start)[0]


@dataclass(frozen=True)
class Case:
    """A model, the process that may be shared, its scale parameter and the correlation matrix."""

    name: str
    model: str
    term: str
    make: Make
    scale: float
    correlation: Array
    samples: int = 10_000


def equal(rho: float) -> Array:
    return np.full((3, 3), rho) + (1 - rho) * np.eye(3)


MIXED = np.array([[1.0, 0.6, 0.2], [0.6, 1.0, -0.3], [0.2, -0.3, 1.0]])
CASES = (
    Case("WN", "shared(WN)", "WN", white, 1.0, equal(0.0)),
    Case("WN, ρ = 0.6, 0.2, −0.3", "shared(WN)", "WN", white, 1.0, MIXED),
    Case("RW + WN", "shared(RW) + WN", "RW", walk, 9e-4, equal(0.0)),
    Case("RW + WN, RW of ρ = 0.5", "shared(RW) + WN", "RW", walk, 9e-4, equal(0.5)),
    Case("RW + WN, RW of ρ = 0.6, 0.2, −0.3", "shared(RW) + WN", "RW", walk, 9e-4, MIXED),
    Case("RW + WN, RW of ρ = 1", "shared(RW) + WN", "RW", walk, 9e-4, equal(1.0)),
    Case("GM + WN", "shared(GM) + WN", "GM", markov, 1.0, equal(0.0)),
    Case("GM + WN, GM of ρ = 0.5", "shared(GM) + WN", "GM", markov, 1.0, equal(0.5)),
    Case("WN, 100 000 samples", "shared(WN)", "WN", white, 1.0, equal(0.0), 100_000),
    Case("GM + WN, 100 000 samples", "shared(GM) + WN", "GM", markov, 1.0, equal(0.0), 100_000),
    Case("RW + WN, 100 000 samples", "shared(RW) + WN", "RW", walk, 9e-4, equal(0.0), 100_000),
    Case("RW + WN, RW of ρ = 0.5, 100 000 samples", "shared(RW) + WN", "RW", walk, 9e-4, equal(0.5), 100_000),
)


def simulated(rng: np.random.Generator, case: Case) -> Mapping[str, Array]:
    """Own white noise of variance 1, and the shared process."""
    values, vectors = np.linalg.eigh(case.correlation)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    slow = root @ case.make(rng, case.samples)
    x = slow if case.make is white else white(rng, case.samples) + slow
    return dict(zip(AXES, x, strict=True))


def run(reduced: bool = False) -> dict[str, Any]:
    """Shares of rejected models, of shared terms that are found, and of covered values."""
    return {"rows": [_row(k, case, 12 if reduced else REPEATS) for k, case in enumerate(CASES)]}


def _row(place: int, case: Case, repeats: int) -> dict[str, Any]:
    upper = np.triu_indices(3, 1)
    truth = case.scale * case.correlation
    misfit, shared, matrix, limits = 0, 0, [], []
    for k in range(repeats):
        fit = fit_joint(case.model, simulated(np.random.default_rng([SEED, place, k]), case), RATE)
        misfit += fit.goodness_of_fit().pvalue <= 0.05
        shared += fit.shared(case.term).pvalue <= 0.05
        error = fit.standard_errors[case.term]
        matrix.append(np.abs(fit.covariances[case.term] - truth) <= 1.96 * error)
        low, high = fit.correlation_interval(case.term)
        limits.append((low <= case.correlation + 1e-12)[upper] & (case.correlation <= high + 1e-12)[upper])
    return {
        "case": case.name, "samples": case.samples, "repeats": repeats, "misfit": misfit / repeats,
        "shared": shared / repeats, "covered": float(np.mean(np.array(matrix)[(slice(None), *np.triu_indices(3))])),
        "correlation": float(np.mean(limits)),
    }  # fmt: skip


def table(result: dict[str, Any]) -> str:
    """Markdown: a line for each case."""
    lines = [
        "Three signals of 10 000 samples, unless the table states otherwise, are simulated in plain NumPy. "
        "`gmwm.fit_joint` fits the true model, in which one term may be shared.",
        *legend(
            {
                "rejected": "share of recordings in which the test of the model rejects it at the 5 % level",
                "shared": ("share of recordings in which the test at the 5 % level finds that the term is shared"),
                "covered entries": (
                    "share of 95 % intervals, estimate ± 1.96 standard errors, that contain the true "
                    "entry of the covariance matrix of the term"
                ),
                "covered correlations": "share of 95 % intervals of the correlations that contain the true correlation",
            }
        ),
        "",
        "| noise | recordings | rejected | shared | covered entries | covered correlations |",
        "|---|---|---|---|---|---|",
        *(
            f"| {r['case']} | {r['repeats']} | {100 * r['misfit']:.1f} % | {100 * r['shared']:.1f} % | "
            f"{100 * r['covered']:.1f} % | {100 * r['correlation']:.1f} % |"
            for r in result["rows"]
        ),
    ]
    return "\n".join(lines)
