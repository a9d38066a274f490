"""Optimism of the model selection criterion compared with simulation.

Recordings of known models are fitted under one Ω, that of the truth; twice the covariance of what was measured and what
was fitted is the optimism, and what theory and bootstrap make of it is put beside.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np

import gmwm
from gmwm.fitting.estimation.criterion import covariance_trace, implied_by_refits, optimism, problem_of
from gmwm.fitting.estimation.simulated_curves import simulated_variances
from gmwm.fitting.estimation.weighting import precision
from gmwm.measuring.covariance import Design, covariance
from validation import recordings
from validation.legend import legend

NAME = "optimism"
SEED = 20261204

WEIGHTINGS = ("diagonal", "optimal")
LIMITS = "limits"
"""Ω of the published method: 1 / (upper − lower)², by the confidence limits of each level."""


@dataclass(frozen=True)
class Case:
    """What recordings come from, and what is fitted to them.

    Attributes
    ----------
    kind : "right", "weak" or "wrong"
        What is fitted is the truth; has a term that many recordings do not show; lacks a process.
    """

    kind: str
    truth: str
    fitted: str
    samples: int
    rate: float
    weightings: tuple[str, ...] = WEIGHTINGS


CASES = (
    Case("right", "AR1(phi=0.95, sigma2=0.1) + WN(sigma2=1)", "AR1 + WN", 4000, 1.0, (*WEIGHTINGS, LIMITS)),
    Case("right", recordings.TRUTHS[0], "WN + RW", 100_000, 100.0),
    Case("right", recordings.TRUTHS[2], "GM + WN + RW", 100_000, 100.0),
    Case("right", recordings.TRUTHS[3], "2*GM + WN + QN", 100_000, 100.0),
    Case("weak", "WN(sigma2=4e-6) + RW(gamma2=5e-15)", "WN + RW", 100_000, 100.0),
    Case(
        "wrong", "GM(beta=8.0, sigma2=1e-6) + GM(beta=1.0, sigma2=5e-7) + WN(sigma2=4e-6)", "GM + WN", 100_000, 100.0,
        ("diagonal",),
    ),
)  # fmt: skip

DRAWS = 500
"""Records of each bootstrap."""


def run(reduced: bool = False) -> dict[str, Any]:
    """The optimism of each case under each weighting, by simulation, by theory, and by bootstrap."""
    count, fits, bootstraps = (300, 12, 2) if reduced else (5000, 200, 12)
    draws = 100 if reduced else DRAWS
    chosen = [k for k, case in enumerate(CASES) if not reduced or case.fitted in ("AR1 + WN", "WN + RW")]
    places = [(k, weighting) for k in chosen for weighting in CASES[k].weightings]
    # Bootstraps take as long as hundreds of fits: those of all cases at once keep every processor busy.
    asked = [(*place, b) for place in places for b in range(bootstraps) if CASES[place[0]].kind == "right"]
    least = recordings.LEAST_SHARED if reduced else 2
    drawn = recordings.everywhere(partial(_bootstrapped, draws), asked, least)
    rows = []
    for place in places:
        found = [value for (*at, _), value in zip(asked, drawn, strict=True) if tuple(at) == place]
        rows.append(_row(*place, count, fits, np.array(found)))
    return {"recordings": count, "fits": fits, "bootstraps": bootstraps, "draws": draws, "rows": rows}


def _row(place: int, weighting: str, count: int, fits: int, bootstrapped: recordings.Array) -> dict[str, Any]:
    case, posed = CASES[place], _posed(place, weighting)
    variances = _recorded(place, count)
    implied = np.array(recordings.everywhere(partial(_implied, place, weighting), variances))
    matrix = posed.fit.weighting_matrix
    each = 2 * np.einsum("bj,jk,bk->b", implied - implied.mean(axis=0), matrix, variances - variances.mean(axis=0))
    truth = covariance_trace(variances, implied, matrix)
    estimates = np.array(recordings.everywhere(partial(_asymptotic, place, weighting), variances[:fits]))
    row = {
        "kind": case.kind,
        "truth": case.truth,
        "model": case.fitted,
        "samples": case.samples,
        "weighting": weighting,
        "optimism": truth,
        "optimism_uncertain": float(each.std(ddof=1) / count**0.5),
        "asymptotic_at_truth": optimism(posed.fit, posed.wavelet),
        "asymptotic_to_first_order": optimism(_exact(posed.fit), posed.wavelet),
        "asymptotic": float(estimates.mean()),
        "asymptotic_low": float(np.quantile(estimates, 0.05)),
        "asymptotic_high": float(np.quantile(estimates, 0.95)),
        "asymptotic_over_optimism": float(estimates.mean() / truth),
    }
    if bootstrapped.size:
        row |= {
            "bootstrap": float(bootstrapped.mean()),
            "bootstrap_uncertain": float(bootstrapped.std(ddof=1) / bootstrapped.size**0.5),
            "bootstrap_over_optimism": float(bootstrapped.mean() / truth),
        }
    return row


@dataclass(frozen=True, eq=False)
class _Posed:
    """A case under a weighting: what is fitted to the true curve under Ω, and V of the truth."""

    fit: gmwm.Fit
    wavelet: recordings.Array


@cache
def _posed(place: int, weighting: str) -> _Posed:
    case, design, truth = CASES[place], _setting(place), _truth(place)
    wavelet = covariance(truth, design)
    wv = _measured(case, truth.wavelet_variance(design.levels, design.rate, design.filter))
    weights: dict[str, Callable[[], recordings.Array]] = {
        "diagonal": lambda: np.diag(1 / np.diag(wavelet)),
        "optimal": lambda: precision(wavelet),
        LIMITS: lambda: np.diag((wv.upper - wv.lower) ** -2),
    }
    return _Posed(gmwm.fit(case.fitted, wv, weighting=weights[weighting](), certify=False), wavelet)


def _exact(fit: gmwm.Fit) -> gmwm.Fit:
    """The same fit to a curve that it meets: second derivatives have nothing left to multiply."""
    return replace(fit, wavelet_variance=replace(fit.wavelet_variance, variance=fit.implied.copy()))


def _truth(place: int) -> gmwm.Model:
    return gmwm.Model.parse(CASES[place].truth).sorted(CASES[place].rate)


def _setting(place: int) -> Design:
    case = CASES[place]
    return Design(np.arange(1, case.samples.bit_length()), samples=case.samples, rate=case.rate)


def _measured(case: Case, variance: recordings.Array) -> gmwm.WaveletVariance:
    return gmwm.WaveletVariance.from_values(variance, samples=case.samples, rate=case.rate)


@cache
def _recorded(place: int, count: int) -> recordings.Array:
    """Wavelet variances (count, J) of recordings of the truth."""
    return simulated_variances(_truth(place), _setting(place), count, SEED + place)


def _implied(place: int, weighting: str, variance: recordings.Array) -> recordings.Array:
    """ν(θ̂) (J,) of one recording."""
    return implied_by_refits(*problem_of(_posed(place, weighting).fit), variance[np.newaxis])[0]


def _fitted(place: int, weighting: str, variance: recordings.Array) -> gmwm.Fit:
    matrix = _posed(place, weighting).fit.weighting_matrix
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gmwm.errors.FitWarning)
        return gmwm.fit(CASES[place].fitted, _measured(CASES[place], variance), weighting=matrix, certify=False)


def _asymptotic(place: int, weighting: str, variance: recordings.Array) -> float:
    """By theory, from one recording; V is that of the fit, or of the truth where the fit cannot show it."""
    fit = _fitted(place, weighting, variance)
    return fit.wic().optimism if CASES[place].kind == "right" else optimism(fit, _posed(place, weighting).wavelet)


def _bootstrapped(draws: int, asked: tuple[int, str, int]) -> float:
    """By a bootstrap of the fit to recording b, whose seed is b."""
    place, weighting, b = asked
    fit = _fitted(place, weighting, _recorded(place, b + 1)[b])
    return fit.wic("bootstrap", draws=draws, rng=b).optimism


def table(result: dict[str, Any]) -> str:
    """Markdown: the right models, then those of which a term is weak or missing."""
    lines = [
        f"{result['recordings']} recordings of each model are fitted. The optimism of a fit is the expected "
        f"difference between its loss on another recording and its loss on the fitted one. The weighting matrix Ω "
        f"comes from the true model: 1 / V_jj (diagonal), V⁻¹ (optimal), or 1 / (upper − lower)² from the "
        "confidence limits of the true curve (limits). ± is one standard error.",
        *legend(
            {
                "simulated": "optimism 2 tr Cov(ν̂, Ων(θ̂)) of the measured ν̂ and the fitted ν(θ̂), over all recordings",
                "asymptotic: truth": "optimism from theory, at the true parameters",
                "fits, 90 % of fits": (
                    f"optimism from theory, at the fitted parameters: mean over the fits to {result['fits']} "
                    f"recordings, and range of the central 90 % of these fits"
                ),
                "bootstrap": f"optimism from simulated recordings: mean over {result['bootstraps']} fits, with "
                f"{result['draws']} draws each",
                "ratio": "ratio to the simulated value",
            }
        ),
        "",
        "| model | samples | weighting | simulated | asymptotic: truth | fits | 90 % of fits | ratio | bootstrap "
        "| ratio |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    right = [r for r in result["rows"] if r["kind"] == "right"]
    lines += [
        f"{_line(r)} | {r['bootstrap']:.3g} ± {r['bootstrap_uncertain']:.1g} | {r['bootstrap_over_optimism']:.3f} |"
        for r in right
    ]
    lines += [
        "",
        "The next table has two special cases, with the V of the true model. WN + RW has a random walk that many "
        "recordings do not show. Theory treats it as either present or absent, and is too low on average. GM + WN "
        "lacks the second of two Gauss-Markov processes, so the second derivatives in H matter.",
        "",
        "| model | samples | weighting | simulated | asymptotic: truth | fits | 90 % of fits | ratio "
        "| truth, without second derivatives |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    others = [r for r in result["rows"] if r["kind"] != "right"]
    lines += [f"{_line(r)} | {r['asymptotic_to_first_order']:.4g} |" for r in others]
    return "\n".join(lines)


def _line(r: dict[str, Any]) -> str:
    return (
        f"| {r['model']} | {r['samples']} | {r['weighting']} | {r['optimism']:.4g} ± {r['optimism_uncertain']:.1g} "
        f"| {r['asymptotic_at_truth']:.4g} | {r['asymptotic']:.4g} | {r['asymptotic_low']:.3g} … "
        f"{r['asymptotic_high']:.3g} | {r['asymptotic_over_optimism']:.3f}"
    )
