"""Processes on real and simulated recordings and curves, and what other programs take for such work.

The data are in the folder `shared` beside the checkout, or beside a folder that contains it. They are not part of the
package; without them, there are only the simulated units, logs and curves.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.children import Child, command, run
from benchmarks.results import Results
from gmwm.showing.plots.axes import number_text, power_text

FOLDERS = [folder / "shared" / "data" for folder in Path(__file__).resolve().parents[2:]]
DATA = next((folder for folder in FOLDERS if folder.exists()), FOLDERS[0])
RECORDINGS = tuple(f"adis16405_static_{k}.parquet" for k in (1, 2, 3))
CURVES = ("navchip", "mtig")
UNITS = "gyro=deg/s,accel=g"
LOG = """
import polars
from gmwm.theory.simulation import reference_imu, simulate
from gmwm.recording.writers import write
write(simulate(reference_imu(), rate=1000.0, samples={n}, rng=1), "whole.parquet")
table = polars.read_parquet("whole.parquet")
lost = np.random.default_rng(2).random(len(table)) < 0.005
table.filter(polars.Series(~lost)).write_parquet("gaps.parquet")
"""
UNIT = """
from scipy.signal import butter, lfilter
import polars
n, rate, rng = {n}, 100.0, np.random.default_rng([{k}, 30])
def axis(white):
    x = lfilter(*butter(rng.integers(1, 3), rng.uniform(0.4, 0.95)), white * rng.standard_normal(n))
    for phi, size in zip(np.exp(-1 / rate / rng.uniform(1, 300, 2)), white * 10 ** rng.uniform(-2, -0.5, 2)):
        x += lfilter([1.0], [1.0, -phi], size * np.sqrt(1 - phi**2) * rng.standard_normal(n))
    x += white * 10 ** rng.uniform(-5, -3.5) * np.cumsum(rng.standard_normal(n))
    for f, r in zip(rng.uniform(0.05, 0.45, 2), rng.uniform(0.9, 0.995, 2)):
        size = white * 10 ** rng.uniform(-1, 0) * np.sqrt(1 - r**2)
        x += lfilter([size], [1.0, -2 * r * np.cos(2 * np.pi * f), r**2], rng.standard_normal(n))
    return x + white * 10 ** rng.uniform(-1.5, 0) * np.sin(2 * np.pi * rng.uniform(0.01, 0.45) * np.arange(n))
columns = {{f"gyro_{{a}} [rad/s]": axis(2e-3) for a in "xyz"}} | {{f"accel_{{a}} [m/s²]": axis(1e-2) for a in "xyz"}}
columns["accel_z [m/s²]"] += 9.81
polars.DataFrame({{"time": np.arange(n) / rate, **columns}}).write_parquet({path!r})
"""
SHAPES = """
import json
from scipy.stats import chi2, norm
rng, rows = np.random.default_rng(7), []
def scale(low, high):
    return 10.0 ** rng.uniform(low, high)
def two_poles():
    r, angle = rng.uniform(0.3, 0.95), rng.uniform(0.2, 2.5)
    return f"AR(2, phi1={{2 * r * np.cos(angle):.4f}}, phi2={{-r * r:.4f}}, sigma2=1e-6)"
