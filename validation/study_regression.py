"""Regression on conditions: coverage, false findings, and what a poorly known covariate costs.

Series are simulated with NumPy alone: six kinds of noise beside four courses of the temperature. The temperature has no
effect in the first part, so that every finding is false; intervals do not depend on the size of an effect.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

import gmwm
from gmwm.fitting.inference import noise_against
from gmwm.measuring.regression.against import CovariateTerm
from gmwm.measuring.regression.api import regress
from gmwm.measuring.regression.covariates import Covariates
from validation.legend import legend

NAME = "regression"
SEED = 20261123
SAMPLES = 1 << 15
REPEATS = 300
MORE = 100
"""Series of each row of the later parts, which take less time."""
BLOCK = 32
"""Block whose means give the covariance matrix of generalised least squares."""

Noise = tuple[float, float, tuple[tuple[float, float], ...], float]
"""Variances of white noise and of a step of the walk, Gauss-Markov processes (correlation time, variance), B² of FN."""
Vector = NDArray[np.float64]
NOISES: dict[str, tuple[str, Noise]] = {
    "WN": ("WN", (1.0, 0.0, (), 0.0)),
    "WN + RW": ("WN + RW", (1.0, 4e-6, (), 0.0)),
    "WN + RW, strong": ("WN + RW", (1.0, 1e-3, (), 0.0)),
    "GM + WN": ("GM + WN", (1.0, 0.0, ((200.0, 0.05),), 0.0)),
    "GM + WN + RW": ("GM + WN + RW", (1.0, 1e-6, ((200.0, 0.05),), 0.0)),
    "WN + FN": ("WN + FN", (1.0, 0.0, (), 1e-3)),
}
COURSES = ("warm-up", "chamber steps", "day cycle", "independent walk")
DEPARTURES = (
    "none", "heavy tails", "gaps", "wrong samples", "steps of 1 °C", "reading noise 0.5 °C", "reading noise 2 °C",
    "readings held for 100 samples", "lag of 1500 samples ignored", "lag of 1500 samples estimated",
)  # fmt: skip
READINGS = (
    "noise 0.2 °C",
    "noise 0.5 °C",
    "noise 2 °C",
    "noise 4 °C",
    "steps 0.5 °C",
    "steps 1 °C",
    "steps 2 °C",
    "held 0.2 °C",
)
"""Reading errors: white noise, steps, and noise that is held for 100 samples."""
CHANGES = (("WN", "warm-up"), ("WN + RW", "warm-up"), ("WN + RW", "day cycle"), ("GM + WN", "day cycle"))
"""Noise and course of the study of noise that depends on the temperature."""
SLOPE = 0.1
"""Effect in the second part (1/°C)."""


def run(reduced: bool = False) -> dict[str, Any]:
    """Coverage and size for each noise and course, and the slope under each departure."""
    rows: list[dict[str, Any]] = []
    count, more = (4, 4) if reduced else (REPEATS, MORE)
    names, courses = (list(NOISES)[1:2], COURSES[:1]) if reduced else (list(NOISES), COURSES)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for place, name in enumerate(names):
            for turn, course in enumerate(courses):
                rng = np.random.default_rng([SEED, 0, place, turn])
                rows.append({"noise": name, "course": course, **_judged(name, course, count, rng)})
        for place, departure in enumerate(DEPARTURES[:2] if reduced else DEPARTURES):
            rng = np.random.default_rng([SEED, 1, place])
            rows.append({"departure": departure, **_departed(departure, count, rng)})
        for place, reading in enumerate(READINGS[:1] if reduced else READINGS):
            for turn, course in enumerate(COURSES[:1] if reduced else ("warm-up", "day cycle")):
                rng = np.random.default_rng([SEED, 2, place, turn])
                rows.append({"reading": reading, "course": course, **_read(reading, course, more, rng)})
        for place, (name, course) in enumerate(CHANGES[:1] if reduced else CHANGES):
            for change in (0.0, 0.02):
                rng = np.random.default_rng([SEED, 3, place, int(change > 0)])
                rows.append({"changing": name, "course": course, "change": change,
                             **_changed(name, course, change, count=more, rng=rng)})  # fmt: skip
        rng = np.random.default_rng([SEED, 4])
        rows.append({"conditions": "WN + RW", **_known(more, rng)})
    return {"samples": SAMPLES, "rows": rows}


def temperature(course: str, rng: np.random.Generator, lag: int = 0) -> Vector:
    """A course of the temperature (°C), `lag` samples before; no lag of chamber steps and walks."""
    t = (np.arange(SAMPLES) - lag) / SAMPLES
    if course == "warm-up":
        return np.asarray(15 * (1 - np.exp(-5 * t)) + 1.5 * np.sin(6 * np.pi * t))
    if course == "chamber steps":
        levels = np.repeat(np.array([20.0, 40.0, 0.0, 60.0, -10.0, 30.0, 50.0, 10.0]), SAMPLES // 8)
        return np.asarray(lfilter([1 / 300], [1, 1 / 300 - 1], levels - 20.0))
    if course == "day cycle":
        return np.asarray(5 * np.sin(4 * np.pi * t + 0.3))
    return np.asarray(0.05 * np.cumsum(rng.normal(size=SAMPLES)))


def drawn(noise: Noise, rng: np.random.Generator, tails: float | None = None) -> Vector:
    """One series of noise; with `tails`, its white noise has Student's t distribution with so many degrees."""
    white, walk, markov, flicker = noise
    own = rng.normal(size=SAMPLES)
    if tails is not None:
        own = rng.standard_t(tails, size=SAMPLES) * np.sqrt((tails - 2) / tails)
    x = np.sqrt(white) * own + np.sqrt(walk) * np.cumsum(rng.normal(size=SAMPLES))
    for time, variance in markov:
        decay = np.exp(-1 / time)
        e = np.sqrt(variance * (1 - decay**2)) * rng.normal(size=SAMPLES)
        e[0] /= np.sqrt(1 - decay**2)
        x = x + lfilter([1.0], [1.0, -decay], e)
    if flicker:
        size = 8 * SAMPLES
        f = np.fft.rfftfreq(size)
        f[0] = np.inf
        z = rng.normal(size=f.size) + 1j * rng.normal(size=f.size)
        x = x + np.fft.irfft(z * np.sqrt(flicker / (2 * np.pi * f) / 2 * size), size)[:SAMPLES]
    return np.asarray(x)


