"""Comparison of estimators on the same simulated sensors: errors, undetected terms, run time.

Slopes of the Allan deviation, Vaccaro and Zaki's estimate, the wavelet moments with both weightings, the likelihood of
a log-sampled record, and the likelihood of all samples, on sensors from WN + RW to 3·GM + WN + QN + RW, from a
thousand samples to a million.

This record holds times, as ratios to `numpy.cumsum` of the same samples: they differ a little from run to run, and with
them the file; all else follows from the seed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

import gmwm
from validation import appendix_a
from validation.comparators import slopes, vaccaro_zaki
from validation.comparison_words import draw as draw  # the picture beside the record
from validation.comparison_words import table as table
from validation.log_sampled import EACH, most_likely_blocks

further = appendix_a.section
"""The last section of the page."""

NAME = "comparison"
SEED = 20261207
RATE = 100.0

TRUTHS = (
    "WN(sigma2=4e-6) + RW(gamma2=1e-10)",
    "GM(beta=0.5, sigma2=2e-7) + WN(sigma2=4e-6)",
    "GM(beta=8.0, sigma2=1e-6) + WN(sigma2=4e-6) + RW(gamma2=4e-10)",
    "GM(beta=8.0, sigma2=6e-7) + GM(beta=0.15, sigma2=2e-7) + WN(sigma2=2e-6) + QN(q2=1e-6)",
    "GM(beta=10.0, sigma2=8e-7) + GM(beta=0.5, sigma2=2e-7) + GM(beta=0.02, sigma2=1e-7) + WN(sigma2=1e-6)"
    " + QN(q2=1e-6) + RW(gamma2=2e-12)",
)
"""Gyroscopes in rad/s at 100 Hz: 0.3 to 0.7 °/√h, Gauss-Markov processes of 0.1 to 50 s a decade or more apart."""

LENGTHS = (1_000, 10_000, 100_000, 1_000_000)

COUNTS = (*3 * ((100, 100, 60, 20),), (60, 60, 40, 20), (40, 40, 24, 12))
"""Recordings of each model and length: fewer where each takes longer."""

FACTOR = 10.0
"""An error by more than this factor counts as this; so does a term that is estimated as zero."""

FASTEST, SLOWEST = 3.0, 0.1
"""βΔt from which on a Gauss-Markov process is white noise, and βNΔt up to which it is a random walk."""

Array = NDArray[np.float64]
Estimate = Mapping[str, float]


def _both(x: Array) -> Estimate:
    found = vaccaro_zaki(x)
    return {"WN.sigma2": max(found.noise, 0.0), "RW.gamma2": max(found.walk, 0.0)}


METHODS: dict[str, Callable[[gmwm.Model, Array, gmwm.Fit], Estimate]] = {
    "slopes": lambda truth, x, _: slopes(x, RATE, truth),
    "slopes (oracle)": lambda truth, x, _: slopes(x, RATE, truth, told=True),
    "Vaccaro-Zaki": lambda truth, x, _: _both(x),
    "GMWM diagonal": lambda truth, x, _: gmwm.fit(truth.structure, x, RATE, weighting="diagonal").parameters,
    "GMWM optimal": lambda truth, x, first: first.parameters,
    "ML log-sampled": lambda truth, x, first: most_likely_blocks(first.model, x, RATE).parameters,
    "ML": lambda truth, x, first: gmwm.fit_ml(truth.structure, x, RATE, start=first).parameters,
}
"""From samples to values. Only "slopes (oracle)" uses the true values of the parameters."""

STARTED = ("GMWM optimal", "ML log-sampled", "ML")
"""Methods that begin with the optimal fit of the moments, whose time is in theirs."""

YARDSTICK = "ML"


def run(reduced: bool = False) -> dict[str, Any]:
    """Bias, root mean square error and share of zeros of each parameter, and the time, by model, length and method."""
    rows: list[dict[str, Any]] = []
    methods: list[dict[str, Any]] = []
    truths = (TRUTHS[0], TRUTHS[2]) if reduced else TRUTHS
    lengths = (1_000, 4_000) if reduced else LENGTHS
    numbers = ((10, 6), (10, 6)) if reduced else COUNTS
    for text, counts, seed in zip(truths, numbers, np.random.SeedSequence(SEED).spawn(len(truths)), strict=True):
        truth = gmwm.Model.parse(text).sorted(RATE)
        for samples, count, child in zip(lengths, counts, seed.spawn(len(lengths)), strict=True):
            errors, times = _measured(truth, samples, count, child)
            case = {"model": truth.structure, "samples": samples}
            rows += [case | row for row in _rows(truth, errors)]
            methods += [case | row for row in _standing(truth, errors, times)]
    return {
        "rate": RATE, "lengths": lengths, "counts": numbers, "truths": truths, "factor": FACTOR, "blocks": EACH,
        "rows": rows, "methods": methods,
    }  # fmt: skip


def _measured(
    truth: gmwm.Model, samples: int, count: int, seed: np.random.SeedSequence
) -> tuple[dict[str, Array], dict[str, float]]:
    """Errors (recordings, parameters) of each method, and its median time over that of a running sum.

    An error is log(estimate / truth), −∞ where a term is estimated as zero; NaN of what a method does not give.
    """
    errors: dict[str, list[list[float]]] = {name: [] for name in METHODS if _applies(name, truth)}
    times: dict[str, list[float]] = {name: [] for name in errors}
    sums = []
    for child in seed.spawn(count):
        x = truth.simulate(samples, RATE, np.random.default_rng(child))
        sums.append(_timed(lambda x=x: [np.cumsum(x) for _ in range(10)])[1] / 10)
        first, spent = _timed(lambda x=x: gmwm.fit(truth.structure, x, RATE, weighting="optimal"))
        for name in errors:
            found, taken = _timed(lambda name=name, x=x, first=first: METHODS[name](truth, x, first))
            errors[name].append(list(_errors(truth, found, samples).values()))
            times[name].append(taken + spent * (name in STARTED))
    unit = float(np.median(sums))
    return (
        {name: np.array(rows) for name, rows in errors.items()},
        {name: float(np.median(taken)) / unit for name, taken in times.items()},
    )


def _applies(method: str, truth: gmwm.Model) -> bool:
    return method != "Vaccaro-Zaki" or sorted(truth.terms) == ["RW", "WN"]


def _timed(task: Callable[[], Any]) -> tuple[Any, float]:
    """What comes of it, and its processor time (s), which other work on the machine changes less than the clock's."""
    began = time.process_time()
    return task(), time.process_time() - began


