"""Memory and wall time of fresh processes: what a call, or a command from the shell, takes beyond its import.

The largest resident set is that of the process itself. What `ru_maxrss` says is that of its parent too where the parent
was larger (Linux carries it over into a new program), so it is asked only where there is no /proc.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

DRAW = "rng = np.random.default_rng(1); x = rng.standard_normal({n})"
STREAM = """
live, rng, block = gmwm.WaveletAccumulator(100.0{option}), np.random.default_rng(1), np.empty(10**6)
for _ in range({n} // block.size):
    live.update(rng.standard_normal(out=block))
live.result({result})
import pickle
state = len(pickle.dumps(live))
"""
WRITE = """
from gmwm.simulation import reference_imu, simulate
from gmwm.writers import write
write(simulate(reference_imu(), rate=100.0, samples={n}, rng=1), {path!r})
"""
COMMAND = """
from gmwm.cli.main import run
sys.argv = ["gmwm", *{words!r}]
try:
    run()
except SystemExit as ended:
    if ended.code:
        raise
"""
FRAME = """
import json, os, sys, time
def peak():
    try:
        with open("/proc/self/status") as file:
            return next(int(line.split()[1]) for line in file if line.startswith("VmHWM")) * 1024
    except OSError:
        import resource
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
import numpy as np, gmwm
for name in gmwm.__all__:
    getattr(gmwm, name)
before, begin = peak(), time.perf_counter()
{code}
took = time.perf_counter() - begin
with open({report!r}, "w") as file:
    json.dump({{"before": before, "peak": peak(), "inside": took,
               "state": globals().get("state", 0)}}, file)
"""


@dataclass(frozen=True)
class Child:
    """What one process took.

    `samples` it worked on in all axes, `seconds` of wall time with the start of Python, `inside` without, `peak` bytes
    of its largest resident set, `beyond` those above that after the import of all names of gmwm, `state` those of what
    a stream keeps.
    """

    name: str
    samples: int
    seconds: float
    inside: float
    peak: int
    beyond: int
    state: int = 0


def run(name: str, code: str, samples: int = 0, folder: Path | None = None) -> Child:
    """Run Python statements in a process of their own; np and gmwm are imported there."""
    with tempfile.TemporaryDirectory() as scratch:
        report = Path(scratch) / "report.json"
        script = FRAME.format(code=code, report=str(report))
        begin = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-c", script], cwd=folder or scratch, capture_output=True, encoding="utf-8", check=False
        )
        took = time.perf_counter() - begin
        if done.returncode:
            raise RuntimeError(f"{name}: the process ended with {done.returncode}\n{done.stderr[-2000:]}")
        found = json.loads(report.read_text(encoding="utf-8"))
    return Child(name, samples, took, found["inside"], found["peak"], found["peak"] - found["before"], found["state"])


def free_memory() -> float:
    """Bytes that can be had without swapping; those of the machine where the system does not say."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="utf-8").splitlines()
        return 1024.0 * next(float(line.split()[1]) for line in lines if line.startswith("MemAvailable"))
    except OSError:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))


def children(largest: int = 10**9, in_memory: int = 10**8, rows: int = 10**6) -> Iterator[Child]:
    """Calls and commands: streams of up to `largest` samples, arrays of up to `in_memory`, files of `rows` rows."""
    yield run("import gmwm", "")
    for n in (n for n in (10**6, 10**7, 10**8) if n <= in_memory):
        yield run("wavelet variance, in memory", f"{DRAW.format(n=n)}; gmwm.wavelet_variance(x, 100.0)", n)
    n = min(in_memory, 10**7)
    yield run("robust wavelet variance", f"{DRAW.format(n=n)}; gmwm.wavelet_variance(x, 100.0, robust=True)", n)
    for n in (n for n in (10**7, 10**8, 10**9) if n <= largest):
        yield run("wavelet variance, in chunks", STREAM.format(n=n, option="", result=""), n)
    n = min(largest, 10**8)
    yield run(
        "the same, robust", STREAM.format(n=n, option=", robust=True", result="robust=True"), n
    )  # fmt: skip
    n = min(in_memory, 10**6)
    model = "3*GM + WN + QN + RW"
    yield run("certified fit from the samples", f"{DRAW.format(n=n)}; gmwm.fit({model!r}, x.cumsum(), 100.0)", n)
    yield from _of_files(rows)


def _of_files(rows: int) -> Iterator[Child]:
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for kind in ("csv", "parquet"):
            file = f"unit.{kind}"
            run("writing", WRITE.format(n=rows, path=file), folder=folder)
            read = f"gmwm.stream({file!r}).wavelet_variance()"
            yield run(f"six axes in pieces, {kind}", read, 6 * rows, folder)
            words = ["calibrate", file, "--output", f"results-{kind}"]
            yield run(f"gmwm calibrate, six axes, {kind}", COMMAND.format(words=words), 6 * rows, folder)
        yield run("gmwm demo", COMMAND.format(words=["demo", "--output", "demo"]), 6 * 720_000, folder)