def truth(noise: Noise) -> dict[str, float]:
    """The true parameters by name."""
    white, walk, markov, flicker = noise
    found = {"WN.sigma2": white, "RW.gamma2": walk, "FN.b2": flicker}
    for time, variance in markov:
        found |= {"GM.beta": 1 / time, "GM.sigma2": variance}
    return {name: value for name, value in found.items() if value}


def exact_error(noise: Noise, course: Vector) -> float | None:
    """Standard error of generalised least squares with the covariance matrix of block means; None for flicker noise."""
    white, walk, markov, flicker = noise
    if flicker:
        return None
    lags = np.abs(np.arange(-SAMPLES + 1, SAMPLES))
    k = white * (lags == 0) - walk / 2 * lags
    for time, variance in markov:
        k = k + variance * np.exp(-lags / time)
    triangle = (BLOCK - np.abs(np.arange(-BLOCK + 1, BLOCK))) / BLOCK**2
    means = np.convolve(k, triangle, mode="same")[SAMPLES - 1 :: BLOCK]
    n = SAMPLES // BLOCK
    matrix = means[np.abs(np.subtract.outer(np.arange(n), np.arange(n)))]
    difference = np.diff(np.eye(n), axis=0)
    x = difference @ course.reshape(n, BLOCK).mean(axis=1)
    return float(1 / np.sqrt(x @ np.linalg.solve(difference @ matrix @ difference.T, x)))