def _errors(truth: gmwm.Model, found: Estimate, samples: int) -> dict[str, float]:
    """log(estimate / truth) by parameter; −∞ of a term that is zero, NaN of what was not estimated."""
    errors = dict.fromkeys(truth.names, float("nan"))
    exact = truth.parameters
    found = _settled(found, samples)
    for name, value in found.items():
        if not name.startswith("GM"):
            errors[name] = float(np.log(value / exact[name])) if value > 0 else -np.inf
    true = [term for term in truth.terms if term.startswith("GM")]
    seen = [term for term in true if found.get(f"{term}.sigma2", 0.0) > 0]
    if true and f"{true[0]}.beta" in found:
        for term, own in _matched(true, seen, exact, found).items():
            for parameter in ("beta", "sigma2"):
                name = f"{term}.{parameter}"
                errors[name] = float(np.log(found[f"{own}.{parameter}"] / exact[name])) if own else -np.inf
    return errors


def _settled(found: Estimate, samples: int) -> dict[str, float]:
    """Estimates in which a Gauss-Markov process that is white noise or a random walk to the record counts as that."""
    settled = dict(found)
    for name in [name for name in found if name.endswith(".beta")]:
        scale, decay = name.replace("beta", "sigma2"), found[name] / RATE
        white, walk = decay > FASTEST, decay * samples < SLOWEST
        if white and "WN.sigma2" in settled:
            settled["WN.sigma2"] += settled[scale]
        elif walk and "RW.gamma2" in settled:
            settled["RW.gamma2"] -= settled[scale] * float(np.expm1(-2 * decay))
        if white or walk:
            settled[scale] = 0.0
    return settled


def _matched(true: list[str], seen: list[str], exact: Mapping[str, Any], found: Estimate) -> dict[str, str]:
    """For each true Gauss-Markov process the estimated one, in the order of β and as near in log β as can be; or ""."""
    best = min(
        combinations(true, len(seen)),
        key=lambda chosen: sum(
            abs(np.log(found[f"{own}.beta"] / exact[f"{term}.beta"])) for term, own in zip(chosen, seen, strict=True)
        ),
    )
    return dict.fromkeys(true, "") | dict(zip(best, seen, strict=True))


def _rows(truth: gmwm.Model, errors: dict[str, Array]) -> list[dict[str, Any]]:
    """One row for each parameter that a method gives."""
    rows = []
    for method, found in errors.items():
        for (name, exact), column in zip(truth.parameters.items(), found.T, strict=True):
            if not np.isnan(column).any():
                seen = np.clip(column[np.isfinite(column)], -np.log(FACTOR), np.log(FACTOR))
                rows.append({
                    "method": method,
                    "parameter": name,
                    "truth": exact,
                    "bias": float(seen.mean()) if seen.size else None,
                    "bias_uncertain": float(seen.std(ddof=1) / np.sqrt(seen.size)) if seen.size > 1 else None,
                    "rmse": float(np.sqrt(_losses(column).mean())),
                    "zero": float(np.mean(np.isinf(column))),
                })  # fmt: skip
    return rows


def _losses(errors: Array) -> Array:
    """Squared errors, none larger than that of a missing term."""
    return np.asarray(np.clip(errors, -np.log(FACTOR), np.log(FACTOR)) ** 2)


def _standing(truth: gmwm.Model, errors: dict[str, Array], times: dict[str, float]) -> list[dict[str, Any]]:
    """Each method's errors over those of the likelihood, and over the smallest of those that give all parameters."""
    whole = [method for method, found in errors.items() if not np.isnan(found).any()]
    best = min(whole, key=lambda method: float(np.log(_losses(errors[method]).mean(axis=0)).mean()))
    rows = []
    for method, found in errors.items():
        given = ~np.isnan(found).any(axis=0)
        over, uncertain = _ratio(found[:, given], errors[YARDSTICK][:, given])
        over_best, best_uncertain = _ratio(found[:, given], errors[best][:, given])
        rows.append({
            "method": method,
            "recordings": len(found),
            "parameters": [name for name, there in zip(truth.names, given, strict=True) if there],
            "complete": method in whole,
            "over_likelihood": over, "uncertain": uncertain,
            "best": best, "over_best": over_best, "best_uncertain": best_uncertain,
            "time": float(f"{times[method]:.2g}"),
        })  # fmt: skip
    return rows


def _ratio(errors: Array, yardstick: Array) -> tuple[float, float]:
    """Geometric mean over the parameters of ratios of root mean square errors; its standard error by the jackknife."""
    one, other = _losses(errors), _losses(yardstick)

    def logs(a: Array, b: Array) -> Array:
        return np.asarray((np.log(a) - np.log(b)).mean(axis=-1) / 2)

    ratio = float(np.exp(logs(one.sum(axis=0), other.sum(axis=0))))
    without = logs(one.sum(axis=0) - one, other.sum(axis=0) - other)
    return ratio, ratio * float(np.sqrt((len(one) - 1) * without.var()))
