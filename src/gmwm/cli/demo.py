"""gmwm demo: simulate a recording with known noise, calibrate it, and compare the result with the truth."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import gmwm
from gmwm.base.remarks import Dialect
from gmwm.base.text import wrap_text
from gmwm.calibration import Calibration
from gmwm.calibration.findings import certificate_of
from gmwm.calibration.options import CalibrationOptions
from gmwm.calibration.summary_text import summary
from gmwm.choosing.datasheets.entry import significant
from gmwm.choosing.selection.structure import structure_of
from gmwm.cli.calibrate import begin_pictures, calibration_files, calibration_helpers, run_calibration
from gmwm.cli.command import command
from gmwm.cli.export import kalibr_file
from gmwm.cli.output import Outcome, file_names, make_directory, progress, table_text
from gmwm.measuring.inspection.result import text as inspection_text
from gmwm.recording.signals import Imu
from gmwm.theory.processes.model import Model

EXAMPLES = ("gmwm demo", "gmwm demo --output here --seed 3")

RESOLUTION = {"gyro": 1e-5, "accel": 1e-4}
"""Quantization step of the simulated sensors (rad/s, m/s²): 1 % of their noise, so it does not affect the results."""


@command
def demo(
    output: Path = Path("demo-output"),
    seed: int = 2018,
    json: bool = False,
) -> Outcome:
    """Simulate a six-axis IMU, calibrate it, and compare the result with the truth.

    The simulated recording is written to a file, and then read, inspected, calibrated and plotted like your own
    recordings.

    Options:
        output (--output, -o): Directory for the files of the demo.
        seed (≥ 0): Seed of the simulation. Another seed gives another recording of the same unit."""
    from gmwm.theory.simulation import reference_imu

    helpers = calibration_helpers(plots=True)
    truth = {axis: model.sorted(100.0) for axis, model in reference_imu().items()}
    file = make_directory(output) / "imu.csv"
    imu = _simulate(truth, seed, file)
    # The demo takes a minute, so it prints each result at once.
    say: Callable[[str], None] = (lambda _: None) if json else print  # stdout is reserved for JSON
    say(f"Simulated {imu.duration / 3600:g} h of a six-axis IMU at rest, seed {seed}.\nRead it from {file}:\n")
    with progress(f"reading {file}"):
        imu = gmwm.read(file)
    with progress("inspecting"):
        inspection = gmwm.inspect(imu)
    say(inspection_text(inspection, Dialect.SHELL) + "\n")
    calibration = run_calibration(imu, CalibrationOptions(), helpers).of_file(file)
    plots = begin_pictures(helpers, calibration, "auto", "auto")
    say(summary(calibration, Dialect.SHELL))
    document, text = calibration.to_dict(), summary(calibration, Dialect.SHELL, details=True, every=True)
    rows, kalibr = _comparison(truth, calibration), kalibr_file(calibration, output)
    files = (*calibration_files(calibration, output, document=document, text=text, plots=plots), *kalibr.files)
    return Outcome(
        command="demo",
        document={
            "file": str(file), "seed": seed, "comparison": rows, "calibration": document,
            "inspection": inspection.to_dict(), "written": [str(file), *file_names(files)],
        },
        text=_comparison_text(rows, truth, calibration),
        files=files,
        together=True,
        obsolete=kalibr.obsolete,
        written=(file,),
        closing=_what_next(),
        remarks=kalibr.remarks,
    )  # fmt: skip


def _simulate(truth: Mapping[str, Model], seed: int, file: Path) -> Imu:
    """Simulate a recording of two hours, and write it to a file."""
    with progress("simulating"):
        imu = gmwm.simulate(truth, rate=100.0, samples=720_000, rng=seed, resolution=RESOLUTION)
    with progress(f"writing {file}"):
        imu.write(file)
    return imu


def _comparison(truth: Mapping[str, Model], found: Calibration) -> list[dict[str, Any]]:
    """Return rows of simulated parameters with truth, estimate and interval (None if not in the model)."""
    rows = []
    for axis, fit in found.items():
        units, intervals = truth[axis].units(fit.wavelet_variance.unit), found.axes[axis].intervals
        for name, true in truth[axis].parameters.items():
            rows.append({
                "axis": axis, "parameter": name, "unit": units[name], "truth": true,
                "estimate": fit.parameters.get(name),
                "interval": list(intervals[name]) if name in intervals else None,
            })  # fmt: skip
    return rows


def _comparison_text(rows: Sequence[Mapping[str, Any]], truth: Mapping[str, Model], found: Calibration) -> str:
    table, rules = [], []
    for k, row in enumerate(rows):
        first = k == 0 or rows[k - 1]["axis"] != row["axis"]
        if first and k:
            rules.append(k - 1)
        numbers = [significant(row["truth"], 3), "none", ""]
        if row["estimate"] is not None:
            low, high = row["interval"]
            numbers[1:] = [significant(row["estimate"], 3), f"{significant(low, 3)} … {significant(high, 3)}"]
        table.append([row["axis"] if first else "", row["parameter"], *numbers])
    shown = table_text(
        ["axis", "parameter", "truth", "estimate", "95 % interval"], table,
        title="Simulated values and estimates", texts=2, rules=rules,
    )  # fmt: skip
    same = [axis for axis, fit in found.items() if structure_of(fit.model) == structure_of(truth[axis])]
    inside = [low <= row["truth"] <= high for row in rows if row["interval"] for low, high in [row["interval"]]]
    lines = [
        "",
        shown,
        "\nVariances in (rad/s)² and (m/s²)², those of RW per sample; beta in 1/s.",
        *wrap_text(
            f"The simulated model is recommended for {len(same)} of {len(found)} axes, and {sum(inside)} of "
            f"{len(inside)} intervals contain the true value. White and quantization noise are known to about 1 %, "
            "random walks and slow Gauss-Markov processes to about 20 %, because two hours contain only a few of "
            "their correlation times."
        ),
    ]
    for axis, fit in found.items():
        if axis not in same:
            equal = [structure_of(other.model) for other in found.rankings[axis].equivalent]
            tie = " The data do not distinguish them." if structure_of(truth[axis]) in equal else ""
            lines += wrap_text(
                f"{axis}: {truth[axis].structure} was simulated, {fit.model.structure} is recommended.{tie}"
            )
    if certificate := certificate_of(found.values()):
        lines += wrap_text(certificate.text(Dialect.SHELL))
    return "\n".join(lines)


def _activation() -> str:
    """Return the command that activates the environment of `make demo`, or "" if the shell finds `gmwm`."""
    if shutil.which("gmwm") or sys.prefix == sys.base_prefix or os.name == "nt":
        return ""
    return f"  source {os.path.relpath(Path(sys.prefix, 'bin', 'activate'))}\n"


def _what_next() -> str:
    """Return the closing text, with the commands to calibrate one's own recording."""
    return (
        "\nNext, calibrate your own recording of some hours at rest:\n"
        f"{_activation()}"
        "  gmwm info FILE\n"
        "  gmwm calibrate FILE --output results\n"
        "Add --rate and --units gyro=deg/s,accel=g if the file does not state them."
    )