def _judged(name: str, course: str, count: int, rng: np.random.Generator) -> dict[str, Any]:
    text, noise = NOISES[name]
    wanted = truth(noise)
    found = []
    for _ in range(count):
        own = temperature(course, rng)
        signal = gmwm.Signal(drawn(noise, rng), 1.0)
        fit = gmwm.fit(text, signal, against={"temperature": own}, weighting="optimal", certify=False)
        assert fit.regression is not None
        one = fit.regression["temperature"]
        low, high = one.interval()
        intervals = fit.confidence_intervals()
        covers = [
            name in intervals and intervals[name][0] <= value <= intervals[name][1] for name, value in wanted.items()
        ]
        exact = exact_error(noise, own) if course == "independent walk" or not found else found[0][3]
        walk = fit.parameters["RW.gamma2"] / noise[1] if noise[1] else np.nan
        found.append(
            (low <= 0 <= high, fit.regression.pvalue, one.value, exact, covers, walk, fit.goodness_of_fit().pvalue)
        )
    exacts = np.array([np.nan if one[3] is None else one[3] for one in found])
    ratio = np.sqrt(np.mean((np.array([one[2] for one in found]) / exacts) ** 2))
    walks = np.array([one[5] for one in found])
    return {
        "series": count,
        "covered": float(np.mean([one[0] for one in found])),
        "false": float(np.mean([one[1] < 0.05 for one in found])),
        "error": None if np.isnan(ratio) else float(ratio),
        "noise_covered": dict(zip(wanted, np.mean([one[4] for one in found], axis=0).tolist(), strict=True)),
        "walk": None if np.isnan(walks).all() else float(np.sqrt(np.median(walks))),
        "rejected": float(np.mean([one[6] < 0.05 for one in found])),
    }


def _departed(departure: str, count: int, rng: np.random.Generator) -> dict[str, Any]:
    text, noise = NOISES["WN + RW"]
    slopes, covered, walks = [], [], []
    for _ in range(count):
        own = temperature("warm-up", rng)
        x = drawn(noise, rng, 3.0 if departure == "heavy tails" else None)
        seen, form, felt = own, "temperature", own
        if departure == "steps of 1 °C":
            seen = np.round(own)
        elif departure.startswith("reading noise"):
            seen = own + float(departure.split()[2]) * rng.normal(size=SAMPLES)
        elif departure.startswith("readings held"):
            seen = np.repeat((own + 0.2 * rng.normal(size=SAMPLES))[::100], 100)[:SAMPLES]
        elif departure.startswith("lag"):
            felt = temperature("warm-up", rng, 1500)
            form = "temperature:lag" if departure.endswith("estimated") else form
        elif departure == "wrong samples":
            x[rng.integers(SAMPLES, size=10)] += 30.0
        y = x + SLOPE * felt
        signal = gmwm.Signal(y, 1.0)
        if departure == "gaps":
            missing = np.zeros(SAMPLES, dtype=bool)
            for first in rng.integers(SAMPLES - 200, size=8):
                missing[first : first + 200] = True
            signal = gmwm.Signal.from_missing(np.where(missing, np.nan, y), 1.0)
            seen = seen[~missing]
        try:
            fit = gmwm.fit(
                text,
                signal,
                against={form: seen},
                weighting="optimal",
                certify=False,
            )
        except gmwm.errors.DataError:
            continue
        assert fit.regression is not None
        one = fit.regression["temperature"]
        low, high = one.interval()
        slopes.append(one.value / SLOPE)
        covered.append(low <= SLOPE <= high)
        walks.append(fit.parameters["RW.gamma2"] / noise[1])
    return {
        "series": count,
        "accepted": len(slopes) / count,
        "slope": float(np.median(slopes)) if slopes else None,
        "covered": float(np.mean(covered)) if slopes else None,
        "walk": float(np.sqrt(np.median(walks))) if slopes else None,
    }


