"""gmwm demo: a recording with known truth, calibrated from its file as a user's own would be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gmwm.cli.options import Json

if TYPE_CHECKING:
    from gmwm.estimation.result import Fit
    from gmwm.processes.model import Model
    from gmwm.variance.result import WaveletVariance

EXAMPLES = ("gmwm demo", "gmwm demo --output here --seed 3")

RATE = 100.0
SAMPLES = 720_000
CONFIDENCE = 0.95
RESOLUTION = {"gyro": 1e-5, "accel": 1e-4}
"""Least significant bit of the demo's output (rad/s, m/s²): a hundredth of the noise, as a good unit has."""


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Directory for what the demo writes.")] = Path(
        "demo-output"
    ),
    seed: Annotated[int, typer.Option(help="Another seed is another recording of the same unit.", min=0)] = 2018,
    json: Json = False,
) -> None:
    """Simulate a six-axis IMU, write it to a file, calibrate it from that file, and compare with the truth.

    The file goes the way of your own: read, inspect, wavelet variance, fit, pictures.
    """
    import gmwm
    from gmwm.cli.fit import as_dict, draw, fit_axes, write_fits
    from gmwm.cli.output import made_directory, print_json, progress, tell, told_warnings
    from gmwm.cli.parallel import over_axes
    from gmwm.inference.summary import Way
    from gmwm.inspection import inspect
    from gmwm.readers import read
    from gmwm.simulation import reference_imu, simulate
    from gmwm.writers import write

    truth = {axis: model.sorted(RATE) for axis, model in reference_imu().items()}
    file = made_directory(output) / "imu.csv"
    say = _silent if json else print
    with told_warnings() as told:
        with progress("simulating"):
            imu = simulate(truth, rate=RATE, samples=SAMPLES, seed=seed, resolution=RESOLUTION)
        with progress(f"writing {file}"):
            write(imu, file)
        say(
            f"Simulated {imu.duration / 3600:g} h of a six-axis IMU at rest, seed {seed}.\n"
            f"Wrote {file}, read it back:\n"
        )
        with progress(f"reading {file}"):
            imu = read(file)
        with progress("inspecting"):
            inspection = inspect(imu)
        say(inspection.summary())

        curves = over_axes(gmwm.wavelet_variance, imu.signals, "wavelet variance")
        fits = fit_axes({axis: gmwm.parse_model(model.structure) for axis, model in truth.items()}, imu.signals)
        with progress("intervals and tests"):
            axes = {axis: as_dict(found, Way(CONFIDENCE)) for axis, found in fits.items()}
            rows = _comparison(truth, fits)
        if not json:
            _print_comparison(rows, fits)
        for axis, found in fits.items():
            for note in found.diagnostics.notes():
                tell(told, f"{axis}: {note}")
        content = {
            "file": str(file), "seed": seed, "comparison": rows,
            "axes": axes,
        }  # fmt: skip
        written = [file, write_fits(output / "fits.json", content), *_pictures(output, curves, fits)]
        written += [draw({axis: found}, output / f"fit_{axis}.png", "wavelet", False) for axis, found in fits.items()]
    if json:
        print_json("demo", {**content, "inspection": inspection.to_dict(), "written": list(map(str, written))}, told)
    else:
        _print_what_next(written)


def _silent(_: str) -> None:
    """In place of `print` where stdout is for JSON alone."""


def _comparison(truth: Mapping[str, Model], fits: Mapping[str, Fit]) -> list[dict[str, Any]]:
    """Truth and estimate of every parameter of every axis."""
    rows = []
    for axis, found in fits.items():
        units, values = found.units(), truth[axis].parameters
        intervals = found.confidence_intervals(CONFIDENCE)
        for name, estimate in found.parameters.items():
            true = values[name]
            assert true is not None
            rows.append({
                "axis": axis, "parameter": name, "unit": units[name],
                "truth": true, "estimate": estimate, "interval": list(intervals[name]),
            })  # fmt: skip
    return rows


def _print_comparison(rows: Sequence[Mapping[str, Any]], fits: Mapping[str, Fit]) -> None:
    from gmwm.cli.output import print_table

    table, rules = [], []
    for k, row in enumerate(rows):
        first = k == 0 or rows[k - 1]["axis"] != row["axis"]
        if first and k:
            rules.append(k - 1)
        low, high = row["interval"]
        numbers = [f"{row['truth']:.2e}", f"{row['estimate']:.2e}", f"{low:.2e} … {high:.2e}"]
        table.append([row["axis"] if first else "", row["parameter"], *numbers])
    print()
    print_table(
        ["axis", "parameter", "truth", "estimate", "95 % interval"], table,
        title="What was simulated, and what was found in the file", texts=2, rules=rules,
    )  # fmt: skip
    inside = sum(low <= row["truth"] <= high for row in rows for low, high in [row["interval"]])
    print(
        "\nVariances in (rad/s)² and (m/s²)², those of RW per sample; beta in 1/s.\n"
        f"{inside} of {len(rows)} intervals hold the truth; 95 % should. White and quantization\n"
        "noise are known to a per cent; random walks and slow Gauss-Markov processes\n"
        "to some 20 %: two hours hold few of their swings."
    )
    tests = [found.goodness_of_fit() for found in fits.values()]
    print(f"Goodness of fit: p from {min(t.pvalue for t in tests):.2f} to {max(t.pvalue for t in tests):.2f}.")
    gaps = [found.gap for found in fits.values() if found.gap is not None]
    if gaps:
        print(f"Each fit is proven best: no other gains more than {100 * max(gaps):.2g} % of its objective.")


def _pictures(folder: Path, curves: Mapping[str, WaveletVariance], fits: Mapping[str, Fit]) -> list[Path]:
    """All axes: their wavelet variances in a grid, by sensor as Allan deviations, and their fits."""
    from gmwm.cli.output import progress
    from gmwm.plots.imu import plot_imu

    paths = [folder / name for name in ("wavelet_variances.png", "by_sensor.png", "allan_deviations.png", "fits.png")]
    with progress("drawing"):
        plot_imu(curves, path=paths[0])
        plot_imu(curves, split=False, path=paths[1])
        plot_imu(curves, split=False, view="allan", units="datasheet", path=paths[2])
        plot_imu(fits, path=paths[3])
    return paths


def _print_what_next(written: Sequence[Path]) -> None:
    from gmwm.cli.output import print_written

    print_written(written)
    print(
        "\nNow your own recording, some hours at rest:\n"
        "  gmwm info FILE\n"
        "  gmwm fit FILE --model '2*GM + WN + RW' --output results\n"
        "with --rate and --units gyro=deg/s,accel=g where the file does not say them."
    )
