"""Memory and wall time of fresh processes: what a call, or a command from the shell, takes beyond its import.

The largest resident set is that of the process itself. What `ru_maxrss` says is that of its parent too where the parent
was larger (Linux carries it over into a new program), so it is asked only where there is no /proc.
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
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
from gmwm.theory.simulation import reference_imu, simulate
from gmwm.recording.writers import write
write(simulate(reference_imu(), rate=100.0, samples={n}, rng={seed}), {path!r})
"""
FILTERED = """
from scipy.signal import butter, lfilter
import polars
n, rate, rng = {n}, 200.0, np.random.default_rng(5)
def axis(white, slow, time, walk, resonance=0.0, line=0.0):
    x = lfilter(*butter(2, 45.0, fs=rate), white * rng.standard_normal(n))
    phi = np.exp(-1 / rate / time)
    x += lfilter([1.0], [1.0, -phi], slow * np.sqrt(1 - phi**2) * rng.standard_normal(n))
    x += walk * np.cumsum(rng.standard_normal(n)) + line * np.sin(2 * np.pi * 50.03 / rate * np.arange(n))
    pole = [1.0, -1.96 * np.cos(2 * np.pi * 62 / rate), 0.98**2]
    return x + resonance * lfilter([1.0], pole, rng.standard_normal(n)) if resonance else x
columns = {{
    "gyro_x": axis(2e-3, 4e-5, 60, 2e-8), "gyro_y": axis(2.2e-3, 5e-5, 100, 3e-8, line=2e-4),
    "gyro_z": axis(1.8e-3, 3e-5, 30, 1e-8), "accel_x": axis(1e-2, 4e-4, 120, 2e-7, resonance=2e-4),
    "accel_y": axis(1.1e-2, 5e-4, 300, 2e-7), "accel_z": axis(1.4e-2, 6e-4, 20, 4e-7, resonance=3e-4) + 9.81,
}}
table = polars.DataFrame({{"time": np.arange(n) / rate, **columns}})
table.write_csv({path!r}, float_precision=9)
"""
LAUNCH = """
import json, resource, subprocess, sys, time
begin = time.perf_counter()
done = subprocess.run({words!r}, capture_output=True, encoding="utf-8")
took, used = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
peak = used.ru_maxrss * (1 if sys.platform == "darwin" else 1024)
print(json.dumps([took, used.ru_utime + used.ru_stime, peak, done.returncode, done.stderr[-2000:]]))
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
    a stream keeps, `cpu` seconds of all its processors, `units` calibrated by a fleet. The peak of a command is that of
    its largest process.
    """

    name: str
    samples: int
    seconds: float
    inside: float
    peak: int
    beyond: int
    state: int = 0
    cpu: float = 0.0
    units: int = 0


def command(name: str, words: Sequence[str], samples: int, folder: Path, units: int = 0) -> Child:
    """Run a command of the shell as a user does, twice without earlier files; the shorter run counts, as other work of
    the machine only adds time. A small process starts it, so that its memory is its own."""
    script = LAUNCH.format(words=[sys.executable, "-m", "gmwm", *words])
    runs = []
    for _ in range(2):
        if "--output" in words:
            shutil.rmtree(folder / words[words.index("--output") + 1], ignore_errors=True)
        done = subprocess.run(
            [sys.executable, "-c", script], cwd=folder, capture_output=True, encoding="utf-8", check=True
        )  # fmt: skip
        took, cpu, peak, code, errors = json.loads(done.stdout)
        if code:
            raise RuntimeError(f"{name}: the command ended with {code}\n{errors}")
        runs.append((took, cpu, peak))
    took, cpu, peak = min(runs)
    base = run("import gmwm", "").peak
    return Child(name, samples, took, took, peak, max(peak - base, 0), cpu=cpu, units=units)


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


def imported(runs: int = 7) -> Iterator[Child]:
    """The time of `import gmwm`, without and with all its names, in a process that has NumPy: medians of several."""
    for name, more in (
        ("import gmwm", ""),
        ("import of all names", "; [getattr(gmwm, name) for name in gmwm.__all__]"),
    ):
        code = f"import time, numpy; begin = time.perf_counter(); import gmwm{more}; print(time.perf_counter() - begin)"
        took = statistics.median(float(subprocess.check_output([sys.executable, "-c", code])) for _ in range(runs))
        yield Child(f"{name} beyond NumPy", 0, took, took, 0, 0)


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
    yield from imported()
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
        run("writing", WRITE.format(n=200, seed=1, path="small.csv"), folder=folder)
        yield command("gmwm --version", ["--version"], 0, folder)
        yield command("gmwm info, csv of 200 rows", ["info", "small.csv"], 1200, folder)
        for kind in ("csv", "parquet"):
            file = f"unit.{kind}"
            run("writing", WRITE.format(n=rows, seed=1, path=file), folder=folder)
            read = f"gmwm.stream({file!r}).wavelet_variance()"
            yield run(f"six axes in pieces, {kind}", read, 6 * rows, folder)
            words = ["calibrate", file, "--output", f"results-{kind}"]
            yield command(f"gmwm calibrate, six axes, {kind}", words, 6 * rows, folder)
        run("writing", FILTERED.format(n=rows, path="filtered.csv"), folder=folder)
        words = ["calibrate", "filtered.csv", "--units", "gyro=rad/s,accel=m/s²", "--output", "results-filtered"]
        yield command("gmwm calibrate, six axes with filters, csv", words, 6 * rows, folder)
        (folder / "units").mkdir()
        each, count = rows * 6 // 10, 12
        for k in range(count):
            run("writing", WRITE.format(n=each, seed=k + 1, path=f"units/unit{k}.parquet"), folder=folder)
        words = ["fleet", "units", "--output", "fleet"]
        yield command("gmwm fleet, units of 6 x 6x10^5 samples", words, 6 * each * count, folder, units=count)
        yield command("gmwm demo", ["demo", "--output", "demo"], 6 * 720_000, folder)
