"""Tails, varying variance and outliers: which curve `calibrate` fits, and whether N is right and its interval covers.

The simulators are plain NumPy. White noise with unit variance from several distributions, a Gauss-Markov process with a
correlation time of 20 s and a random walk make the clean recordings. Knocks, motion and wrong samples are added to
Gaussian ones. Each recording is measured as one axis of six, as `calibrate` does, and fitted with the true sum.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.signal import lfilter

import gmwm
from gmwm.calibration.data import Recordings
from gmwm.calibration.measure import MeasuredAxis, measure
from gmwm.calibration.options import CalibrationOptions
from validation.legend import legend
from validation.recordings import Array, everywhere

NAME = "tails"
SEED = 20261214
RATE = 100.0
SAMPLES = 100_000
AXES = 6
STRUCTURE = "GM + WN + RW"
DECAY = float(np.exp(-1 / (20.0 * RATE)))
"""Of the Gauss-Markov process, per sample; its standard deviation is 0.1, a step of the random walk 1e-4."""

Rng = np.random.Generator
White = Callable[[int, Rng], Array]
Spoil = Callable[[Array, Rng], Array]


def normal(n: int, rng: Rng) -> Array:
    """Gaussian white noise."""
    return rng.standard_normal(n)


def student(freedom: float, n: int, rng: Rng) -> Array:
    """White noise with a t distribution, of unit variance."""
    return rng.standard_t(freedom, n) * np.sqrt((freedom - 2) / freedom)


def laplace(n: int, rng: Rng) -> Array:
    """White noise with a Laplace distribution, of unit variance."""
    return rng.laplace(size=n) / np.sqrt(2)


def alternating(factor: float, seconds: float, n: int, rng: Rng) -> Array:
    """White noise whose standard deviation is larger by a factor in every second period; unit variance on average."""
    loud = (np.arange(n) // round(seconds * RATE)) % 2 == 1
    scale = np.where(loud, factor, 1.0)
    return scale / np.sqrt(np.mean(scale**2)) * rng.standard_normal(n)


def low_pass(n: int, rng: Rng) -> Array:
    """White noise averaged over five samples: an output filter."""
    return np.convolve(rng.standard_normal(n + 4), np.full(5, 0.2), mode="valid")


def recording(white: White, n: int, rng: Rng) -> Array:
    """White noise, a Gauss-Markov process and a random walk."""
    slow = 0.1 * np.sqrt(1 - DECAY**2) * rng.standard_normal(n)
    slow[0] = 0.1 * rng.standard_normal()
    slow = lfilter([1.0], [1.0, -DECAY], slow)
    return np.asarray(white(n, rng) + slow + np.cumsum(1e-4 * rng.standard_normal(n)))


def nothing(x: Array, rng: Rng) -> Array:
    """The recording as it is."""
    return x


def rounded(step: float, x: Array, rng: Rng) -> Array:
    """Every sample to the nearest step, with the mean anywhere between two steps."""
    return step * np.rint(x / step + rng.uniform())


def knocks(share: float, size: float, x: Array, rng: Rng) -> Array:
    """Knocks that ring down within a second, in a share of the time."""
    spoilt, length = x.copy(), round(RATE)
    ring = np.exp(-4.0 * np.arange(length) / length)
    for start in rng.integers(0, x.size - length, max(1, round(share * x.size / length))):
        part = size * ring * rng.standard_normal(length)
        spoilt[start : start + length] += part - part.mean()
    return spoilt


def bursts(share: float, size: float, x: Array, rng: Rng) -> Array:
    """Bursts of 0.3 s, in a share of the time."""
    spoilt, length = x.copy(), round(0.3 * RATE)
    for start in rng.integers(0, x.size - length, max(1, round(share * x.size / length))):
        spoilt[start : start + length] += size * rng.standard_normal(length)
    return spoilt


def motion(size: float, x: Array, rng: Rng) -> Array:
    """Four seconds of motion, three periods of a sinusoid under a window."""
    spoilt, length = x.copy(), round(4 * RATE)
    start = int(rng.integers(0, x.size - length))
    wave = np.sin(6 * np.pi * np.arange(length) / length) * np.hanning(length)
    spoilt[start : start + length] += size * wave
    return spoilt


def spikes(share: float, size: float, x: Array, rng: Rng) -> Array:
    """Isolated wrong samples at random places, up or down."""
    wrong = rng.random(x.size) < share
    return x + wrong * size * rng.choice([-1.0, 1.0], x.size)


CASES: dict[str, tuple[White, Spoil, bool, str]] = {
    "Gaussian": (normal, nothing, True, "classical"),
    "t, 20 degrees of freedom": (partial(student, 20.0), nothing, True, "classical"),
    "t, 10 degrees of freedom": (partial(student, 10.0), nothing, True, "classical"),
    "t, 7 degrees of freedom": (partial(student, 7.0), nothing, True, "classical"),
    "t, 5 degrees of freedom": (partial(student, 5.0), nothing, True, "classical"),
    "Laplace": (laplace, nothing, True, "classical"),
    "sd 1.5 times as large every other 2 min": (partial(alternating, 1.5, 120.0), nothing, True, "classical"),
    "sd twice as large every other 40 s": (partial(alternating, 2.0, 40.0), nothing, True, "classical"),
    "rounded to 1 sd": (normal, partial(rounded, 1.0), False, "classical"),
    "rounded to 3 sd": (normal, partial(rounded, 3.0), False, "classical"),
    "low-pass": (low_pass, nothing, False, "classical"),
    "knocks, 0.1 % of the time, 50 sd": (normal, partial(knocks, 0.001, 50.0), True, "replaced"),
    "knocks, 1 % of the time, 10 sd": (normal, partial(knocks, 0.01, 10.0), True, "replaced"),
    "bursts, 0.1 % of the time, 10 sd": (normal, partial(bursts, 0.001, 10.0), True, "replaced"),
    "bursts, 1 % of the time, 30 sd": (normal, partial(bursts, 0.01, 30.0), True, "replaced"),
    "bursts, 3 % of the time, 30 sd": (normal, partial(bursts, 0.03, 30.0), True, "replaced"),
    "motion, 4 s, 10 sd": (normal, partial(motion, 10.0), True, "replaced"),
    "3 spikes of 25 sd": (normal, partial(spikes, 3e-5, 25.0), True, "replaced"),
    "1 % spikes of 10 sd": (normal, partial(spikes, 0.01, 10.0), True, "replaced"),
    "5 % spikes of 10 sd": (normal, partial(spikes, 0.05, 10.0), True, "replaced"),
    "5 % spikes of 30 sd": (normal, partial(spikes, 0.05, 30.0), True, "replaced"),
}
"""White noise, what is added, whether the true sum describes the recording, and what is wanted."""


def run(reduced: bool = False) -> dict[str, Any]:
    """For each case: share of robust curves, wrong samples replaced, N over its truth, coverage, and rejections."""
    count, samples = (3, 30_000) if reduced else (100, SAMPLES)
    names = list(CASES)[::3] if reduced else list(CASES)
    rows = []
    for name in names:
        seeds = [(SEED, list(CASES).index(name), k) for k in range(count)]
        out = np.array(everywhere(partial(_outcome, name, samples), seeds))
        described = CASES[name][2]
        rows.append(
            {
                "case": name,
                "wanted": CASES[name][3],
                "robust": float(out[:, 0].mean()),
                "replaced": float(out[:, 1].mean() / samples),
                "excess": float(np.median(out[:, 2])),
                "n": float(np.median(out[:, 3])) if described else None,
                "covered": float(out[:, 4].mean()) if described else None,
                "rejected": float(out[:, 5].mean()) if described else None,
            }
        )
    return {"recordings": count, "samples": samples, "rate": RATE, "axes": AXES, "structure": STRUCTURE, "rows": rows}


def _outcome(name: str, samples: int, seed: tuple[int, ...]) -> Array:
    """Robust curve; samples replaced; N E_11; N over its truth; whether its interval covers; whether it is rejected."""
    white, spoil, described, _ = CASES[name]
    rng = np.random.default_rng(seed)
    x = spoil(recording(white, samples, rng), rng)
    options = CalibrationOptions()
    recordings = Recordings.of(gmwm.Signal(x, RATE, "rad/s", "gyro_x"), options)
    measured = measure(replace(recordings, comparisons=AXES), options).axes["gyro_x"]
    assert isinstance(measured, MeasuredAxis)
    wv, verdict = measured.curve(options), measured.verdicts[""]
    excess = 0.0 if wv.excess is None else samples * float(wv.excess[0, 0])
    replaced = verdict.replaced.spikes + verdict.replaced.in_knocks
    row = [float(wv.robust), float(replaced), excess, np.nan, np.nan, np.nan]
    if described:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", gmwm.errors.FitWarning)
            fit = gmwm.fit(STRUCTURE, wv, weighting="optimal", certify=False)
        low, high = fit.confidence_intervals()["WN.sigma2"]
        value = fit.parameters["WN.sigma2"]
        row[3:] = [np.sqrt(value), float(low <= 1.0 <= high), float(fit.goodness_of_fit().pvalue <= 0.05)]
    return np.array(row)


def table(result: dict[str, Any]) -> str:
    """Markdown: one line for each case."""

    def share(value: float | None, digits: int = 0) -> str:
        return "" if value is None else f"{100 * value:.{digits}f} %"

    lines = [
        f"{result['recordings']} recordings each of {result['samples']} samples at {result['rate']:g} Hz are "
        "simulated. The noise is white noise of unit variance, a Gauss-Markov process (20 s, standard deviation 0.1) "
        f"and a random walk (1e-4 per sample). Each recording is measured as one axis of {result['axes']} with the "
        f"rule of `calibrate`, and fitted with {result['structure']} and optimal weights.",
        *legend(
            {
                "wanted": (
                    "curve that `calibrate` should choose, which is the classical curve for heavy tails, and the "
                    "classical curve after replacement for knocks, motion and isolated wrong samples"
                ),
                "robust": "share of recordings with the robust curve",
                "replaced": "share of samples that were replaced",
                "excess": (
                    "median of N E_11, where N is the number of samples and E_11 is the element of "
                    "`WaveletVariance.excess` for the first level; for white noise, N E_11 is the excess kurtosis"
                ),
                "N": "median of N divided by the true value",
                "covered": "share of 95 % intervals that contain the variance of the white noise",
                "rejected": "share of goodness-of-fit tests that reject at the 5 % level",
            }
        ),
        "",
        "An entry is missing if the fitted sum is not the true model.",
        "",
        "| recording | wanted | robust | replaced | excess | N | covered | rejected |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {r['case']} | {r['wanted']} | {share(r['robust'])} | {share(r['replaced'], 2)} | {r['excess']:.2g} "
        f"| {'' if r['n'] is None else format(r['n'], '.3f')} | {share(r['covered'], 1)} | {share(r['rejected'], 1)} |"
        for r in result["rows"]
    ]
    return "\n".join(lines)
