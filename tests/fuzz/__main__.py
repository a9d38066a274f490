"""Change good files at random, and check that each gives an answer or one error of gmwm, soon and in little memory.

    python -m tests.fuzz --seconds 60 text rosbag

An input follows from its family, the first seed, the number of seeds and its number. Inputs that fail are kept in
build/fuzz.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import shutil
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

from tests.fuzz.corpus import FAMILIES, OTHERS

LIMIT = 10.0
"""Longest processor time (s) of an input."""
PATIENCE = 100.0
"""Time (s) after which an input hangs, unless it has used less than `LIMIT` of processor time and still uses some."""
MEMORY = 2 << 30
"""Largest memory of the process (bytes)."""
BATCH = 2000
"""Number of inputs of a process. It begins anew then, because libraries keep some memory."""
KEPT = Path("build") / "fuzz"


class Run:
    """The run of one family."""

    def __init__(self, family: str, seed: int, seeds: int) -> None:
        self.family, self.seed, self.seeds = family, seed, seeds
        self.done, self.longest, self.memory = 0, 0.0, 0
        self.outcomes: Counter[str] = Counter()
        self.failures: dict[str, list[Any]] = {}

    def until(self, end: float, first: int = 0) -> None:
        """Try inputs until a time."""
        while time.monotonic() < end:
            first = self._batch(first, end)

    def _batch(self, first: int, end: float) -> int:
        """Try the inputs of one process; return the number of the next input."""
        numbers = map(str, (self.seed, self.seeds, first, first + BATCH))
        command = [sys.executable, "-m", "tests.fuzz.worker", self.family, *numbers]
        errors = (KEPT / "stderr.txt").open("w")
        worker = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=errors, env=os.environ | {"OPENBLAS_NUM_THREADS": "1"}
        )
        assert worker.stdout is not None
        number, path, counts = first, "", {}
        try:
            while time.monotonic() < end:
                ready = _ready(worker)
                line = worker.stdout.readline() if ready else b""
                if not line:
                    why = f"no end after {PATIENCE:g} s" if not ready else f"the process ended with {worker.wait()}"
                    if number < first + BATCH - 1 or path:
                        self._failed(number, path, why, [])
                    return number + 1
                report = json.loads(line)
                if "begin" in report:
                    number, path = report["begin"], report["path"]
                elif "failed" in report:
                    self._failed(number, path, report["why"], report.get("trace", []))
                else:
                    self.done, path, counts = self.done + 1, "", report["counts"]
                    self.longest, self.memory = max(self.longest, report["seconds"]), max(self.memory, report["memory"])
                    if report["seconds"] > LIMIT or report["memory"] > MEMORY:
                        self._failed(number, path, f"{report['seconds']:.1f} s, {report['memory'] / 1e9:.2f} GB", [])
                        return number + 1
                    if number == first + BATCH - 1:
                        return number + 1
            return number + 1
        finally:
            self.outcomes.update(counts)
            worker.kill()
            worker.wait()
            worker.stdout.close()
            errors.close()

    def _failed(self, number: int, path: str, why: str, trace: list[str]) -> None:
        """Keep a failure, the first of each kind with its file."""
        own = [line.strip() for line in trace if line.strip().startswith("File")]
        kind = f"{why.partition(':')[0]} at {own[-1] if own else 'unknown place'}"
        self.failures.setdefault(kind, []).append(number)
        if len(self.failures[kind]) > 1:
            return
        folder = KEPT / self.family
        folder.mkdir(parents=True, exist_ok=True)
        if path and Path(path).exists():
            shutil.copy(path, folder / f"{number}_{Path(path).name}")
        (folder / f"{number}.txt").write_text("\n".join([why, *trace]) + "\n", encoding="utf-8")
        print(f"  {self.family} {number}: {why}\n    " + "\n    ".join(own[-3:]), flush=True)


def _ready(worker: subprocess.Popen[bytes]) -> bool:
    """Wait for the next report of a process; return False if the process hangs."""
    before = last = _processor_time(worker.pid)
    while not select.select([worker.stdout], [], [], PATIENCE)[0]:
        now = _processor_time(worker.pid)
        if not last < now < before + LIMIT:
            return False
        last = now  # the computer is busy
    return True


def _processor_time(number: int) -> float:
    """Return the processor time (s) of a process; 0 if the system does not tell it."""
    try:
        words = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def main() -> int:
    """Run the families, and print a line for each; return 1 if any input failed."""
    parser = argparse.ArgumentParser(description="Change good files at random, and read them.")
    parser.add_argument("families", nargs="*", default=[*FAMILIES, *OTHERS], help="by default all")
    parser.add_argument("--seconds", type=float, default=60.0, help="time for each family (60)")
    parser.add_argument("--seed", type=int, default=1, help="first seed (1)")
    parser.add_argument("--seeds", type=int, default=20, help="number of seeds, which the inputs take in turn (20)")
    parser.add_argument("--first", type=int, default=0, help="number of the first input (0)")
    given = parser.parse_args()
    KEPT.mkdir(parents=True, exist_ok=True)
    failed = False
    for family in given.families:
        run = Run(family, given.seed, given.seeds)
        begin = time.monotonic()
        run.until(begin + given.seconds, given.first)
        outcomes = ", ".join(f"{count} {name}" for name, count in run.outcomes.most_common())
        took, count = time.monotonic() - begin, sum(map(len, run.failures.values()))
        print(
            f"{family}: {run.done} inputs in {took:.0f} s ({outcomes}); longest {run.longest:.1f} s, "
            f"{run.memory / 1e9:.2f} GB; {count} failed in {len(run.failures)} ways",
            flush=True,
        )
        failed |= bool(run.failures)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
