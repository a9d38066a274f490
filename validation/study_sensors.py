"""Real departures: what `gmwm.calibrate` reports of simulated sensors outside and inside its default family.

The sensors are those of validation/sensors.py. Only what a user sees is judged: models, datasheet numbers with their
intervals, remarks by their codes, verdicts, and the false alarms of `gmwm.agree`.

`python -m validation.study_sensors --kinds lowpass-1,spikes --repeats 10` runs a part and prints its table. A run that
was stopped continues where it stood: outcomes are kept in build/sensors until the sources of gmwm change.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

import gmwm
from validation import filter_truth, sensors
from validation.legend import legend

NAME = "sensors"
SEED = 20261212
REPEATS, MORE = 12, 20
"""Numbers of recordings of each kind, and of the kinds that are difficult."""
DIFFICULT = (
    "base", "gm-300s", "average", "resonance", "lines", "knocks", "quantized-coarse", "flicker-medium",
    "flicker-strong", "warm-up", "drift", "agree-20s", "agree-1min",
)  # fmt: skip
"""Kinds with more recordings: those for which a number was covered in less than 92 % before, and similar ones."""
REDUCED = ("base", "flicker-weak", "agree-20s")
ACCEPTED = 0.01
"""p-value of the goodness-of-fit test below which a model counts as rejected."""
PARTIAL = Path(__file__).resolve().parent.parent / "build" / "sensors"
ALL = (*sensors.KINDS, *sensors.PAIRS)

Outcome = dict[str, Any]


def run(reduced: bool = False) -> dict[str, Any]:
    """All kinds; a full run that was stopped continues."""
    kinds = REDUCED if reduced else ALL
    found = measured(kinds, 2 if reduced else None, folder=None if reduced else PARTIAL)
    return {"accepted": ACCEPTED, "rows": [summarised(kind, found[kind]) for kind in kinds]}


# --- one recording ----------------------------------------------------------------------------------------------------


def outcome(kind: str, repeat: int) -> Outcome:
    """What a user is told of one recording, or of two of the same unit, beside the truth."""
    rng = np.random.default_rng([SEED, ALL.index(kind), repeat])
    begun = time.perf_counter()
    if kind in sensors.PAIRS:
        pair = sensors.pair(sensors.PAIRS[kind], rng)
        calibrations = [_calibrated(one) for one in pair]
        agreed = gmwm.agree(calibrations)
        both = [_told(one, found) for one, found in zip(pair, calibrations, strict=True)]
        told = both[0] | {
            "alarms": [row.symbol for row in agreed.disagreeing],
            "compared": [row.symbol for row in agreed.compared],
            "models": [one["model"] for one in both],
        }
    else:
        recording = sensors.KINDS[kind](rng)
        told = _told(recording, _calibrated(recording))
    return {"kind": kind, "repeat": repeat, **told, "seconds": round(time.perf_counter() - begun, 2)}


def _calibrated(one: sensors.Recording) -> gmwm.Calibration:
    imu = gmwm.Imu({one.axis: gmwm.Signal(one.samples, one.rate, one.unit, one.axis)})
    return gmwm.calibrate(imu, threads=1)


def _told(one: sensors.Recording, found: gmwm.Calibration) -> Outcome:
    axis = found.axes[one.axis]
    numbers = {
        symbol: {
            "value": e.value, "low": e.low, "high": None if e.high is None or math.isinf(e.high) else e.high,
            "limit": e.upper_only, "term": e.term, "use": found.number_verdicts[one.axis][symbol].usability.value,
        }
        for symbol, e in axis.datasheet.items()
    }  # fmt: skip
    wv = axis.fit.wavelet_variance
    return {
        "truth": {k: v for k, v in asdict(one.truth).items() if v is not None},
        "rate": one.rate,
        "samples": one.samples.size,
        "model": axis.fit.model.structure,
        "parameters": dict(axis.fit.parameters),
        "best": axis.ranking.best.structure,
        "equivalent": [candidate.structure for candidate in axis.ranking.equivalent],
        "numbers": numbers,
        "pvalue": None if axis.test is None else axis.test.pvalue,
        "misfit": (wv.variance / axis.fit.implied - 1).tolist(),
        "robust": wv.robust,
        "codes": sorted({remark.code for remark in found.remarks}),
    }


# --- many -------------------------------------------------------------------------------------------------------------


def measured(
    kinds: Sequence[str], repeats: int | None, *, folder: Path | None = None, workers: int = 1
) -> dict[str, list[Outcome]]:
    """The outcomes of each kind; with a folder, those that it holds of the same sources are not repeated."""
    found: dict[str, list[Outcome]] = {}
    with _processes(workers) as shared:
        for kind in kinds:
            begun = time.perf_counter()
            count = repeats or (MORE if kind in DIFFICULT else REPEATS)
            found[kind] = _of_kind(kind, count, folder, shared)
            print(f"{kind}: {count} in {time.perf_counter() - begun:.0f} s", file=sys.stderr, flush=True)
    return found


class _processes:
    """`map` of the built-in kind, or that of a pool of processes."""

    def __init__(self, workers: int) -> None:
        self.pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn")) if workers > 1 else None

    def __enter__(self) -> Callable[..., Iterator[Any]]:
        return map if self.pool is None else self.pool.map

    def __exit__(self, *_: object) -> None:
        if self.pool is not None:
            self.pool.shutdown(cancel_futures=True)


def _of_kind(kind: str, repeats: int, folder: Path | None, shared: Callable[..., Iterator[Any]]) -> list[Outcome]:
    known: dict[int, Outcome] = {}
    file = None if folder is None else folder / f"{kind}.jsonl"
    stamp = _sources()
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        rows = [json.loads(row) for row in file.read_text(encoding="utf-8").splitlines()] if file.exists() else []
        known = {row["repeat"]: row for row in rows if row.pop("sources") == stamp}
        if len(known) < len(rows):
            file.unlink()
    missing = [repeat for repeat in range(repeats) if repeat not in known]
    for row in shared(partial(outcome, kind), missing):
        known[row["repeat"]] = row
        if file is not None:
            with file.open("a", encoding="utf-8") as out:
                out.write(json.dumps(row | {"sources": stamp}) + "\n")
    return [known[repeat] for repeat in range(repeats)]


def _sources() -> str:
    """A hash of the sources of gmwm and of the simulators."""
    folder = Path(gmwm.__file__).parent
    simulators = [Path(str(module.__file__)) for module in (sensors, filter_truth)]
    files = sorted([*folder.rglob("*.py"), *folder.rglob("*.toml"), *folder.rglob("*.so"), *simulators])
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:16]


# --- the table --------------------------------------------------------------------------------------------------------


def summarised(kind: str, rows: Sequence[Outcome]) -> dict[str, Any]:
    """Bias, coverage and shares over the recordings of one kind; a share of nothing is None."""
    ratios = [entry["value"] / true for row in rows for entry, true in _pairs(row, "N")]
    widths = [(n["high"] - n["low"]) / (2 * n["value"]) for row in rows for n, _ in _pairs(row, "N")]
    models = Counter(r["model"] for r in rows)
    known = [r for r in rows if "structure" in r["truth"]]
    row = {
        "kind": kind,
        "recordings": len(rows),
        "N_ratio": float(np.median(ratios)) if ratios else None,
        "N_off": float(np.percentile(np.abs(np.log(ratios)), 90)) if ratios else None,
        "N_width": float(np.median(widths)) if widths else None,
        **{f"{name}_covered": _share(_scores(rows, name)) for name in _COUNTED},
        **{f"{name}_scored": len(_scores(rows, name)) for name in _COUNTED},
        **{f"{name}_bound_holds": _share(_limits(rows, name)) for name in MAIN},
        **{f"{name}_bounds": len(_limits(rows, name)) for name in MAIN},
        **{f"{name}_refused": _share([_use(r, name) in ("", DO_NOT_USE) for r in rows]) for name in MAIN},
        "robust": _share([r["robust"] for r in rows]),
        "rejected": _share([r["pvalue"] < ACCEPTED for r in rows if r["pvalue"] is not None]),
        "model": models.most_common(1)[0][0],
        "model_share": models.most_common(1)[0][1] / len(rows),
        "recommended": _share([_terms(r["model"]) == _terms(r["truth"]["structure"]) for r in known]),
        "in_set": _share([_among(r, exact=True) for r in known]),
        "in_set_or_contains": _share([_among(r, exact=False) for r in known]),
        **{
            code: _share([code in r["codes"] for r in rows])
            for code in ("warm-up", "coarse-output", "drift", "walk-or-markov")
        },
        "alarms": _share([bool(r["alarms"]) for r in rows if "alarms" in r]),
    }
    causes = Counter(symbol for r in rows for symbol in r.get("alarms", ()))
    return row | {"alarmed_numbers": dict(sorted(causes.items()))}


def _share(held: Sequence[bool]) -> float | None:
    return sum(map(bool, held)) / len(held) if held else None


def _use(row: Outcome, symbol: str) -> str:
    """The verdict of a number; empty if the datasheet does not have it."""
    return str(row["numbers"].get(symbol, {"use": ""})["use"])


def _scores(rows: Sequence[Outcome], name: str) -> list[bool]:
    """Whether each interval of a number that the truth has contains the true value."""
    return [entry["low"] <= true <= entry["high"] for row in rows for entry, true in _pairs(row, name)]


def _pairs(row: Outcome, name: str) -> Iterator[tuple[dict[str, Any], float]]:
    """The numbers that a user may use, each with its true value."""
    truth = row["truth"]
    if name in ("T_c", "q_c"):
        symbols = _of_terms(row, name)
        entries = [row["numbers"][symbol] for symbol in symbols if _use(row, symbol) == USE]
        terms = sorted(truth["gm"], key=lambda term: float(term[1]))
        # With another number of terms, none of them is the true one.
        if len(symbols) == len(terms) == len(entries):
            for entry, (variance, period) in zip(entries, terms, strict=True):
                yield entry, period if name == "T_c" else math.sqrt(2 * variance / period)
    elif _use(row, name) == USE and (true := _truth(row, name)):
        yield row["numbers"][name], true


def _truth(row: Outcome, name: str) -> float | None:
    """The true N and K of a filter; B is the coefficient of a flicker term, or the lowest point of the curve."""
    key = name if name == "B" and row["numbers"]["B"]["term"] else {"B": "lowest"}.get(name, f"filter_{name}")
    true: float | None = row["truth"].get(key)
    return true


def _of_terms(row: Outcome, name: str) -> list[str]:
    """The symbols of a number of repeatable terms, such as T_c[1]; terms are sorted by their correlation times."""
    return [symbol for symbol in row["numbers"] if symbol == name or symbol.startswith(f"{name}[")]


def _limits(rows: Sequence[Outcome], name: str) -> list[bool]:
    """Whether each number that is to be used as a bound is above the true one."""
    bounds = [(row["numbers"][name]["high"], _truth(row, name)) for row in rows if _use(row, name) == BOUND]
    return [high >= true for high, true in bounds if true]


def _terms(structure: str) -> Counter[str]:
    """How often each process is in a structure such as "2*GM + WN"."""
    terms: Counter[str] = Counter()
    for part in structure.split(" + "):
        times, star, name = part.partition("*")
        terms[name if star else times] += int(times) if star else 1
    return terms


def _among(row: Outcome, *, exact: bool) -> bool:
    """Whether the true structure is in the set of equivalent models, or with `exact=False` contains one of them."""
    wanted = _terms(row["truth"]["structure"])
    found = [_terms(structure) for structure in row["equivalent"]]
    return wanted in found if exact else any(one <= wanted for one in found)


MAIN = ("N", "K", "B")
USE, BOUND, DO_NOT_USE = "use", "use as a bound", "do not use"
"""Verdicts of numbers."""
_COUNTED = (*MAIN, "T_c", "q_c")
_COLUMNS: Mapping[str, str] = {
    "kind": "kind", "recordings": "R", "N_ratio": "N / truth", "N_off": "90 % of \\|ln\\|", "N_width": "half-interval",
    **{f"{name}_{column}": f"{name} {title}" for name in MAIN for column, title in (
        ("covered", "covered"), ("bound_holds", "bound holds"), ("refused", "refused"))},
    "T_c_covered": "T_c covered", "q_c_covered": "q_c covered", "robust": "robust", "rejected": "rejected",
    "model": "most often",
    "recommended": "truth recommended", "in_set": "truth in the set",
    "in_set_or_contains": "in the set, or contains one of it",
    "warm-up": "warm-up", "coarse-output": "coarse", "walk-or-markov": "walk or Markov", "alarms": "agree alarms",
}  # fmt: skip


def table(result: dict[str, Any]) -> str:
    """Markdown: one line for each kind."""
    lines = [
        "The recordings (R of each kind) come from the simulators in `validation/sensors.py`, which draw a new "
        "sensor for each recording and do not use gmwm. `gmwm.calibrate` runs with its defaults.",
        *legend(
            {
                "N / truth": (
                    "median ratio of N with the verdict *use*; the true N and K are those of the filter that predicts "
                    "the true spectrum over 1 s best, with the filter, resonances and rounding of the sensor and a "
                    "drift, without outliers and warm-up"
                ),
                "covered": (
                    "share of 95 % intervals that contain the true value, among numbers with the verdict *use* (their "
                    "number is in parentheses)"
                ),
                "bound holds": "share of limits above the true value, among numbers with the verdict *use as a bound*",
                "refused": "share of recordings in which the number has the verdict *do not use*, or is missing",
                "rejected": f"share of goodness-of-fit tests with p below {ACCEPTED:g}",
                "in the set": (
                    "share of recordings in which the model is among the equivalent models. No equivalent model "
                    "contains another one, although the data do not exclude larger sums that contain an equivalent "
                    "model"
                ),
                "robust": "share of recordings for which the robust wavelet variance was used",
                "warm-up, coarse, walk or Markov": "share of recordings with this remark",
                "agree alarms": "share of pairs of recordings of an unchanged sensor in which a number differs",
            }
        ),
        "",
        f"| {' | '.join(_COLUMNS.values())} |",
        f"|{'---|' * len(_COLUMNS)}",
    ]
    lines += [f"| {' | '.join(_cell(row, name) for name in _COLUMNS)} |" for row in result["rows"]]
    return "\n".join(lines)


def _cell(row: Mapping[str, Any], name: str) -> str:
    value = row[name]
    if value is None:
        return ""
    if name == "model":
        return f"`{value}` ({row['model_share']:.0%})"
    if name == "N_ratio":
        return f"{value:.4f}"
    if isinstance(value, str | int):
        return str(value)
    if name in ("N_off", "N_width"):
        return f"{value:.2%}"
    count = row.get(name.replace("_covered", "_scored").replace("_bound_holds", "_bounds"))
    return f"{value:.0%}" + (f" ({count})" if name.endswith(("_covered", "_bound_holds")) else "")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a part of the study; print its table, and write all outcomes where --output says."""
    parser = argparse.ArgumentParser(prog="python -m validation.study_sensors")
    parser.add_argument("--kinds", help=f"comma-separated; all by default: {', '.join(ALL)}")
    parser.add_argument("--repeats", type=int, help="recordings of each kind")
    parser.add_argument("--quick", action="store_true", help="3 recordings of each kind")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument(
        "--partial", type=Path, default=PARTIAL, help="where outcomes are kept until the sources change"
    )
    parser.add_argument("--output", type=Path, help="JSON file for the rows and all outcomes")
    given = parser.parse_args(arguments)
    kinds = tuple(given.kinds.split(",")) if given.kinds else ALL
    if unknown := sorted(set(kinds) - set(ALL)):
        parser.error(f"no kind called {', '.join(unknown)}")
    repeats = 3 if given.quick else given.repeats
    found = measured(kinds, repeats, folder=given.partial, workers=given.workers)
    rows = [summarised(kind, found[kind]) for kind in kinds]
    result = {"accepted": ACCEPTED, "rows": rows}
    print(table(result))
    if given.output is not None:
        given.output.write_text(json.dumps(result | {"outcomes": found}, indent=1), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
