"""Processes on real recordings and published curves, and what other programs take for such work.

The data are in the folder `shared` beside the checkout, or beside a folder that contains it. They are not part of the
package; without them, there are only the simulated logs.
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
CURVE = """
import json
content = json.loads({text!r})
values = content["variance"][{axis!r}]
curve = gmwm.WaveletVariance.from_values(values, rate=content["rate_hz"], samples=content["samples"], axis={axis!r},
                                         unit="rad/s" if {axis!r}.startswith("gyro") else "m/s²")
gmwm.calibrate({{{axis!r}: curve}})
"""


def recordings(data: Path = DATA, samples: int = 2_400_000) -> Iterator[Child]:
    """Yield a process for each recording, for a log of 40 minutes without and with 0.5 % lost samples, and for each
    axis of a published curve."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for name in RECORDINGS:
            if (data / name).exists():
                words = ["calibrate", str(data / name), "--rate", "100", "--units", UNITS, "--output", "results"]
                yield command(f"gmwm calibrate, {name.removesuffix('.parquet')}", words, _samples(data / name), folder)
        run("writing", LOG.format(n=samples), folder=folder)
        for name, lost in (("whole", "no sample lost"), ("gaps", "0.5 % of the samples lost")):
            words = ["calibrate", f"{name}.parquet", "--output", f"results-{name}"]
            yield command(f"gmwm calibrate, 1 kHz, {lost}", words, 6 * samples, folder)
    for name in CURVES:
        if (file := data / "wavelet_variance" / f"{name}.json").exists():
            text = file.read_text(encoding="utf-8")
            for axis in json.loads(text)["variance"]:
                yield run(f"gmwm.calibrate, curve of {name}, {axis}", CURVE.format(text=text, axis=axis))


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
    "avar 1.0.4 and alvar 0.1.2 took 7 to 11 times as long."
)


def rows_of_recordings(results: Results) -> list[list[str]]:
    """Return a row for each recording, and one for the slowest curve: samples, wall and processor time (s), MB."""
    rows = [row for row in results.recordings if row["samples"]]
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
        name = f"slowest of {len(curves)} published curves, {slowest['name'].partition('curve of ')[2]}"
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