shapes = {{
    "WN": lambda: "WN(sigma2=1e-6)", "AR(2)": two_poles, "QN": lambda: f"QN(q2={{scale(-8, -5):.3e}})",
    "RW": lambda: f"RW(gamma2={{scale(-14, -10):.3e}})", "FN": lambda: f"FN(b2={{scale(-9, -7):.3e}})",
    "GM": lambda: f"GM(beta={{scale(-3, 0.5):.3e}}, sigma2={{scale(-9, -7):.3e}})",
    "DR": lambda: f"DR(omega={{scale(-11, -9):.3e}})",
    "OSC": lambda: f"OSC(frequency={{scale(-2.5, 0.5):.3e}}, quality={{scale(0, 1.5):.3e}}, "
                   f"sigma2={{scale(-8.5, -7):.3e}})",
}}
for k in range({count}):
    names = set(rng.choice(list(shapes), rng.integers(1, 5), replace=False))
    names |= set() if names & {{"WN", "AR(2)", "QN"}} else {{"WN"}}
    model = gmwm.Model.parse(" + ".join(shapes[name]() for name in shapes if name in names))
    samples, rate = int(scale(4.7, 6.8)), float(rng.choice([50, 100, 200, 250, 1000]))
    levels = int(np.log2(samples)) - 1
    truth = model.wavelet_variance(levels, rate)
    covariance = gmwm.covariance.wavelet_covariance(model, samples, rate)[:levels, :levels]
    spread = np.sqrt(np.diag(covariance))
    root = np.linalg.cholesky(covariance / np.outer(spread, spread) + 1e-12 * np.eye(levels))
    freedom = 2 * (truth / spread) ** 2
    values = truth * chi2.isf(norm.sf(root @ rng.standard_normal(levels)), freedom) / freedom
    values *= np.exp(0.03 * (k % 4 == 3) * rng.standard_normal(levels))
    curve = gmwm.WaveletVariance.from_values(values, rate=rate, samples=samples, axis="gyro_x", unit="rad/s")
    begin = time.perf_counter()
    gmwm.calibrate({{"gyro_x": curve}})
    rows.append(["+".join(name for name in shapes if name in names), time.perf_counter() - begin, peak()])
with open({path!r}, "w") as file:
    json.dump(rows, file)
"""
CURVE = """
import json
content = json.loads({text!r})
values = content["variance"][{axis!r}]
curve = gmwm.WaveletVariance.from_values(values, rate=content["rate_hz"], samples=content["samples"], axis={axis!r},
                                         unit="rad/s" if {axis!r}.startswith("gyro") else "m/s²")
