"""Virtual sensors: the predicted variance against the one in other recordings, by a simulator in plain NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.applications.several import fuse

NAME = "fusion"
SEED = 20261124
REPEATS = 1000
SAMPLES = 1 << 15
WHITE = np.array([1.0, 1.0, 2.0, 4.0])
LOADINGS = np.array([1.0, -0.8, 0.9, -0.6])
WALK = 1e-5
OWN = 0.1
"""Variance of the independent walk of a unit, as a share of the common one."""
HORIZONS = (2, 256, 1024, 2048)
FILTERS = ((4, 1 << 15, 3), (4, 1 << 17, 10), (8, 1 << 15, 6))
"""Kalman filters: units, samples, and how much fewer recordings than for static weights."""

Array = NDArray[np.float64]


def units(count: int) -> tuple[Array, Array]:
    """Covariance matrices of the white noise and of the increments of the walk, for four units or multiples."""
    loadings = np.tile(LOADINGS, -(-count // 4))[:count]
    white = np.diag(np.tile(WHITE, -(-count // 4))[:count])
    return white, WALK * (np.outer(loadings, loadings) + OWN * np.eye(count))


def simulated(rng: np.random.Generator, count: int, n: int = SAMPLES) -> dict[str, Array]:
    """A recording of an array of units at rest, one sample per second."""
    white, walk = (np.linalg.cholesky(matrix) for matrix in units(count))
    x = white @ rng.standard_normal((count, n)) + np.cumsum(walk @ rng.standard_normal((count, n)), axis=1)
    return {f"gyro_x[{k}]": values for k, values in enumerate(x)}


def exact(count: int, tau: Array) -> Array:
    """Γ_j (J, d, d) of the coefficients at scales of τ_j samples."""
    white, walk = units(count)
    return np.asarray(white / tau[:, None, None] + walk * ((tau**2 + 2) / (12 * tau))[:, None, None])


def run(reduced: bool = False) -> dict[str, Any]:
    """Ratios of the variance of the virtual sensor: achieved over predicted, and over the least possible one."""
    repeats = 20 if reduced else REPEATS
    rows = []
    for count, horizons in ((4, HORIZONS), (8, HORIZONS[:3])):
        recordings = [np.random.default_rng([SEED, count, k]) for k in range(repeats)]
        for horizon in horizons:
            found = [fuse(simulated(np.random.default_rng([SEED, count, k]), count), 1.0, horizon=float(horizon))
                     for k in range(len(recordings))]  # fmt: skip
            rows.append(_row(count, horizon, [virtual["gyro_x"] for virtual in found]))
    filters = [_filter_row(count, n, max(repeats // fewer, 4)) for count, n, fewer in FILTERS]
    return {"rows": rows, "filters": filters}


def _filter_row(count: int, n: int, repeats: int) -> dict[str, Any]:
    """A Kalman filter from one recording, applied to another one."""
    predicted, achieved, plain = [], [], []
    for k in range(repeats):
        rng = np.random.default_rng([SEED, 50 + count, n, k])
        virtual = fuse(simulated(rng, count, n), 1.0, model="WN + shared(RW)")
        one = virtual["gyro_x"]
        fused = virtual.apply(simulated(rng, count, n), 1.0)["gyro_x"].values
        predicted.append(one.variance)
        plain.append(one.variance / one.optimism)
        achieved.append([haar(fused, int(level)) for level in one.levels])
    mean, tau = np.mean(achieved, axis=0), one.tau
    gamma = exact(count, tau)
    ratio = np.array(achieved) / np.mean(predicted, axis=0)
    return {
        "units": count, "samples": n, "repeats": repeats, "tau": tau.tolist(),
        "ratio": ratio.mean(axis=0).tolist(),
        "error": (ratio.std(axis=0) / np.sqrt(repeats)).tolist(),
        "uncorrected": (mean / np.mean(plain, axis=0)).tolist(),
        "over_average": (mean / (gamma.sum(axis=(1, 2)) / count**2)).tolist(),
        "over_best": (mean * np.array([np.linalg.inv(matrix).sum() for matrix in gamma])).tolist(),
    }  # fmt: skip


def haar(x: Array, level: int) -> float:
    """Haar wavelet variance at one level, by its definition."""
    half = 1 << (level - 1)
    path = np.concatenate([[0.0], np.cumsum(x - x.mean())])
    return float(np.mean(((path[2 * half :] - 2 * path[half:-half] + path[: -2 * half]) / 2**level) ** 2))


def _row(count: int, horizon: int, found: Sequence[Any]) -> dict[str, Any]:
    tau = found[0].tau
    gamma = exact(count, tau)
    achieved = np.array([np.einsum("a,jab,b->j", one.weights, gamma, one.weights) for one in found])
    predicted = np.array([one.variance for one in found])
    plain = predicted / np.array([one.optimism for one in found])
    best = np.array([1 / np.linalg.inv(matrix).sum() for matrix in gamma])
    average = gamma.sum(axis=(1, 2)) / count**2
    at = int(np.argmin(np.abs(np.log(tau / horizon))))
    mean = achieved.mean(axis=0)
    return {
        "units": count, "horizon": horizon, "repeats": len(found), "tau": tau.tolist(),
        "ratio": (mean / predicted.mean(axis=0)).tolist(),
        "uncorrected": (mean / plain.mean(axis=0)).tolist(),
        "error": (np.std(predicted - achieved, axis=0) / np.sqrt(len(found)) / predicted.mean(axis=0)).tolist(),
        "at": at, "over_best": float(mean[at] / best[at]), "over_average": float(mean[at] / average[at]),
    }  # fmt: skip


def table(result: dict[str, Any]) -> str:
    """Markdown: a line for each horizon."""
    lines = [
        f"Recordings of {SAMPLES} samples at 1 Hz are simulated in plain NumPy. The units have white noise of "
        "variance 1, 1, 2, 4 and random walks. 10 % of the variance of the random walks is independent, and the rest "
        "is common to all units, with loadings 1, −0.8, 0.9, −0.6. `gmwm.fuse` estimates the weights from one "
        "recording and predicts the variance. The *achieved* variance is the exact wavelet variance of these weights "
        "in any other recording. The table has means over the recordings.",
        "",
        "| units | horizon (s) | recordings | achieved / predicted, at the horizon | at all scales | without "
        "correction, at the horizon | achieved / best possible | achieved / average |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        at, ratio = row["at"], row["ratio"]
        lines.append(
            f"| {row['units']} | {row['horizon']} | {row['repeats']} | {ratio[at]:.2f} ± {row['error'][at]:.2f} | "
            f"{min(ratio):.2f} to {max(ratio):.2f} | {row['uncorrected'][at]:.2f} | {row['over_best']:.2f} | "
            f"{row['over_average']:.2f} |"
        )
    lines += [
        "",
        "The next table is for a Kalman filter on differences: `gmwm.fuse` without a horizon, with the model WN + "
        "shared(RW). The filter comes from one recording and is applied to a second one, in which the variance is "
        "measured. The *best static weights* are the weights for each scale from the true covariance matrices.",
        "",
        "| units | samples | recordings | scale (s) | achieved / predicted | without correction | achieved / average | "
        "achieved / best static weights |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in result["filters"]:
        for k in range(0, len(row["tau"]), 3):
            lines.append(
                f"| {row['units']} | {row['samples']} | {row['repeats']} | {row['tau'][k]:g} | {row['ratio'][k]:.2f} ± "
                f"{row['error'][k]:.2f} | {row['uncorrected'][k]:.2f} | {row['over_average'][k]:.2f} | "
                f"{row['over_best'][k]:.2f} |"
            )
    return "\n".join(lines)
