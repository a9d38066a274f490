"""Maximum likelihood: coverage of 95 % intervals, and tests of the residuals.

Recordings of known models, with a mean that the fit does not know, are simulated and fitted from nothing but the
model's name. Beside the intervals: how far the log-likelihood at the truth lies below its maximum, twice of which is
chi-square with as many degrees of freedom as there are parameters; and how often the tests of the standardised
innovations reject a model that is right.
"""

from __future__ import annotations

import warnings
from functools import partial
from typing import Any

import numpy as np

import gmwm
from validation import recordings
from validation.legend import legend, table_lines

NAME = "likelihood"
SEED = 20261203
RATE = 100.0
MEAN = 9.81
TRUTHS = (
    ("GM(beta=0.5, sigma2=0.5) + WN(sigma2=1.0)", 20_000, 100),
    ("GM(beta=5.0, sigma2=0.5) + WN(sigma2=1.0) + RW(gamma2=1e-3)", 20_000, 100),
    ("GM(beta=0.25, sigma2=1.0) + WN(sigma2=1.0)", 2_000, 500),
)
"""Models, samples of a recording, and recordings with a profile; the last ones have but five correlation times."""
LEVEL = "mean"
Row = dict[str, Any]


def outcome(text: str, samples: int, profile: bool, seed: int) -> dict[str, Any]:
    """What is asked of one recording: estimates, errors and intervals (p, 6), and the tests of all at once."""
    truth = gmwm.Model.parse(text).sorted(RATE)
    x = MEAN + truth.simulate(samples, RATE, np.random.default_rng(seed))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gmwm.errors.FitWarning)
        fit = gmwm.fit_ml(truth.structure, x, RATE)
        wald = fit.confidence_intervals()
        followed = fit.confidence_intervals(method="profile") if profile else {}
    errors = fit.standard_errors
    rows = [(fit.parameters[n], errors.get(n, np.nan), *wald[n], *followed.get(n, (np.nan, np.nan))) for n in wald]
    if fit.level is not None and fit.level_error is not None:
        reach = 1.959964 * fit.level_error
        rows.append((fit.level, fit.level_error, fit.level - reach, fit.level + reach, np.nan, np.nan))
    residuals = fit.residuals(x)
    return {
        "rows": np.array(rows),
        "deviance": 2.0 * (fit.loglikelihood - truth.loglikelihood(x, RATE)),
        "ljung_box": residuals.ljung_box().p_value,
        "jarque_bera": residuals.normality().p_value,
    }


def run(reduced: bool = False) -> dict[str, Any]:
    """Share of intervals that contain the true value; estimates beside standard errors; rejections by the three
    tests."""
    count = 20 if reduced else 500
    rows, tests = [], []
    for number, (text, samples, profiles) in enumerate(TRUTHS[:1] if reduced else TRUTHS):
        here, test = studied(number, text, samples, count, 2 if reduced else profiles)
        rows += here
        tests.append(test)
    return {"recordings": count, "rate": RATE, "offset": MEAN, "rows": rows, "tests": tests}


def studied(number: int, text: str, samples: int, count: int, followed: int) -> tuple[list[Row], Row]:
    """What is found of one model: a row for each parameter, and the tests of all of them at once."""
    from scipy.stats import chi2

    model = gmwm.Model.parse(text).sorted(RATE)
    seeds = (SEED + 1_000_000 * number + np.arange(count)).tolist()
    # Those with a profile are shared among the processors one by one.
    found = recordings.everywhere(partial(outcome, text, samples, True), seeds[:followed], least=20)
    found += recordings.everywhere(partial(outcome, text, samples, False), seeds[followed:])
    values = np.array([f["rows"] for f in found])
    truths = [v for v in model.parameters.values() if v is not None]
    names = list(model.parameters)
    if values.shape[1] > len(names):
        names, truths = [*names, LEVEL], [*truths, MEAN]
    rows: list[Row] = []
    for k, (name, truth) in enumerate(zip(names, truths, strict=True)):
        estimate, error, low, high, below, above = values[:, k].T
        known = np.isfinite(error)
        rows.append({
            "model": model.structure, "samples": samples, "parameter": name, "truth": truth,
            "covered": float(np.mean((low <= truth) & (truth <= high))),
            "below": float(np.mean(high < truth)), "above": float(np.mean(low > truth)),
            "profiles": followed,
            "profile": None if name == LEVEL else float(np.mean(((below <= truth) & (truth <= above))[:followed])),
            "bias": float((estimate.mean() - truth) / estimate.std(ddof=1) * np.sqrt(count)),
            "median": float(np.median(estimate) / truth),
            "spread": float(np.subtract(*np.quantile(estimate, (0.8413, 0.1587))) / 2 / truth),
            "standard_error": float(np.median(error[known]) / truth),
        })  # fmt: skip
    deviance = np.array([f["deviance"] for f in found])
    return rows, {
        "model": model.structure, "samples": samples, "parameters": len(model.names),
        "deviance": float(deviance.mean()),
        "likelihood_ratio": float(np.mean(deviance > chi2.isf(0.05, len(model.names)))),
        **{name: float(np.mean([f[name] < 0.05 for f in found])) for name in ("ljung_box", "jarque_bera")},
    }  # fmt: skip


