"""Reduced coverage of 95 % intervals: short recordings, terms estimated as zero, model selection.

Three times the data hardly show what the theory of the intervals takes as shown: a Gauss-Markov process of which a
recording holds few correlation times; a term that is there and is estimated as zero, which its neighbours then pay
for; and a model that was chosen by the same data, and lacks such a term.
"""

from __future__ import annotations

import warnings
from functools import partial
from typing import Any

import numpy as np

import gmwm
from validation import recordings
from validation.legend import legend

NAME = "short"
SEED = 20261204
RATE = 100.0

SLOW = "GM(beta=2.0, sigma2=1.0) + WN(sigma2=1.0)"
"""A correlation time of 50 samples, under white noise of the same variance."""
TIMES = (10, 15, 20, 30, 40, 60, 100)
"""Correlation times in a recording."""
PROFILED = 30
"""Up to so many of them, intervals by likelihood are looked at too."""
SAMPLES_PER_TIME = 50

BESIDE = (
    ("WN(sigma2=1.0) + DR(omega=1e-4) + RW(gamma2=1e-6)", 20_000, "DR.omega", "RW"),
    ("GM(beta=0.5, sigma2=2e-7) + WN(sigma2=4e-6) + RW(gamma2=1.2e-12)", 100_000, "GM.beta", "RW"),
)
"""Truth, samples, a parameter, and the neighbour that the recordings hardly show."""

Row = dict[str, Any]


def run(reduced: bool = False) -> dict[str, Any]:
    """Shares of intervals that contain the true value: by length, beside a term that is zero, and of the model
    chosen."""
    count, followed = (16, 6) if reduced else (400, 200)
    rows: list[Row] = []
    for times in (10, 100) if reduced else TIMES:
        rows += by_length(times, count, followed)
    beside, after = [], []
    for number, case in enumerate(BESIDE[:1] if reduced else BESIDE):
        text, samples, name, term = case
        seeds = (SEED + 1_000_000 * (number + 1) + np.arange(count)).tolist()
        beside += beside_zero(text, samples, name, term, seeds, followed if number == 0 else 0)
        after.append(after_choice(text, samples, name, term, seeds))
    return {
        "recordings": count, "likelihood_recordings": followed, "rate": RATE, "truth": SLOW,
        "samples_per_time": SAMPLES_PER_TIME, "rows": rows, "beside": beside, "after": after,
    }  # fmt: skip


# --- few correlation times ----------------------------------------------------------------------------


def by_length(times: int, count: int, followed: int) -> list[Row]:
    """Intervals of β and σ² from recordings of so many correlation times, by each weighting and by likelihood."""
    truth = gmwm.Model.parse(SLOW).sorted(RATE)
    seeds = (SEED + 10_000 * times + np.arange(count)).tolist()
    asked: list[tuple[str, list[int], Any]] = [(weighting, seeds, weighted) for weighting in recordings.WEIGHTINGS]
    if times <= PROFILED:
        asked += [(method, seeds[:followed], likely) for method in ("wald", "profile")]
    rows = []
    for way, drawn, task in asked:
        found = np.array(recordings.everywhere(partial(task, times * SAMPLES_PER_TIME, way), drawn))
        told = found[:, 0, 2] > 0
        row: Row = {"times": times, "way": way, "recordings": len(drawn), "told": float(np.mean(told))}
        for k, name in enumerate(("GM.beta", "GM.sigma2")):
            low, high, _ = found[:, k].T
            value = truth.parameters[name]
            assert value is not None
            held = (low <= value) & (value <= high)
            row[name] = float(np.mean(held))
            row[f"{name}_untold"] = float(np.mean(held[~told])) if not np.all(told) else None
            row[f"{name}_open"] = float(np.mean((low <= 0) & np.isinf(high)))
        rows.append(row)
    return rows


def weighted(samples: int, weighting: str, seed: int) -> recordings.Array:
    """Ends of the intervals of β and σ² of one recording, (2, 3), and whether the fit has something to say of GM."""
    fit = recordings.fitted("GM + WN", recorded(SLOW, samples, seed).variance, weighting, samples, RATE)
    return ends(fit.confidence_intervals(), fit.diagnostics)


