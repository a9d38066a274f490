"""Fleets: false alarms among healthy devices, detection of outlying devices, and coverage of intervals.

Fleets are drawn as the model has them: true numbers of units that scatter by τ about μ, measured with errors s that are
all alike or differ by a factor of ten.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t

from gmwm.applications.fleets.statistics_result import deviants
from gmwm.base.statistics import effects, prediction_limits, spread_limits
from validation.legend import legend

NAME = "fleet"
SEED = 20270322
UNITS = (8, 20, 100)
SPREADS = (0.0, 0.3, 1.0, 3.0)
"""τ over the error s of a typical unit."""
ERRORS = ("equal", "unequal")
UNEQUAL = (0.3, 3.0)
"""Ends between which unequal errors lie, evenly in the logarithm."""
OFF = (3, 4, 5, 6, 8, 10)
"""Standard deviations between units by which the odd unit is off."""
SIZES = (0.05, 0.05 / 36)
"""Of the test of one number; the second as it is with 36 numbers in a fleet."""
CONFIDENCE = 0.95
ODD = 3.0
"""τ / s where the odd unit is sought."""

Array = NDArray[np.float64]
Result = dict[str, Any]


def run(reduced: bool = False) -> Result:
    """Healthy fleets of all kinds, and fleets with one odd unit or three."""
    fleets, many = (600, 200) if reduced else (10_000, 2_000)
    rows = []
    for number, (units, spread, errors) in enumerate((n, s, e) for n in UNITS for s in SPREADS for e in ERRORS):
        if reduced and spread in (0.3, 3.0):
            continue
        rows.append(_healthy(fleets if units < 100 else many, units, spread, errors, SEED + number))
    found = [
        _odd(many, units, off, errors, SEED + 1000 + number)
        for number, (units, off, errors) in enumerate((n, k, e) for n in UNITS for k in OFF for e in ERRORS)
        if not reduced or off in (4, 10)
    ]
    return {"fleets": fleets, "many": many, "odd_at": ODD, "unequal": list(UNEQUAL), "rows": rows, "found": found}


def drawn(fleets: int, units: int, spread: float, errors: str, rng: np.random.Generator) -> tuple[Array, Array]:
    """Estimates (fleets, units) with μ = 0, and their standard errors."""
    s = np.ones((fleets, units))
    if errors == "unequal":
        s = np.exp(rng.uniform(*np.log(UNEQUAL), size=s.shape))
    return spread * rng.normal(size=s.shape) + s * rng.normal(size=s.shape), s


def _healthy(fleets: int, units: int, spread: float, errors: str, seed: int) -> dict[str, Any]:
    """How often a healthy fleet raises an alarm, and how often intervals contain the true value."""
    rng = np.random.default_rng(seed)
    x, s = drawn(fleets, units, spread, errors, rng)
    s2, further = s * s, spread * rng.normal(size=fleets)
    alarm = deviants(x, s2).pvalue[:, 0]
    at, (low, high), ahead = effects(x, s2), spread_limits(x, s2, CONFIDENCE), prediction_limits(x, s2, CONFIDENCE)
    reach = t.ppf((1 + CONFIDENCE) / 2, units - 1) * at.error
    within = (ahead[0] <= further) & (further <= ahead[1])
    return {
        "units": units, "spread": spread, "errors": errors, "fleets": fleets,
        **{f"alarm_{k}": float(np.mean(alarm <= size)) for k, size in enumerate(SIZES)},
        "mean_covered": float(np.mean(np.abs(at.mean) <= reach)),
        "spread_covered": float(np.mean((low <= spread**2) & (spread**2 <= high))),
        "further_covered": float(np.mean(within)),
        "spread2": float(np.mean(at.spread2)),
        "spread2_uncertain": float(np.std(at.spread2) / np.sqrt(fleets)),
    }  # fmt: skip


def _odd(fleets: int, units: int, off: float, errors: str, seed: int) -> dict[str, Any]:
    """How often one odd unit is found in a fleet with 36 numbers, and all of several; and others beside it."""
    rng = np.random.default_rng(seed)
    row: dict[str, Any] = {"units": units, "off": off, "errors": errors}
    for several in (1, max(1, units // 10)):
        x, s = drawn(fleets, units, ODD, errors, rng)
        # On both sides, so that they do not hide behind one another's pull on the mean alone.
        x[:, :several] += off * ODD * np.where(np.arange(several) % 3 == 2, -1, 1)
        test = deviants(x, s * s)
        odd = (test.pvalue <= SIZES[1]) & (test.places >= 0)
        share = np.sum(odd & (test.places < several), axis=1) / several
        wrong = np.any(odd & (test.places >= several), axis=1)
        name = "one" if several == 1 else "several"
        row |= {f"{name}_found": float(np.mean(share)), f"{name}_wrong": float(np.mean(wrong))}
        row["several"] = several
    return row


def table(result: Result) -> str:
    """Markdown: what was done, what is seen, healthy fleets, fleets with odd units."""
    return "\n".join([*_words(result), "", *_lines(result["rows"]), "", *_found(result)])


def _words(result: Result) -> Iterator[str]:
    low, high = result["unequal"]
    yield (
        f"The study simulates {result['fleets']} fleets of each kind ({result['many']} with 100 devices), with one "
        "number for each device. The true values have the standard deviation τ between devices. The estimates have "
        f"standard errors s: all s = 1, or between {low:g} and {high:g}, uniform in the logarithm."
    )
    yield from legend(
        {
            "alarms": "share of healthy fleets with a device that is classified as an outlier, at the 5 % level for "
            "one number, and at 5 % for 36 numbers together (0.14 % for each)",
            "covered": "share of 95 % intervals that contain μ, τ, and the true number of a further device",
        }
    )
    yield from ["", "The results:"]
    yield ""
    yield from map("- {}".format, _seen(result["rows"], result["found"]))


def _seen(rows: Sequence[dict[str, Any]], found: Sequence[dict[str, Any]]) -> Iterator[str]:
    """What the rows show."""
    scatter = (0.05 * 0.95 / min(r["fleets"] for r in rows)) ** 0.5
    hidden, seen = ([r for r in rows if (r["spread"] >= 1) is large] for large in (False, True))
    yield (
        f"Alarms at 5 %: {_span(seen, 'alarm_0')} of the fleets with τ ≥ s, {_span(hidden, 'alarm_0')} of the fleets "
        f"with τ < s, where the errors hide τ. The standard error of these shares is at most {scatter:.1%}."
    )
    yield f"Alarms at 0.14 %: {_span(rows, 'alarm_1', '.2%')}."
    yield (
        f"Coverage of μ: {_span(rows, 'mean_covered')}. Coverage of τ: {_span(rows, 'spread_covered')}. Coverage of a "
        f"further device: {_span(seen, 'further_covered')} for τ ≥ s, {_span(hidden, 'further_covered')} for τ < s."
    )
    for units in dict.fromkeys(r["units"] for r in found):
        least = [r["off"] for r in found if r["units"] == units and r["one_found"] >= 0.9 and r["errors"] == "equal"]
        reached = "is found in at least 90 % of the fleets from a distance of {} τ"
        found_at = (
            reached.format(min(least))
            if least
            else f"is found in fewer than 90 % of the fleets at all distances up to {max(r['off'] for r in found)} τ"
        )
        yield f"{units} devices: an outlying device {found_at} (equal errors)."
    wrong = max(max(r["one_wrong"], r.get("several_wrong", 0.0)) for r in found)
    yield f"In fleets with outlying devices, a healthy device is classified as outlier in at most {wrong:.2%} of them."


def _lines(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    yield (
        "| devices | τ / s | errors | alarms at 5 % | at 0.14 % | μ covered | τ covered | further device covered "
        "| mean τ̂² |"
    )
    yield "|---|---|---|---|---|---|---|---|---|"
    for r in rows:
        covered = " | ".join(f"{r[name]:.1%}" for name in ("mean_covered", "spread_covered", "further_covered"))
        yield (
            f"| {r['units']} | {r['spread']:g} | {r['errors']} | {r['alarm_0']:.1%} | {r['alarm_1']:.2%} | {covered} "
            f"| {r['spread2']:.3f} ± {r['spread2_uncertain']:.3f} |"
        )


def _found(result: Result) -> Iterator[str]:
    yield (
        f"These fleets have outlying devices at a distance in units of τ, with τ = {result['odd_at']:g} s. They are "
        "tested as fleets with 36 numbers. In the columns *several*, a tenth of the devices are outlying, two thirds "
        "of them above the others and a third below."
    )
    yield from legend(
        {
            "found": "share of the outlying devices that are classified as outliers",
            "wrong": "share of the fleets with a healthy device that is classified as an outlier",
        }
    )
    yield ""
    yield "| devices | distance | errors | one: found | wrong | several | found | wrong |"
    yield "|---|---|---|---|---|---|---|---|"
    for r in result["found"]:
        several = f"{r['several']} | {r['several_found']:.0%} | {r['several_wrong']:.2%}" if r["several"] > 1 else "| |"
        yield (
            f"| {r['units']} | {r['off']} τ | {r['errors']} | {r['one_found']:.0%} | {r['one_wrong']:.2%} | {several} |"
        )


def _span(rows: Sequence[dict[str, Any]], name: str, form: str = ".1%") -> str:
    """From the least to the greatest of a column."""
    values = [row[name] for row in rows]
    return f"{min(values):{form}} to {max(values):{form}}"
