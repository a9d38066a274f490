"""`python -m benchmarks [--json FILE] [--only TEXT]`: run every bench_*.py and print one table of ratios."""

from __future__ import annotations

import argparse
import importlib
import json
import pkgutil
import platform
from pathlib import Path

import numpy as np

import benchmarks
from benchmarks import harness
from gmwm import _core


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description="Ratios of times, paired and interleaved."
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the numbers to FILE")
    parser.add_argument("--only", default="", metavar="TEXT", help="only cases whose name or module contains TEXT")
    options = parser.parse_args()

    machine = {
        "processor": platform.machine(),
        "clone": _core.clone(),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
    bandwidth = harness.copy_bandwidth()
    timings = []
    for name in sorted(module.name for module in pkgutil.iter_modules(benchmarks.__path__)):
        if name.startswith("bench_"):
            for case in importlib.import_module(f"benchmarks.{name}").cases():
                if options.only in case.name or options.only in name:
                    timings.append(harness.measure(case, bandwidth))

    print(", ".join(f"{key} {value}" for key, value in machine.items()))
    print(f"plain copy: {bandwidth / 1e9:.1f} GB/s read and written; ratios are ours / reference, one thread\n")
    print(harness.table(timings))
    if options.json:
        options.json.write_text(json.dumps(harness.as_json(timings, bandwidth, machine), indent=2) + "\n")


if __name__ == "__main__":
    main()
