"""gmwm simulate: simulate a static recording with known noise."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import gmwm
from gmwm.base.errors import OptionError
from gmwm.base.text import duration_text
from gmwm.base.time_base import parse_length
from gmwm.cli.command import command
from gmwm.cli.model_source import read_given
from gmwm.cli.options import parse_models
from gmwm.cli.output import Outcome, progress

if TYPE_CHECKING:
    from gmwm.files.importers import Given

EXAMPLES = (
    "gmwm simulate --reference --duration 1h --output imu.csv",
    'gmwm simulate --model "gyro=WN(sigma2=4e-8)" --duration 10min -o gyro.parquet',
    "gmwm simulate --reference --duration 10min -o imu.csv --components parts.csv",
    'gmwm simulate --from "gyro: N=2deg/√h" --rate 200 --duration 1h -o gyro.csv',
)


@command
def simulate(
    output: Path,
    duration: str,
    model: list[str] | None = None,
    reference: bool = False,
    source: str | None = None,
    rate: float | None = None,
    seed: int = 1,
    components: Path | None = None,
) -> Outcome:
    """Simulate a static recording with known noise.

    Parameter values are in SI units, and their unit of time is one sample, except for GM.beta, which is in 1/s. Gravity
    is added to accel_z. Each axis has its own stream of random numbers. --components does not change the recording:
    each axis, without gravity, is the sum of its columns in the file of --components.

    Options:
        output (--output, -o): File to write: .csv, .parquet or .mcap.
        duration (LENGTH): Duration of the recording, such as 90s, 20min, 1h30m, 2h, 1d or a number of seconds.
        model (--model, -m [AXIS=]MODEL): Model with all parameter values: MODEL for all six axes, gyro=MODEL or
            accel=MODEL for the three axes of a sensor, gyro_x=MODEL for one axis. Repeat the option for other axes.
        reference: Instead of --model: use the models of the demo, for six axes of a good MEMS unit.
        rate: Sampling rate (Hz). Default: 100, or the rate in the file of --from.
        seed (≥ 0): Seed of the simulation. The same seed gives the same recording.
        components: Also write the simulated process of each term to this .csv or .parquet file, in columns such as
            'gyro_x WN \\[rad/s]'."""
    from gmwm.theory.simulation import models_by_axis, reference_imu

    if sum((reference, bool(model), source is not None)) != 1:
        raise OptionError(
            "exactly one of --model, --reference and --from is needed", argument="model", got=model,
            advice="Write a model with {--model}, the numbers of a datasheet with {--from}, or simulate the unit of "
            "the demo with {--reference}.",
        )  # fmt: skip
    seconds = parse_length(duration)
    _check_paths(output, components)  # before the simulation, which can take minutes
    if source is not None:
        noise = _given_at(source, rate)
        rate = noise.rate
    truth = models_by_axis(
        noise.models if source is not None else reference_imu() if reference else parse_models(model or [])
    )
    imu, columns = _write(
        truth, 100.0 if rate is None else rate, seconds=seconds, seed=seed, output=output, components=components
    )
    lines = [f"{axis:<8} {m}" for axis, m in truth.items()]
    lines.append(f"Wrote {output}: {len(imu)} samples at {imu.rate:g} Hz, {imu.duration:g} s, seed {seed}")
    if components is not None:
        lines.append(f"Wrote {components}: {len(columns)} columns of the same length, one for each process")
    return Outcome(
        command="simulate",
        document={
            "file": str(output), "seed": seed, "rate": imu.rate, "samples": len(imu), "duration": imu.duration,
            "axes": {axis: {"model": str(m), "parameters": m.parameters} for axis, m in truth.items()},
            "components": {"file": str(components), "columns": list(columns)} if columns else None,
        },
        text="\n".join(lines),
        written=(output,) if components is None else (output, components),
        listed=False,
    )  # fmt: skip


def _check_paths(output: Path, components: Path | None) -> None:
    """Raise an OptionError if a path has a wrong ending, or both are the same."""
    from gmwm.recording.writers import MCAP, SUFFIXES, table_path

    if output.suffix.lower() not in (*SUFFIXES, MCAP):
        raise OptionError(
            argument="output", expected="a file name that ends in .csv, .parquet or .mcap", got=str(output)
        )
    if components is not None and table_path(components).resolve() == output.resolve():
        raise OptionError(argument="components", expected="another file than --output", got=str(components))


def _write(
    truth: Mapping[str, gmwm.Model], rate: float, seconds: float, seed: int, output: Path, components: Path | None
) -> tuple[gmwm.Imu, tuple[str, ...]]:
    """Simulate a recording, and write it and its processes; return it and the processes' column names."""

    files = None
    with progress(f"simulating {duration_text(seconds)}"):
        if components is not None:
            files = gmwm.simulate(truth, rate=rate, duration=seconds, rng=seed, components=True)
        imu = files.imu if files is not None else gmwm.simulate(truth, rate=rate, duration=seconds, rng=seed)
    with progress(f"writing {output.name}"):
        imu.write(output)
        return imu, () if components is None or files is None else tuple(files.write_components(components))


def _given_at(source: str, rate: float | None) -> Given:
    """Return the noise of --from, at 100 Hz if neither the file nor the user gives the sampling rate."""
    try:
        return read_given(source, rate)
    except OptionError as error:
        if error.argument != "rate" or rate is not None:
            raise
    return read_given(source, 100.0)
