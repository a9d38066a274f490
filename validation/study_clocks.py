"""Clocks of real loggers: whether the rate and the lost samples are found from the time stamps.

Each kind of clock in `validation.clock_zoo` is made anew for each seed, in plain NumPy. The rate must be found to 1e-4,
every gap at its row and with its number of lost samples, and no other gap.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from gmwm.base.errors import ReadError
from gmwm.files.clock.clock import clock_of
from validation.clock_zoo import KINDS, LIMITS, Record, mistakes
from validation.legend import legend

NAME = "clocks"
SEED = 20261122
SEEDS = 10
RATE = 1e-4
"""Largest relative error of the rate."""


def run(reduced: bool = False) -> dict[str, Any]:
    """Errors of rate and gaps of each kind, summed over the seeds."""
    seeds = 2 if reduced else SEEDS
    rows = [
        _row(name, [make(np.random.default_rng([SEED, k, len(name)])) for k in range(seeds)], limit=name in LIMITS)
        for name, make in (KINDS | LIMITS).items()
    ]
    return {"seeds": seeds, "rows": rows}


def _row(name: str, records: list[Record], limit: bool) -> dict[str, Any]:
    found = [found_in(record) for record in records]
    sums = {key: sum(one[key] for one in found) for key in ("gaps", "missed", "invented", "moved", "length")}
    return {
        "kind": name,
        "limit": limit,
        "within": records[0].within,
        "rate": max(abs(one["rate"]) for one in found),
        **sums,
        "right": sum(one["right"] for one in found),
    }


def found_in(record: Record) -> dict[str, Any]:
    """Errors in what gmwm finds in a record; `right` if there is none."""
    try:
        found = clock_of([record.stamps], record.unit, record.declared)[0]
    except ReadError as error:
        words = re.search(r"changes from (\S+) Hz to", str(error))
        right = record.expects == "changes" and words is not None and abs(float(words[1]) / record.rate - 1) < 0.01
        when, change = error.facts.get("when"), record.change
        right &= isinstance(when, float) and change is not None and abs(when - change) < 3 / record.rate
        return {"rate": 0.0, "gaps": 0, "missed": 0, "invented": 0, "moved": 0, "length": 0, "right": right}
    lengths = [last - first for first, last in found.segments]
    apart = np.round(np.diff(found.starts) * found.base.rate).astype(int) - lengths[:-1]
    rows = [first for first, _ in found.segments[1:]]
    wrong = mistakes(record, found.base.rate, rows, apart.tolist())
    exact = abs(wrong["rate"]) <= RATE and not (wrong["missed"] or wrong["invented"] or wrong["length"])
    told = not record.expects or record.expects in [remark.code for remark in found.remarks]
    return {**wrong, "right": exact and told}


def table(result: dict[str, Any]) -> str:
    """Markdown: one line for each kind of clock."""
    header = [
        "| clock | rate | gaps | missed | wrong length | moved | uncertainty | invented | right |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    lines = [
        f"Each kind of clock was simulated {result['seeds']} times.",
        *legend(
            {
                "rate": "largest relative error of the rate",
                "gaps": "number of true gaps in all records",
                "missed": "number of gaps that were not found",
                "wrong length": "number of gaps that were found with a wrong length",
                "moved": "number of gaps that were found at another row, but within the uncertainty",
                "uncertainty": "number of rows for which the time stamps do not show where samples were lost",
                "invented": "number of gaps that were found but do not exist",
                "right": (
                    "number of records whose rate is correct to 1e-4, with all gaps and no others, "
                    "and with an error or warning where one is necessary (a changed rate, regular losses)"
                ),
            }
        ),
        "",
        *header,
    ]
    for limit in (False, True):
        if limit:
            lines += [
                "",
                "A jitter of a fifth of the sampling interval, or jitter together with rounding, hides some losses: "
                "two neighbouring losses are found as one gap, or one gap is found as two.",
                "",
                *header,
            ]
        for r in result["rows"]:
            if r["limit"] == limit:
                lines.append(
                    f"| {r['kind']} | {r['rate']:.0e} | {r['gaps']} | {r['missed']} | {r['length']} | {r['moved']} | "
                    f"{r['within']} | {r['invented']} | {r['right']} of {result['seeds']} |"
                )
    return "\n".join(lines)