def likely(samples: int, method: str, seed: int) -> recordings.Array:
    """The same by maximum likelihood."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gmwm.errors.FitWarning)
        fit = gmwm.fit_ml("GM + WN", gmwm.Model.parse(SLOW).simulate(samples, RATE, seed), RATE)
    intervals = fit.confidence_intervals(method="profile" if method == "profile" else "wald")
    return ends(intervals, fit.diagnostics)


def ends(intervals: dict[str, tuple[float, float]], diagnostics: Any) -> recordings.Array:
    """Both intervals, and whether something is said of the term; one that acts as another process is told too."""
    told = float(any(remark.facts.get("term") == "GM" for remark in diagnostics.remarks))
    return np.array([(*intervals[name], told) for name in ("GM.beta", "GM.sigma2")])


def recorded(text: str, samples: int, seed: int) -> gmwm.WaveletVariance:
    """The wavelet variance of one recording."""
    return gmwm.wavelet_variance(gmwm.Model.parse(text).simulate(samples, RATE, seed), RATE)


# --- beside a term that is zero -----------------------------------------------------------------------


def beside_zero(text: str, samples: int, name: str, term: str, seeds: list[int], followed: int) -> list[Row]:
    """Intervals of a parameter, of all recordings and of those where its neighbour is zero, or is not."""
    truth = gmwm.Model.parse(text).sorted(RATE)
    value = truth.parameters[name]
    assert value is not None
    rows = []
    for way in (*recordings.WEIGHTINGS, *(("profile",) if followed else ())):
        drawn = seeds[:followed] if way == "profile" else seeds
        task = partial(neighbour, text, samples, way, name, term)
        low, high, zero = np.array(recordings.everywhere(task, drawn)).T
        held, gone = (low <= value) & (value <= high), zero > 0
        rows.append({
            "model": truth.structure, "samples": samples, "truth": text, "parameter": name, "term": term, "way": way,
            "recordings": len(drawn), "covered": float(np.mean(held)), "zero": float(np.mean(gone)),
            "covered_zero": share(held, gone), "covered_seen": share(held, ~gone),
        })  # fmt: skip
    return rows


def neighbour(text: str, samples: int, way: str, name: str, term: str, seed: int) -> tuple[float, float, float]:
    """Ends of the interval of a parameter in one recording, and whether the term beside it is zero."""
    structure = gmwm.Model.parse(text).sorted(RATE).structure
    if way == "profile":
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", gmwm.errors.FitWarning)
            likeliest = gmwm.fit_ml(structure, gmwm.Model.parse(text).simulate(samples, RATE, seed), RATE)
        interval = likeliest.confidence_intervals(method="profile")[name]
        return *interval, float(term in likeliest.diagnostics.not_supported)
    fit = recordings.fitted(structure, recorded(text, samples, seed).variance, way, samples, RATE)
    return *fit.confidence_intervals()[name], float(term in fit.diagnostics.not_supported)


def share(held: Any, where: Any) -> float | None:
    """Of the intervals at these places, those that contain the true value; None where there are none."""
    return float(np.mean(held[where])) if np.any(where) else None


# --- of the model that was chosen ---------------------------------------------------------------------


def after_choice(text: str, samples: int, name: str, term: str, seeds: list[int]) -> Row:
    """Intervals of a parameter under the model recommended, and under the largest that was compared."""
    truth = gmwm.Model.parse(text).sorted(RATE)
    value = truth.parameters[name]
    assert value is not None
    found = np.array(recordings.everywhere(partial(chosen, text, samples, name, term), seeds))
    low, high, least, most, widest_low, widest_high, lacking = found.T
    held, lacks = (low <= value) & (value <= high), lacking > 0
    return {
        "model": truth.structure, "truth": text, "samples": samples, "parameter": name, "term": term,
        "recordings": len(seeds), "lacking": float(np.mean(lacks)), "covered": float(np.mean(held)),
        "covered_lacking": share(held, lacks), "covered_with": share(held, ~lacks),
        "covered_largest": float(np.mean((least <= value) & (value <= most))),
        "covered_either": float(np.mean((widest_low <= value) & (value <= widest_high))),
    }  # fmt: skip


def chosen(text: str, samples: int, name: str, term: str, seed: int) -> tuple[float, ...]:
    """Ends of the interval under the model recommended, the largest, from least to most of both; whether it lacks."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gmwm.errors.FitWarning)
        ranking = gmwm.select(gmwm.Model.parse(text).structure, recorded(text, samples, seed))
        fit, largest = ranking.recommended.fit, ranking.general
        wide = largest.confidence_intervals()[name]
        # A choice without the parameter says nothing of it: zero.
        own = fit.confidence_intervals().get(name, (0.0, 0.0))
    return *own, *wide, min(own[0], wide[0]), max(own[1], wide[1]), float(term not in fit.model.terms)