gmwm.calibrate({{{axis!r}: curve}})
"""


def recordings(data: Path = DATA, samples: int = 2_400_000, units: int = 30, shapes: int = 188) -> Iterator[Child]:
    """Yield a process for each recording, for `units` simulated units with resonances and lines, for a log of 40
    minutes without and with 0.5 % lost samples and for each axis of a published curve, and a row for each of `shapes`
    simulated curves."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for name in RECORDINGS:
            if (data / name).exists():
                words = ["calibrate", str(data / name), "--rate", "100", "--units", UNITS, "--output", "results"]
                yield command(f"gmwm calibrate, {name.removesuffix('.parquet')}", words, _samples(data / name), folder)
        for k in range(units):
            run("writing", UNIT.format(n=samples * 5 // 12, k=k, path="unit.parquet"), folder=folder)
            words = ["calibrate", "unit.parquet", "--output", "results-unit"]
            yield command(f"gmwm calibrate, simulated unit {k}", words, 6 * (samples * 5 // 12), folder)
        run("writing", LOG.format(n=samples), folder=folder)
        for name, lost in (("whole", "no sample lost"), ("gaps", "0.5 % of the samples lost")):
            words = ["calibrate", f"{name}.parquet", "--output", f"results-{name}"]
            yield command(f"gmwm calibrate, 1 kHz, {lost}", words, 6 * samples, folder)
    for name in CURVES:
        if (file := data / "wavelet_variance" / f"{name}.json").exists():
            text = file.read_text(encoding="utf-8")
            for axis in json.loads(text)["variance"]:
                code = CURVE.format(text=text, axis=axis)
                runs = [run(f"gmwm.calibrate, curve of {name}, {axis}", code) for _ in range(2)]
                yield min(runs, key=lambda child: child.inside)
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "shapes.json"
        run("simulated curves", SHAPES.format(count=shapes, path=str(file)))
        for k, (shape, took, peak) in enumerate(json.loads(file.read_text(encoding="utf-8"))):
            yield Child(f"gmwm.calibrate, curve of simulated {k}, {shape}", 0, took, took, peak, 0)


def _samples(file: Path) -> int:
    """Return the number of samples of all axes in a Parquet file."""
    from polars import scan_parquet

    table = scan_parquet(file)
    axes = [name for name in table.collect_schema().names() if name.startswith(("gyro", "accel"))]
    return len(axes) * int(table.select(axes[0]).collect().height)


# --- other programs ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Other:
    """Processor time (s) of another program for some work, measured once, and ours in a run."""

    work: str
    program: str
    seconds: float
    ours: Callable[[Results], float] | None
    note: str = ""


MEASURED = "on 2026-11-28, on a machine with two processors (x86-64-v4)"
OTHERS = (
    Other("wavelet variance of 10⁶ samples", "R gmwm", 0.59,
          lambda r: r.took("gmwm.wavelet_variance of 10^6", "np.cumsum")),
    Other("the same, robust", "R gmwm", 3.49, lambda r: r.took("robust, efficiency 0.6: white noise")),
    Other("fit of 3·GM + WN + QN + RW to 10⁶ samples", "R gmwm", 4.2,
          lambda r: r.took("from 10^6 samples to a certified fit"),
          "not the optimum"),
    Other("confidence intervals and test, 2·10⁵ samples (gmwm: 10⁶)", "R gmwm", 13.4,
          lambda r: r.took("confidence intervals of the fit") + r.took("goodness of fit of the fit")),
    Other("ranking of 15 models (gmwm: 79)", "R gmwm", 32.5, lambda r: r.took("selection from a wavelet variance")),
    Other("one model for four recordings", "R mgmwm", 9.7, None),
    Other("overlapping Allan deviation of 10⁵ samples (gmwm: 10⁶)", "R gmwm", 2.4,
          lambda r: r.took("overlapping Allan, octaves of 10^6", "allantools")),
)  # fmt: skip
RATIOS = (
    "For octaves of 10⁶ samples, allantools 2024.6 took 12.3 times as long as gmwm, and allan-variance 1.0,\n"
    "avar 1.0.4 and alvar 0.1.2 7 to 11 times."
)


def rows_of_recordings(results: Results) -> list[list[str]]:
    """Return a row for each recording, for the slowest simulated unit and for the slowest curve: samples, wall and
    processor time (s), MB."""
    units = [row for row in results.recordings if "simulated unit" in row["name"]]
    rows = [row for row in results.recordings if row["samples"] and row not in units]
    if units:
        slowest = max(units, key=lambda row: row["seconds"])
        rows.insert(0, slowest | {"name": f"slowest of {len(units)} simulated units"})
    curves = sorted((row for row in results.recordings if not row["samples"]), key=lambda row: row["inside"])
    table = [
        [
            row["name"].removeprefix("gmwm calibrate, "), power_text(row["samples"]), f"{row['seconds']:.2g}",
            f"{row['cpu']:.2g}", f"{row['peak'] / 1e6:.0f}",
        ]
        for row in rows
    ]  # fmt: skip
    if curves:
        slowest = curves[-1]
        published = sum("simulated" not in row["name"] for row in curves)
        name = f"slowest of {len(curves)} curves, {published} published"
        table.append([name, "", f"{slowest['inside']:.2g}", "", f"{slowest['peak'] / 1e6:.0f}"])
    return table


def rows_of_others(results: Results) -> list[list[str]]:
    """Return a row for each work of another program, with our time if this run measured it."""
    rows = []
    for other in OTHERS:
        try:
            ours = f"{number_text(other.ours(results), 2)} s" if other.ours else ""
        except LookupError:
            ours = ""
        program = f"{other.program} ({other.note})" if other.note else other.program
        rows.append([other.work, program, f"{number_text(other.seconds, 3)} s", ours])
    return rows
