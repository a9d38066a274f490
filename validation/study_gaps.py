"""Lost samples: three ways to the wavelet variance, and intervals and tests after filling.

The simulators are plain NumPy, and so is the covariance-type estimator of Mondal and Percival (2010, Wavelet variance
analysis for gappy time series, Annals of the Institute of Statistical Mathematics 62, 943-966), which averages squared
differences over all pairs of known samples.
"""

from __future__ import annotations

import warnings
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

import gmwm
from validation.legend import legend
from validation.recordings import Array, everywhere
from validation.sensors import flicker

NAME = "gaps"
SEED = 20261123
RATE = 100.0
SAMPLES = 100_000
RECORDINGS, COMPARED = 60, 12
"""Recordings of each model, and those whose curves are compared."""
LEVELS = 14
SHOWN = (1, 5, 9, 13)
LOSSES = ((0.001, 1), (0.01, 1), (0.1, 1), (0.001, 20), (0.01, 20), (0.1, 20))
"""Share of lost samples, and mean length of a gap."""
MODELS = {
    "WN": "WN(sigma2=1.0)",
    "GM + WN + RW": "GM(beta=0.05, sigma2=0.02) + WN(sigma2=1.0) + RW(gamma2=4e-7)",
    "FN + WN": "FN(b2=0.01) + WN(sigma2=1.0)",
}
"""The Gauss-Markov process has a correlation time of 20 s."""
WAYS = ("filled", "pairs", "segments")
Rng = np.random.Generator


def simulated(name: str, samples: int, rng: Rng) -> Array:
    """A recording of one of the models."""
    x = rng.standard_normal(samples)
    if name == "GM + WN + RW":
        phi = float(np.exp(-0.05 / RATE))
        shocks = np.sqrt(0.02 * (1 - phi**2)) * rng.standard_normal(samples)
        shocks[0] = np.sqrt(0.02) * rng.standard_normal()
        x += lfilter([1.0], [1.0, -phi], shocks) + np.sqrt(4e-7) * np.cumsum(rng.standard_normal(samples))
    if name == "FN + WN":
        x += 0.1 * flicker(samples, rng)
    return x


def known(share: float, burst: int, samples: int, rng: Rng) -> NDArray[np.bool_]:
    """Which samples are known: gaps begin at random places, and their lengths are geometric."""
    present = np.ones(samples, dtype=np.bool_)
    for first in rng.integers(64, samples - 1000, rng.poisson(share * samples / burst)):
        present[first : first + (rng.geometric(1 / burst) if burst > 1 else 1)] = False
    return present


def curve(x: Array) -> Array:
    """Wavelet variances of a recording without gaps."""
    path = np.concatenate([[0.0], np.cumsum(x - x.mean())])
    halves = [1 << k for k in range(LEVELS)]
    return np.array([np.mean((path[2 * h :] - 2 * path[h:-h] + path[: -2 * h]) ** 2) / (4.0 * h * h) for h in halves])


def by_pairs(x: Array, present: NDArray[np.bool_]) -> Array:
    """The covariance-type estimator: −½ Σ_τ r(τ) V(τ), V the mean of (x_t − x_{t+τ})² over the pairs that are known."""
    values = np.where(present, x - x[present].mean(), 0.0)
    size = 1 << (2 * x.size - 1).bit_length()
    a, b, c = (np.fft.rfft(v, size) for v in (present.astype(np.float64), values, values**2))
    pairs = np.fft.irfft(a * np.conj(a), size)
    sums = np.fft.irfft(a * np.conj(c) + c * np.conj(a) - 2 * b * np.conj(b), size)
    mean = sums / np.maximum(pairs, 0.5)
    out = []
    for half in (1 << k for k in range(LEVELS)):
        lags = np.arange(2 * half)
        r = np.where(lags <= half, 2 * half - 3 * lags, lags - 2 * half) / (4.0 * half * half)
        out.append(-float(r[1:] @ mean[1 : 2 * half]))
    return np.array(out)


def by_segments(signal: gmwm.Signal) -> Array:
    """Pooled coefficients inside the segments."""
    found = gmwm.wavelet_variance(signal, fill_gaps=False).variance[:LEVELS]
    return np.concatenate([found, np.full(LEVELS - found.size, np.nan)])


def run(reduced: bool = False) -> dict[str, Any]:
    """Bias and error of each way, and for fits to filled recordings, coverage and rejections."""
    count, compared, samples = (4, 2, 20_000) if reduced else (RECORDINGS, COMPARED, SAMPLES)
    losses = LOSSES[1:3] if reduced else LOSSES
    rows, tests = [], []
    for number, name in enumerate(MODELS):
        seeds = [(SEED, number, k) for k in range(count)]
        found = everywhere(partial(_outcome, name, samples, losses, compared), seeds)
        for k, (share, burst) in enumerate([(0.0, 1), *losses]):
            fits = np.array([one[0][k] for one in found])
            names = list(gmwm.Model.parse(MODELS[name]).parameters)
            tests.append({
                "model": name, "share": share, "burst": burst,
                "covered": dict(zip(names, fits[:, : len(names)].mean(axis=0).tolist(), strict=True)),
                "rejected": float(fits[:, -2].mean()), "n": float(np.sqrt(np.median(fits[:, -1]))),
            })  # fmt: skip
        for k, (share, burst) in enumerate(losses):
            for way, name_of_way in enumerate(WAYS):
                ratios = np.array([one[1][k][way] for one in found if one[1]])
                rows.append({
                    "model": name, "share": share, "burst": burst, "way": name_of_way,
                    "levels": {str(j): _of(ratios[:, j - 1]) for j in SHOWN if j <= ratios.shape[1]},
                })  # fmt: skip
    return {
        "recordings": count, "compared": compared, "samples": samples, "rate": RATE, "models": MODELS,
        "rows": rows, "tests": tests,
    }  # fmt: skip