def _read(reading: str, course: str, count: int, rng: np.random.Generator) -> dict[str, Any]:
    """The slope with a reading error minus that of the same series without one, in slopes."""
    noise = NOISES["WN + RW"][1]
    kind, size = reading.split()[0], float(reading.split()[1])
    found = []
    for _ in range(count):
        own = temperature(course, rng)
        signal = gmwm.Signal(drawn(noise, rng) + SLOPE * own, 1.0)
        error = size * rng.normal(size=SAMPLES)
        seen = {
            "noise": own + error,
            "steps": size * np.round(own / size),
            "held": np.repeat((own + error)[::100], 100)[:SAMPLES],
        }[kind]
        slopes = []
        for values in (own, seen):
            try:
                covariates = Covariates.of([CovariateTerm("temperature")], {"temperature": values}, signal)
            except gmwm.errors.DataError:
                continue
            slopes.append(regress(signal, covariates)["temperature"].value)
        if len(slopes) == 2:
            found.append((slopes[1] - slopes[0]) / SLOPE)
    return {
        "series": count,
        "accepted": len(found) / count,
        "attenuation": float(np.mean(found)) if found else None,
        "attenuation_error": float(np.std(found) / np.sqrt(len(found))) if found else None,
    }


def _changed(name: str, course: str, change: float, *, count: int, rng: np.random.Generator) -> dict[str, Any]:
    """The test of a noise whose white part depends on the temperature, and the slope of this part."""
    text, (white, *rest) = NOISES[name]
    rejected, covered, slopes, left = [], [], [], []
    for _ in range(count):
        own = temperature(course, rng)
        own *= 10.0 / np.ptp(own)
        away = own - own.mean()
        x = np.exp(change * away) * np.sqrt(white) * rng.normal(size=SAMPLES)
        signal = gmwm.Signal(x + drawn((0.0, *rest), rng) + SLOPE * own, 1.0)
        found = noise_against(signal, {"temperature": own}, model=text)
        one = found.terms["WN"]
        rejected.append(found.pvalue < 0.05)
        left.append(found.pvalue_terms is not None and found.pvalue_terms < 0.05)
        slopes.append(one.value)
        covered.append(abs(one.value - change) < 1.96 * one.error)
    return {
        "series": count,
        "found": float(np.mean(rejected)),
        "left": float(np.mean(left)),
        "slope": float(np.mean(slopes)),
        "covered": float(np.mean(covered)),
    }


def _known(count: int, rng: np.random.Generator) -> dict[str, Any]:
    """Fits to four known conditions: coverage of the coefficients, and sizes of both tests."""
    _, (white, walk, _, _) = NOISES["WN + RW"]
    rates = (0.0, 50.0, 100.0, 200.0)
    wanted = {"WN.sigma2 (1)": white, "WN.sigma2 (rate^2)": 1e-4 * white, "RW.gamma2": walk}
    covers, rejected, constant = [], [], []
    for _ in range(count):
        series = [[drawn((white * (1 + k * (rate / 100) ** 2), walk, (), 0.0), rng) for rate in rates] for k in (1, 0)]
        one, other = (
            gmwm.fit(
                "WN + RW", {r: gmwm.Signal(x, 1.0) for r, x in zip(rates, own, strict=True)},
                varies={"WN": "1 + rate**2"}, certify=False,
            )
            for own in series
        )  # fmt: skip
        ends = [one.estimates[name].interval() for name in wanted]
        covers.append([low <= value <= high for (low, high), value in zip(ends, wanted.values(), strict=True)])
        rejected.append(one.pvalue < 0.05)
        constant.append((other.pvalue_constant or 0.0) < 0.05)
    return {
        "series": count,
        "covered": dict(zip(wanted, np.mean(covers, axis=0).tolist(), strict=True)),
        "rejected": float(np.mean(rejected)),
        "false": float(np.mean(constant)),
    }


