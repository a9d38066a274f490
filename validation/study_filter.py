"""N and K of a filter against filters that run on simulated noise, in plain NumPy and apart from the package.

A filter of white noise N and a random walk K in its steady state smooths the noise of a sensor at rest exponentially.
Its estimate predicts the mean of the noise over the next 1, 10 and 60 s. The gain, the error that the filter states,
and the noise are computed here; only N and K come from the package. So do σ and T of the filters with a Gauss-Markov
bias.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

import gmwm
from gmwm.choosing.datasheets.filter_numbers import filter_numbers, smallest_error
from gmwm.showing.exporters.one_state import Predictions, fit_biases
from gmwm.showing.exporters.two_states import LONGEST_AVERAGING_S, POINTS, Curve

NAME = "filter"
SEED = 20261128
RATE = 10.0
RUNS = 12
HOURS = 3.6
WARM_UP = 0.3
"""Share of a recording that is left out, in which the filter settles."""
TIMES = (1.0, 10.0, 60.0)
FITS, FIT_HOURS = 200, 1.0
"""Number and length of the recordings from which the intervals are computed."""
WHITE = 156.0
"""White noise (deg/h·√s, which is 2.6 deg/√h)."""

Array = NDArray[np.float64]
Noise = Callable[[int, np.random.Generator], Array]


# --- simulators (deg/h) -----------------------------------------------------------------------------


def white(density: float) -> Noise:
    """White noise."""
    return lambda n, rng: density * math.sqrt(RATE) * rng.standard_normal(n)


def walk(coefficient: float) -> Noise:
    """Random walk."""
    return lambda n, rng: np.asarray(np.cumsum(coefficient / math.sqrt(RATE) * rng.standard_normal(n)))


def markov(sigma: float, time: float) -> Noise:
    """Gauss-Markov process."""
    decay = math.exp(-1 / (time * RATE))

    def draw(n: int, rng: np.random.Generator) -> Array:
        steps = sigma * math.sqrt(1 - decay**2) * rng.standard_normal(n)
        steps[0] = sigma * rng.standard_normal()
        return np.asarray(lfilter([1.0], [1.0, -decay], steps))

    return draw


def telegraph(size: float, dwell: float) -> Noise:
    """Random telegraph noise: the levels ±size, with exponential times of mean `dwell` (s) between changes."""

    def draw(n: int, rng: np.random.Generator) -> Array:
        changes = rng.random(n) < 0.5 * (1 - math.exp(-2 / (dwell * RATE)))
        return np.asarray(size * rng.choice([-1.0, 1.0]) * (-1.0) ** np.cumsum(changes))

    return draw


def flicker(coefficient: float) -> Noise:
    """Flicker noise with the density B²/(2π|f|) of the standard, by half an integration (Kasdin 1995)."""

    def draw(n: int, rng: np.random.Generator) -> Array:
        long = 4 * n
        weights = np.cumprod(np.r_[1.0, (np.arange(1, long) - 0.5) / np.arange(1, long)])
        spectrum = np.fft.rfft(weights, 2 * long) * np.fft.rfft(rng.standard_normal(long), 2 * long)
        return np.asarray(coefficient * np.fft.irfft(spectrum, 2 * long)[long - n : long])

    return draw


def _gm(sigma: float, time: float) -> str:
    return f"GM(beta={1 / time!r}, sigma2={sigma**2!r})"


def _wn(density: float) -> str:
    return f"WN(sigma2={density**2 * RATE!r})"


MODELS: dict[str, tuple[tuple[Noise, ...], str]] = {
    "RW 5": ((white(WHITE), walk(5.0)), f"{_wn(WHITE)} + RW(gamma2={25.0 / RATE!r})"),
    "FN 42": ((white(WHITE), flicker(42.0)), f"{_wn(WHITE)} + FN(b2={42.0**2!r})"),
    "GM 50, 1 s": ((white(WHITE / 4), markov(50.0, 1.0)), f"{_wn(WHITE / 4)} + {_gm(50.0, 1.0)}"),
    "GM 50, 15 s": ((white(WHITE / 4), markov(50.0, 15.0)), f"{_wn(WHITE / 4)} + {_gm(50.0, 15.0)}"),
    "GM 50, 100 s": ((white(WHITE / 4), markov(50.0, 100.0)), f"{_wn(WHITE / 4)} + {_gm(50.0, 100.0)}"),
    "GM 50, 300 s": ((white(WHITE / 4), markov(50.0, 300.0)), f"{_wn(WHITE / 4)} + {_gm(50.0, 300.0)}"),
    "GM 40, 20 s + GM 50, 400 s": (
        (white(WHITE), markov(40.0, 20.0), markov(50.0, 400.0)),
        f"{_wn(WHITE)} + {_gm(40.0, 20.0)} + {_gm(50.0, 400.0)}",
    ),
    "FN 30 + RW 2": (
        (white(WHITE), flicker(30.0), walk(2.0)), f"{_wn(WHITE)} + FN(b2={30.0**2!r}) + RW(gamma2={4.0 / RATE!r})",
    ),
    "RTN 40, 200 s": ((white(WHITE), telegraph(40.0, 200.0)), f"{_wn(WHITE)} + {_gm(40.0, 100.0)}"),
}  # fmt: skip
"""Slow noise beside the white noise: simulators, and the model from which N and K are computed. RTN with a mean time d
between changes has the spectrum of a Gauss-Markov process with the correlation time d/2."""

COVERED = {"RW 5": "WN + RW", "FN 42": "WN + FN", "GM 50, 15 s": "GM + WN", "GM 50, 100 s": "GM + WN"}
"""Models of the recordings from which the intervals are computed, and the models that are fitted to them."""


# --- filters ----------------------------------------------------------------------------------------


def gain_of(bandwidth: float) -> float:
    """FilterGain of the steady-state filter, g²/(1 − g) = (w Δt)²."""
    return bandwidth * (math.sqrt(bandwidth**2 + 4) - bandwidth) / 2


def errors(signals: list[Array], bandwidth: float) -> list[float]:
    """Mean square of the error with which a filter of the bandwidth w Δt predicts the mean over each of `TIMES`."""
    gain = gain_of(bandwidth)
    squares: list[list[float]] = [[] for _ in TIMES]
    for signal in signals:
        estimate = lfilter([gain], [1.0, gain - 1.0], signal)
        sums = np.concatenate([[0.0], np.cumsum(signal)])
        first = round(WARM_UP * signal.size)
        for square, time in zip(squares, TIMES, strict=True):
            n = round(time * RATE)
            ahead = (sums[n:] - sums[:-n]) / n
            square.append(float(np.mean((ahead[first + 1 :] - estimate[first:-n]) ** 2)))
    return [float(np.mean(square)) for square in squares]


def stated(density: float, coefficient: float) -> list[float]:
    """Mean square that the filter states: N²/T, its error, and the random walk over the time."""
    bandwidth = coefficient / (density * RATE)
    numbers = [round(time * RATE) for time in TIMES]
    walked = [bandwidth**2 * (n + 1) * (2 * n + 1) / (6 * n) for n in numbers]
    return [density**2 * RATE * (1 / n + gain_of(bandwidth) + w) for n, w in zip(numbers, walked, strict=True)]


def with_state(signals: list[Array], density: float, sigma: float, time: float) -> tuple[list[float], list[float]]:
    """Mean square of the real and of the stated error of a filter of white noise and a Gauss-Markov bias."""
    decay, noise = math.exp(-1 / (time * RATE)), density**2 * RATE
    step = sigma**2 * (1 - decay**2)
    half = (noise * (1 - decay**2) - step) / 2
    before = math.sqrt(half**2 + step * noise) - half  # the scalar Riccati equation
    gain = before / (before + noise)
    real, claims = [], []
    for length in TIMES:
        n = round(length * RATE)
        powers = np.cumsum(decay ** np.arange(n))  # responses of the sum to a step in each sample, the last one first
        ahead = decay * powers[-1] / n
        claims.append((ahead * n) ** 2 / n**2 * gain * noise + (step * float(powers @ powers) + n * noise) / n**2)
        squares = []
        for signal in signals:
            estimate = lfilter([gain], [1.0, -decay * (1 - gain)], signal)
            sums = np.concatenate([[0.0], np.cumsum(signal)])
            first = round(WARM_UP * signal.size)
            mean = (sums[n:] - sums[:-n]) / n
            squares.append(float(np.mean((mean[first + 1 :] - ahead * estimate[first:-n]) ** 2)))
        real.append(float(np.mean(squares)))
    return real, claims


# --- the study --------------------------------------------------------------------------------------


def run(reduced: bool = False) -> dict[str, Any]:
    """Return the error of each filter over the smallest error of any K, and the stated over the real error."""
    rng = np.random.default_rng(SEED)
    samples = round((1.2 if reduced else HOURS) * 3600 * RATE)
    rows = []
    for name, (noises, text) in MODELS.items():
        signals = [np.sum([noise(samples, rng) for noise in noises], axis=0) for _ in range(4 if reduced else RUNS)]
        processes = gmwm.Model.parse(text).processes
        numbers = filter_numbers(processes, RATE)
        bandwidth = numbers.K / (numbers.N * RATE)
        made = errors(signals, bandwidth)
        tried = np.array([errors(signals, bandwidth * factor) for factor in np.geomspace(0.05, 5.0, 25)])
        full = [smallest_error(processes, RATE, round(time * RATE)) for time in TIMES]
        noise = Predictions.of(_curve(text), processes, 1.0, LONGEST_AVERAGING_S)
        real, claims = made, made
        if noise.K > 0:
            (sigma,), time = fit_biases([noise], 1.0, LONGEST_AVERAGING_S)
            real, claims = with_state(signals, numbers.N, sigma, time)
        best = np.minimum(tried.min(axis=0), made)
        rows.append(
            {
                "noise": name, "N": numbers.N, "K": numbers.K,
                "loss": np.sqrt(made / best).tolist(),
                "claim": np.sqrt(np.array(stated(numbers.N, numbers.K)) / made).tolist(),
                "state": np.sqrt(real / best).tolist(), "state_claim": np.sqrt(np.array(claims) / real).tolist(),
                "full": [math.sqrt(m / f) for m, f in zip(made, full, strict=True) if f is not None],
            }
        )  # fmt: skip
    return {"rows": rows, "coverage": _coverage(rng, 40 if reduced else FITS)}


def _curve(text: str) -> Curve:
    clusters = np.unique(np.round(np.geomspace(1.0, LONGEST_AVERAGING_S, POINTS) * RATE).astype(np.int64))
    return Curve(clusters, RATE, gmwm.Model.parse(text).allan_variance(clusters, RATE))


def _coverage(rng: np.random.Generator, fits: int) -> list[dict[str, Any]]:
    samples, found = round(FIT_HOURS * 3600 * RATE), []
    for name, model in COVERED.items():
        noises, text = MODELS[name]
        truth = filter_numbers(gmwm.Model.parse(text).processes, RATE)
        inside = {"N": 0, "K": 0}
        for _ in range(fits):
            signal = np.sum([noise(samples, rng) for noise in noises], axis=0)
            sheet = gmwm.fit(model, gmwm.Signal(signal, RATE), certify=False).datasheet()
            for symbol in inside:
                entry = sheet[symbol]
                inside[symbol] += entry.low <= getattr(truth, symbol) <= entry.high
        found.append({"noise": name, "fits": fits, **{symbol: count / fits for symbol, count in inside.items()}})
    return found


def table(result: dict[str, Any]) -> str:
    """Return the result as Markdown."""
    times = " / ".join(f"{time:g}" for time in TIMES)
    lines = [
        f"A filter with white noise N and a random walk K runs on simulated noise of {HOURS:g} h at {RATE:g} Hz, "
        f"{RUNS} recordings for each row. It predicts the mean over the next {times} s. N and K come from the spectrum "
        "of the model with the default horizon of 1 s ([the two numbers of a filter](../concepts/two-numbers.md)). "
        "Simulators and filters are written in plain NumPy apart from the package; flicker noise is made by half an "
        "integration (Kasdin). All numbers are in deg/h and s; the white noise is 2.6 deg/√h, or 0.65 deg/√h beside a "
        "single Gauss-Markov term.",
        "",
        f"| slow noise | N (deg/√h) | K (deg/h/√h) | error / smallest error of any K at {times} s "
        "| stated / real error | with σ and T: error / smallest error of any K | stated / real error "
        "| N and K: error / error of a filter with the full model |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        keys = ("loss", "claim", "state", "state_claim", "full")
        shown = (" / ".join(f"{x:.2f}" for x in row[key]) for key in keys)
        lines.append(f"| {row['noise']} | {row['N'] / 60:.3f} | {60 * row['K']:.0f} | {' | '.join(shown)} |")
    exceptions = [row["noise"] for row in result["rows"] if max(row["loss"]) > 1.05]
    outside = [row["noise"] for row in result["rows"] if not all(0.8 <= claim <= 1.3 for claim in row["claim"])]
    lines += [
        "",
        f"With N and K, the error exceeds the smallest one by more than 5 % for {_list(exceptions)}. The stated error "
        f"is outside 0.8 to 1.3 of the real error for {_list(outside)}. The columns *with σ and T* are for a filter "
        "whose bias is a Gauss-Markov process, with the N, σ and T of the files for such programs. It forgets its "
        "bias, so that it predicts a noise whose correlation time is shorter than the prediction.",
        "",
        f"The 95 % intervals of N and K contain the numbers of the true model in these shares of {FITS} recordings of "
        f"{FIT_HOURS:g} h:",
        "",
        "| slow noise | N | K |",
        "|---|---|---|",
        *(f"| {row['noise']} | {100 * row['N']:.1f} % | {100 * row['K']:.1f} % |" for row in result["coverage"]),
    ]
    return "\n".join(lines)


def _list(names: list[str]) -> str:
    return "none" if not names else "; ".join(names)