# --- in words -----------------------------------------------------------------------------------------

WAYS = {"diagonal": "diagonal", "optimal": "optimal", "wald": "likelihood, Wald", "profile": "likelihood, profile"}


def table(result: dict[str, Any]) -> str:
    """Markdown: by the number of correlation times, beside a zero, after a choice."""
    count, followed = result["recordings"], result["likelihood_recordings"]
    noise, rough = (100 * np.sqrt(0.95 * 0.05 / n) for n in (count, followed))
    lines = [
        f"The tables give the coverage of 95 % intervals, from {count} recordings for each value, or {followed} for "
        f"maximum likelihood. The standard errors of a share of 95 % are {noise:.1f} % and {rough:.1f} %. In long "
        "recordings of models whose terms are all visible, the intervals contain the true value [in 93 to 97 "
        "%](coverage.md) of cases.",
        "",
        "## Few correlation times",
        "",
        f"Recordings of `{result['truth']}` at {result['rate']:g} Hz, with T_c = {result['samples_per_time']} "
        "samples, are fitted as GM + WN. The table has the share of intervals of β and of σ² that contain the true "
        "value, by the length of the recording in T_c.",
        *legend(
            {
                "open": ("share of intervals of β that are (0, ∞), because the term acts as another process"),
                "with remark": (
                    "share of fits with a remark that the term acts as another process or that the "
                    "recording has few correlation times"
                ),
                "no remark": "coverage of β and σ² in the recordings without such a remark",
            }
        ),
        "",
        "| T / T_c | by | recordings | β | σ² | open | with remark | β, no remark | σ², no remark |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {r['times']} | {WAYS[r['way']]} | {r['recordings']} | {r['GM.beta']:.1%} | {r['GM.sigma2']:.1%} "
        f"| {r['GM.beta_open']:.1%} | {r['told']:.1%} | {percent(r['GM.beta_untold'])} "
        f"| {percent(r['GM.sigma2_untold'])} |"
        for r in result["rows"]
    ]
    lines += [
        "",
        "## A weak term estimated as zero",
        "",
        "The fitted model is correct, but one of its terms is so weak that it is often estimated as zero. Standard "
        "errors are computed at the estimate, without the noise of that term. The table has the coverage of the other "
        "term in all recordings, in the recordings with the weak term at zero, and in the remaining ones.",
        "",
        "| truth | samples | weak | by | recordings | zero | parameter | covered | where zero | elsewhere |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {r['truth']} | {r['samples']} | {r['term']} | {WAYS[r['way']]} | {r['recordings']} | {r['zero']:.1%} "
        f"| {r['parameter']} | {r['covered']:.1%} | {percent(r['covered_zero'])} | {percent(r['covered_seen'])} |"
        for r in result["beside"]
    ]
    lines += [
        "",
        "## After model selection",
        "",
        "The same recordings are used with the model that `gmwm.select` recommends within the true model. The table "
        "has the share of recommendations without the weak term, and the coverage of the other term under the "
        "recommended model: in all recordings, in the recordings without the weak term, and in the remaining ones.",
        *legend(
            {
                "largest": "interval under the largest model, here the true model",
                "both": "interval from the smaller lower limit to the larger upper limit of the two",
            }
        ),
        "",
        "| truth | samples | lacking | recommended without it | parameter | covered | where lacking | elsewhere "
        "| largest | both |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {r['truth']} | {r['samples']} | {r['term']} | {r['lacking']:.1%} | {r['parameter']} | {r['covered']:.1%} "
        f"| {percent(r['covered_lacking'])} | {percent(r['covered_with'])} | {r['covered_largest']:.1%} "
        f"| {r['covered_either']:.1%} |"
        for r in result["after"]
    ]
    return "\n".join(lines)


def percent(value: float | None) -> str:
    """A share, or nothing."""
    return "" if value is None else f"{value:.1%}"