def table(result: dict[str, Any]) -> str:
    """Markdown: coverage and size, and the departures."""
    lines = [
        f"These series of {result['samples']} samples are simulated with NumPy alone, and "
        "each is fitted with `gmwm.fit` and `against`. The temperature has no effect.",
        *legend(
            {
                "covered": "share of 95 % intervals of the slope that contain zero",
                "false": "share of F tests with p < 5 %",
                "error": (
                    "root mean square error of the slope, divided by the standard error of "
                    "generalised least squares with the true covariance matrix"
                ),
                "noise covered": (
                    "share of 95 % intervals that contain the true value, for the noise parameter with the lowest share"
                ),
                "K": "median of K divided by the true value",
                "rejected": "share of goodness-of-fit tests with p < 5 %",
            }
        ),
        "",
        "| noise | temperature | series | covered | false | error | noise covered | K | rejected |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        if "noise" in row:
            numbers = ["" if row[name] is None else f"{row[name]:.2f}" for name in ("error", "walk")]
            shares = [f"{row[name]:.0%}" for name in ("covered", "false", "rejected")]
            least = f"{min(row['noise_covered'].values()):.0%}"
            cells = (row["noise"], row["course"], row["series"], *shares[:2], numbers[0], least, numbers[1], shares[2])
            lines.append(f"| {' | '.join(map(str, cells))} |")
    lines += [
        "",
        f"These series have the noise WN + RW, a warm-up and a slope of {SLOPE:g} per °C. "
        "In the row *wrong samples*, ten samples are wrong by 30 standard deviations of the white noise.",
        *legend(
            {
                "accepted": "share of series whose temperature is known at enough scales",
                "slope, K": "medians divided by the true values",
                "covered": "share of 95 % intervals of the slope that contain the true value",
            }
        ),
        "",
        "| departure | series | accepted | slope | covered | K |",
        "|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        if "departure" in row:
            cells = [row["departure"], row["series"], f"{row['accepted']:.0%}"]
            cells += ["", "", ""] if row["slope"] is None else [
                f"{row['slope']:.3f}", f"{row['covered']:.0%}", f"{row['walk']:.2f}",
            ]  # fmt: skip
            lines.append(f"| {' | '.join(map(str, cells))} |")
    lines += [
        "",
        "The table shows by how much a reading error changes the slope, in per cent of the slope, with its standard "
        "error. The noise is WN + RW. *Held*: each reading is held for 100 samples.",
        "",
        "| reading | temperature | series | accepted | change of the slope |",
        "|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        if "reading" in row:
            change = "" if row["attenuation"] is None else (
                f"{100 * row['attenuation']:+.1f} ± {100 * row['attenuation_error']:.1f} %"
            )  # fmt: skip
            cells = [row["reading"], row["course"], row["series"], f"{row['accepted']:.0%}", change]
            lines.append(f"| {' | '.join(map(str, cells))} |")
    lines += [
        "",
        "`gmwm.inference.noise_against` tests series in which the standard deviation of "
        "the white noise changes by 0 or 2 % per °C, over 10 °C.",
        *legend(
            {
                "found": "share of joint tests with p < 5 %",
                "left": "share of tests with p < 5 %; the hypothesis is that changes of the terms explain the changes "
                "at all levels",
            }
        ),
        "",
        "| noise | temperature | true change | series | found | mean change | covered | left |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        if "changing" in row:
            cells = [row["changing"], row["course"], f"{100 * row['change']:g} %", row["series"], f"{row['found']:.0%}"]
            cells += [f"{100 * row['slope']:.2f} %", f"{row['covered']:.0%}", f"{row['left']:.0%}"]
            lines.append(f"| {' | '.join(map(str, cells))} |")
    for row in result["rows"]:
        if "conditions" in row:
            shares = ", ".join(f"{name} {share:.0%}" for name, share in row["covered"].items())
            lines += [
                "",
                f"`gmwm.fit` with `varies` was applied to {row['series']} series at four rates. "
                f"Share of 95 % intervals that contain the true value: {shares}. The "
                f"goodness-of-fit test rejects {row['rejected']:.0%}. The test that nothing varies "
                f"rejects {row['false']:.0%} of the series in which nothing varies.",
            ]
    return "\n".join(lines)
