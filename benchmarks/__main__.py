"""`python -m benchmarks`: run every bench_*.py, the scaling curves and the processes, and print what they took.

`--json FILE` writes the numbers too, `--page` the page in docs. `--from FILE` takes the numbers of an earlier run; with
`--only TEXT` it measures that part again, where something disturbed it, and takes the rest from there.
Files are written at the end, whole or not at all: Ctrl-C leaves those of the last run.
"""

from __future__ import annotations

import argparse
import importlib
import json
import pkgutil
import platform
import sys
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import benchmarks
import gmwm
from benchmarks import children, harness, page, recordings, scaling, targets
from benchmarks.results import Results
from gmwm.base import _core
from gmwm.base.atomic_files import write_text
from gmwm.base.threads import processors

OTHERS = ("numpy", "allantools", "PyWavelets", "statsmodels")
IDENTITY = {"timings": ("module", "name", "against"), "curves": ("along", "name"), "children": ("name", "samples"),
            "recordings": ("name", "samples")}  # fmt: skip
"""What tells the rows of each part apart."""
ROOM = 60
"""Bytes that a sample of the longest record in memory may take, by us or by what we compare with."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description="Ratios of times, paired and interleaved; scaling; memory."
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the numbers to FILE")
    parser.add_argument("--page", action="store_true", help="write docs/benchmarks.md with its picture and numbers")
    parser.add_argument("--tables", action="store_true", help="print the appendix of the page, with all tables")
    parser.add_argument("--from", type=Path, metavar="FILE", dest="earlier", help="take what an earlier run found")
    parser.add_argument(
        "--only", default="", metavar="TEXT",
        help="only cases whose name or module contains TEXT; also: scaling, processes, recordings",
    )  # fmt: skip
    options = parser.parse_args(arguments)
    if options.page and options.only and not options.earlier:
        parser.error("--page needs the whole suite, not --only; or --from a run of all")
    values = json.loads(options.earlier.read_text(encoding="utf-8")) if options.earlier else measured(options.only)
    if options.earlier and options.only:
        values = renewed(values, measured(options.only))
    print(page.appendix(page.Results(values)) if options.tables else words(values))
    if options.json:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        write_text(options.json, json.dumps(values, indent=1, ensure_ascii=False) + "\n")
    if options.page:
        page.write(values)
    return 0


def measured(only: str = "") -> dict[str, Any]:
    """All numbers, as plain data; `only` those of cases and parts with this text in their name."""
    # Some records are too short for their model, which is no news here.
    warnings.simplefilter("ignore", gmwm.errors.FitWarning)
    largest = 10**9
    in_memory = 10**8 if children.free_memory() > ROOM * 10**8 else 10**7
    found: dict[str, Any] = {"machine": machine(), "copy_bandwidth_bytes_per_s": harness.copy_bandwidth()}
    found["timings"] = [
        {"module": module, **asdict(timing)} for module, timing in _timings(only, found["copy_bandwidth_bytes_per_s"])
    ]
    parts: dict[str, tuple[str, Callable[[], Iterable[Any]]]] = {
        "curves": ("scaling", lambda: scaling.curves(largest, in_memory)),
        "children": ("processes", lambda: children.children(largest, in_memory)),
        "recordings": ("recordings", recordings.recordings),
    }
    for key, (name, part) in parts.items():
        found[key] = []
        for row in part() if only in name else ():
            _tell(row.name)
            found[key].append(asdict(row))
    return found


def renewed(earlier: dict[str, Any], later: dict[str, Any]) -> dict[str, Any]:
    """The numbers of one run with those that a later one has instead."""
    if earlier["machine"] != later["machine"]:
        raise SystemExit(f"the earlier run was on another machine: {earlier['machine']}; run the whole suite")
    values = dict(earlier)
    for key, identity in IDENTITY.items():
        new = {tuple(row[name] for name in identity): row for row in later[key]}
        kept = [new.pop(tuple(row[name] for name in identity), row) for row in earlier[key]]
        values[key] = [*kept, *new.values()]
    return values


def machine() -> dict[str, str]:
    """What the numbers hang on, without a name of a machine."""
    return {
        "processor": f"{platform.machine()} ({_core.clone()})", "processors": str(processors()),
        "Python": platform.python_version(), **{package: version(package) for package in OTHERS},
    }  # fmt: skip


def _timings(only: str, bandwidth: float) -> list[tuple[str, harness.Timing]]:
    timings = []
    for name in sorted(module.name for module in pkgutil.iter_modules(benchmarks.__path__)):
        # The words of one part name it alone.
        if name.startswith("bench_") and only not in ("scaling", "processes", "recordings"):
            for case in importlib.import_module(f"benchmarks.{name}").cases():
                if only in case.name or only in name:
                    _tell(case.name)
                    timings.append((name, harness.measure(case, bandwidth)))
    return timings


def _tell(name: str) -> None:
    if sys.stderr.isatty():
        print(f"\r{name[:110]:110}", end="", file=sys.stderr, flush=True)


def words(values: dict[str, Any]) -> str:
    """What a run found, for the terminal."""
    bandwidth = values["copy_bandwidth_bytes_per_s"] / 1e9
    parts = [
        ", ".join(f"{key} {value}" for key, value in values["machine"].items()),
        f"plain copy: {bandwidth:.1f} GB/s read and written; ratios are ours / reference, one thread\n",
    ]
    timings = [harness.Timing(**{key: row[key] for key in row if key != "module"}) for row in values["timings"]]
    if timings:
        parts.append(harness.table(timings) + "\n")
    for curve in values["curves"]:
        points = zip(curve["at"], curve["seconds"], strict=True)
        unit = "ns a sample" if curve["along"] == "samples" else "ms"
        shown = (f"{n}: {1e9 * took / n if unit[0] == 'n' else 1e3 * took:.3g}" for n, took in points)
        parts.append(f"{curve['name']}, {unit}, by {curve['along']}: {', '.join(shown)}")
    for row in (*values["children"], *values["recordings"]):
        size = f"{row['peak'] / 1e6:.0f} MB, {row['beyond'] / 1e6:.0f} beyond the import"
        all_processors = f" ({row['cpu']:.2f} s of all processors)" if row.get("cpu") else ""
        parts.append(f"{row['name']}, {row['samples']} samples: {row['seconds']:.2f} s{all_processors}, {size}")
    results = Results(values)
    if values["children"] and values["curves"] and values["timings"]:
        parts.append("\nwhat was asked: before, asked, found, reached")
        parts += (f"{work}: {', '.join(shown)}" for work, *shown, _ in targets.rows(results))
    return "\n".join(parts)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
