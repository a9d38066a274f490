"""Coverage of the interval of the bias at rest: the mean of a recording with an error from the fitted model.

The recordings are drawn with NumPy alone. The true bias is zero; beside a random walk it is the level at the end of the
recording, and beside flicker noise the mean of the next recording of the same length.
"""

from __future__ import annotations

import math
import warnings
from functools import partial
from typing import Any

import numpy as np
from scipy.signal import lfilter

import gmwm
from gmwm.calibration.rest import reach_of
from gmwm.choosing.datasheets.bias_changes import BiasTerms
from validation import recordings
from validation.legend import legend, table_lines

NAME = "rest"
SEED = 20261123
RATE = 100.0
SAMPLES = 32_768
WHITE = 1e-3
"""Standard deviation of the white noise (rad/s)."""

Case = dict[str, Any]
CASES: tuple[Case, ...] = (
    {"noise": "white noise", "model": "WN"},
    {"noise": "white noise, Laplace", "model": "WN", "laplace": True},
    {"noise": "white noise, Gauss-Markov of 1 s", "model": "GM + WN", "time": 1.0},
    {"noise": "white noise, Gauss-Markov of 5 s", "model": "GM + WN", "time": 5.0},
    {"noise": "white noise, flicker noise", "model": "FN + WN", "flicker": 3e-5},
    {"noise": "white noise, strong random walk", "model": "WN + RW", "step": 1e-5},
    {"noise": "white noise, random walk", "model": "WN + RW", "step": 2e-6},
    {"noise": "white noise, weak random walk", "model": "WN + RW", "step": 3e-7},
    {"noise": "white noise, Gauss-Markov of 1 s, random walk", "model": "GM + WN + RW", "time": 1.0, "step": 3e-6},
)


def run(reduced: bool = False) -> dict[str, Any]:
    """Coverage for a known model, and for the model that `calibrate` chooses."""
    known, chosen = (24, 2) if reduced else (300, 40)
    rows = []
    for number, case in enumerate(CASES[:1] + CASES[6:7] if reduced else CASES):
        seeds = (SEED + 10_000 * number + np.arange(known)).tolist()
        found = np.array(recordings.everywhere(partial(fitted, case), seeds))
        picked = np.array(recordings.everywhere(partial(calibrated, case), seeds[:chosen]))
        rows.append({
            "noise": case["noise"], "model": case["model"], "covered": float(np.mean(found[:, 0] <= found[:, 2])),
            "ratio": float(np.sqrt(np.mean((found[:, 0] / found[:, 1]) ** 2))),
            "naive": float(np.mean(found[:, 0] <= found[:, 3])),
            "chosen": float(np.mean(picked[:, 0] <= picked[:, 1])),
        })  # fmt: skip
    return {"recordings": known, "chosen_recordings": chosen, "rate": RATE, "samples": SAMPLES, "rows": rows}


def drawn(case: Case, seed: int) -> tuple[recordings.Array, float]:
    """A recording and its true bias."""
    rng = np.random.default_rng(seed)
    x = rng.laplace(0, WHITE / math.sqrt(2), SAMPLES) if case.get("laplace") else rng.normal(0, WHITE, SAMPLES)
    truth = 0.0
    if "step" in case:
        walk = np.cumsum(rng.normal(0, case["step"], SAMPLES))
        x, truth = x + walk, float(walk[-1])
    if "time" in case:
        x = x + markov(rng, case["time"], 3e-4)
    if "flicker" in case:
        both = case["flicker"] * flicker(rng, 2 * SAMPLES)
        # Half the variance of the difference of two means is the variance that the interval is for.
        x = x + both[:SAMPLES]
        apart = (np.mean(x) - np.mean(both[SAMPLES:]) - rng.normal(0, WHITE / math.sqrt(SAMPLES))) / math.sqrt(2)
        truth = float(np.mean(x) - apart)
    return x, truth


def markov(rng: np.random.Generator, time: float, deviation: float) -> recordings.Array:
    """A Gauss-Markov process, from its recursion."""
    keep = math.exp(-1 / (RATE * time))
    driving = rng.normal(0, deviation * math.sqrt(1 - keep**2), SAMPLES)
    driving[0] = rng.normal(0, deviation)
    return np.asarray(lfilter([1.0], [1.0, -keep], driving))


def flicker(rng: np.random.Generator, samples: int) -> recordings.Array:
    """Noise with the density 1/f down to a hundredth of the length, from its spectrum."""
    long = 64 * samples
    frequency = np.arange(1, long // 2 + 1) / long
    shape = np.sqrt(1 / frequency)
    coefficients = shape * (rng.normal(size=long // 2) + 1j * rng.normal(size=long // 2))
    return np.fft.irfft(np.concatenate([[0.0], coefficients]), long)[:samples] * math.sqrt(long)


def fitted(case: Case, seed: int) -> tuple[float, float, float, float]:
    """Distance of the mean from the truth, its standard error, and half the intervals by the model and as white."""
    x, truth = drawn(case, seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gmwm.errors.FitWarning)
        fit = gmwm.fit(case["model"], gmwm.Signal(x, RATE, "rad/s"), weighting="optimal", certify=False)
    one = BiasTerms.of(fit).variance_of_mean(SAMPLES, SAMPLES)
    naive = 1.96 * float(np.std(x)) / math.sqrt(SAMPLES)
    return abs(float(np.mean(x)) - truth), math.sqrt(one.value), reach_of([(1.0, one)], 0.95), naive


def calibrated(case: Case, seed: int) -> tuple[float, float]:
    """Distance of the mean from the truth, and half the interval of `calibrate`."""
    x, truth = drawn(case, seed)
    signal = gmwm.Signal(x, RATE, "rad/s", axis="gyro_x")
    rest = gmwm.calibrate(signal, "GM + WN + FN + RW", threads=1).rest["gyro_x"]
    return abs(rest.mean - truth), (rest.high - rest.low) / 2


def table(result: dict[str, Any]) -> str:
    """Markdown: one row for each kind of noise."""
    count, chosen = result["recordings"], result["chosen_recordings"]
    noise, rough = (100 * math.sqrt(0.95 * 0.05 / n) for n in (count, chosen))
    lines = [
        f"The table has the share of 95 % intervals of the bias at rest that contain the true value, in {count} "
        f"recordings of {result['samples']} samples at {result['rate']:g} Hz for each kind of noise. The standard "
        f"error of a share of 95 % is {noise:.1f} %; for the last column, with {chosen} recordings, it is {rough:.1f} "
        "%.",
        *legend(
            {
                "ratio": "root mean square error of the mean, divided by its standard error",
                "as white noise": "the interval ±1.96 s/√n, which ignores correlation",
                "chosen": "`calibrate` within GM + WN + FN + RW, with intervals that account for the choice",
            }
        ),
        "",
        *table_lines(
            "| noise | fitted | covered | ratio | as white noise | chosen |",
            "| {noise} | {model} | {covered:.1%} | {ratio:.2f} | {naive:.1%} | {chosen:.1%} |",
            result["rows"],
        ),
        "",
        "The true value is the constant part of the signal. With a random walk, it is the level at the end of the "
        "recording. Flicker noise has no constant part: its error is the difference from the mean of the next "
        "recording, divided by √2. With the weak random walk, the error of the mean is larger than the error from the "
        "white noise alone, but the walk is rarely visible in one recording. The interval for the known model allows "
        "for this. If `calibrate` chooses a model without a random walk, the interval is too short; repeat the "
        "recording to measure the spread between recordings.",
    ]
    return "\n".join(lines) + "\n"