def table(result: dict[str, Any]) -> str:
    """Markdown: one line for each parameter of each model, and one of the tests for each model."""
    noise = 100 * np.sqrt(0.95 * 0.05 / result["recordings"])
    long = max(row["samples"] for row in result["rows"])
    covered = [row["covered"] for row in result["rows"] if row["parameter"] != LEVEL and row["samples"] == long]
    followed = [row["profile"] for row in result["rows"] if row["profile"] is not None]
    least = min(row["profiles"] for row in result["rows"])
    rough = 100 * np.sqrt(0.95 * 0.05 / least)
    lines = [
        f"{result['recordings']} recordings at {result['rate']:g} Hz are simulated from each model, with a mean of "
        f"{result['offset']:g} that the fit does not know. Maximum likelihood starts from the fit to the wavelet "
        f"variance. The coverage of 95 % Wald intervals of the long recordings is {min(covered):.1%} to "
        f"{max(covered):.1%}, and of profile intervals of all recordings {min(followed):.1%} to {max(followed):.1%}. "
        "If a recording contains only a few correlation times of a process (five in the short recordings), use "
        "`method='profile'`. The standard error of the mean treats the parameters as known.",
        *legend(
            {
                "covered": (
                    f"share of Wald intervals that contain the true value, with a standard error of {noise:.1f} %"
                ),
                "low, high": "share of Wald intervals that lie completely below or above the true value",
                "profile": (
                    f"share of profile intervals that contain the true value, for the first {least} "
                    f"recordings or more, with a standard error of {rough:.1f} %"
                ),
                "median, spread": (
                    "median of the estimates and half the range of their central 68 %, divided by the true value"
                ),
                "bias": "bias of the estimates in standard errors of their mean",
                "standard error": "median of the reported standard errors, divided by the true value",
            }
        ),
        "",
        "| model | samples | parameter | truth | covered | low | high | profile | median | bias | spread "
        "| standard error |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {r['model']} | {r['samples']} | {r['parameter']} | {r['truth']:g} | {r['covered']:.1%} | {r['below']:.1%} "
        f"| {r['above']:.1%} | {'' if r['profile'] is None else format(r['profile'], '.1%')} | {r['median']:.4f} "
        f"| {r['bias']:+.1f} | {r['spread']:.4f} | {r['standard_error']:.4f} |"
        for r in result["rows"]
    ]
    lines += [
        "",
        "The next table is for all parameters together. It has the mean of 2 (log L(estimate) − log L(truth)), and "
        "the share of recordings in which this difference exceeds the 5 % limit of the chi-square distribution. The "
        "last two columns have the shares of recordings in which the tests of the standardised innovations at the 5 % "
        "level reject the correct model. The Ljung-Box test reduces its degrees of freedom by the number of estimated "
        f"parameters. The standard error of these shares is {noise:.1f} %.",
        "",
        *table_lines(
            "| model | samples | parameters | mean of 2 Δ log L | likelihood ratio | Ljung-Box | Jarque-Bera |",
            "| {model} | {samples} | {parameters} | {deviance:.2f} | {likelihood_ratio:.1%} | {ljung_box:.1%} "
            "| {jarque_bera:.1%} |",
            result["tests"],
        ),
    ]
    return "\n".join(lines)