def _of(ratios: Array) -> list[float] | None:
    """Bias and root mean square of the ratios less one; None if a recording has no such scale."""
    if not np.all(np.isfinite(ratios)):
        return None
    return [float(np.mean(ratios) - 1), float(np.sqrt(np.mean((ratios - 1) ** 2)))]


Outcome = tuple[list[list[float]], list[list[Array]]]


def _outcome(
    name: str, samples: int, losses: tuple[tuple[float, int], ...], compared: int, seed: tuple[int, ...]
) -> Outcome:
    """The fits of one recording, whole and with each loss; for some, the curves of each way over that of the whole."""
    x = simulated(name, samples, np.random.default_rng(seed))
    fits, ratios = [_fit(name, gmwm.Signal(x, RATE))], []
    for k, (share, burst) in enumerate(losses):
        present = known(share, burst, samples, np.random.default_rng([*seed, k]))
        signal = gmwm.Signal.from_missing(np.where(present, x, np.nan), RATE)
        fits.append(_fit(name, signal))
        if seed[-1] < compared:
            ways = (curve(signal.fill_gaps().values), by_pairs(x, present), by_segments(signal))
            ratios.append([way / curve(x) for way in ways])
    return fits, ratios


def _fit(name: str, signal: gmwm.Signal) -> list[float]:
    """Whether the 95 % interval of each parameter has its true value; whether the 5 % test rejects; σ²."""
    truth = gmwm.Model.parse(MODELS[name])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gmwm.errors.FitWarning)
        fit = gmwm.fit(name, signal, weighting="optimal", certify=False)
    intervals = fit.confidence_intervals()
    covered = [float(intervals[key][0] <= value <= intervals[key][1]) for key, value in truth.parameters.items()]
    return [*covered, float(fit.goodness_of_fit().pvalue < 0.05), fit.parameters["WN.sigma2"]]


def table(result: dict[str, Any]) -> str:
    """Markdown: intervals and tests after filling; then bias and error of each way."""
    noise = 100 * np.sqrt(0.95 * 0.05 / result["recordings"])
    models = "; ".join(result["models"].values())
    lines = [
        f"{result['recordings']} recordings each of {result['samples']} samples at {result['rate']:g} Hz are "
        f"simulated from these models: {models}. Each is fitted with the true sum and optimal weights, without losses "
        "and with its gaps filled (`Signal.fill_gaps`).",
        *legend(
            {
                "covered": (
                    "share of 95 % intervals that contain the true value; the standard error of a "
                    f"share near 95 % is {noise:.1f} %"
                ),
                "rejected": "share of goodness-of-fit tests that reject at the 5 % level",
                "N": "median of N divided by the true value",
            }
        ),
        "",
        "| model | lost | covered | rejected | N |",
        "|---|---|---|---|---|",
    ]
    for t in result["tests"]:
        covered = ", ".join(f"{name} {100 * share:.0f} %" for name, share in t["covered"].items())
        lines.append(f"| {t['model']} | {_loss(t)} | {covered} | {100 * t['rejected']:.0f} % | {t['n']:.4f} |")
    lines += [
        "",
        "The table compares the wavelet variance with the wavelet variance of the same "
        f"recording without losses, in {result['compared']} recordings. The numbers are "
        "the mean difference and, in parentheses, the root mean square difference.",
        *legend(
            {
                "filled": "`Signal.fill_gaps`",
                "pairs": (
                    "the covariance-type estimator of Mondal and Percival (2010), which averages "
                    "squared differences over the pairs in which both samples are known"
                ),
                "segments": "coefficients inside segments only; – if no segment is long enough",
            },
            "The methods:",
        ),
        "",
        "gmwm fills gaps. Filling is as accurate as the pairs at short scales and more accurate at long scales: the "
        "averages at two lags come from different pairs, so their errors do not cancel. Filling also gives robust "
        "curves, spectra and all other estimates. With a share p of filled samples, the covariance is the covariance "
        "of a recording without losses times 1 + 2.5 p.",
        "",
        f"| model | lost | method | {' | '.join(f'level {j}' for j in SHOWN)} |",
        f"|---|---|---|{'---|' * len(SHOWN)}",
    ]
    for r in result["rows"]:
        cells = [_cell(r["levels"].get(str(j))) for j in SHOWN]
        lines.append(f"| {r['model']} | {_loss(r)} | {r['way']} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _loss(row: dict[str, Any]) -> str:
    if not row["share"]:
        return "nothing"
    return f"{100 * row['share']:g} %" + (f" in gaps of {row['burst']}" if row["burst"] > 1 else "")


def _cell(found: list[float] | None) -> str:
    return "–" if found is None else f"{100 * found[0]:+.1f} ({100 * found[1]:.1f}) %"
