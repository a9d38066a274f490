"""gmwm fuse: combine the sensors of an array into one virtual sensor with the least noise."""

from __future__ import annotations

import math
from pathlib import Path

import gmwm
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Dialect
from gmwm.base.time_base import parse_length
from gmwm.cli.command import command
from gmwm.cli.measuring import tell_inspection
from gmwm.cli.output import NewFile, Outcome, plot_file, progress, text_file
from gmwm.cli.read_options import chosen_names
from gmwm.recording.options import ReadOptions
from gmwm.recording.signals import Imu

EXAMPLES = (
    "gmwm fuse array.csv --output virtual.csv --plot virtual.png",
    "gmwm fuse imu0.csv imu1.csv imu2.csv --horizon 10s --plot virtual.png",
    "gmwm fuse array.csv --horizon 1s-10min --json",
    "gmwm fuse static.csv --horizon 60s --apply drive.csv --output fused.csv",
)


@command
def fuse(
    files: list[Path],
    reading: ReadOptions,
    horizon: str | None = None,
    model: str | None = None,
    axis: list[str] | None = None,
    nonnegative: bool = False,
    apply: list[Path] | None = None,
    output: Path | None = None,
    csv: Path | None = None,
    plot: Path | None = None,
) -> Outcome:
    """Fuse the parallel axes of several units into one virtual sensor with less noise.

    By default, a Kalman filter on the differences between the units estimates their slow noise. With --horizon, the
    virtual sensor is the weighted sum of all units that has the least wavelet variance at this scale. Both methods use
    a recording at rest, account for noise that the units share, and do not distort a motion that all units measure.
    The units must be sampled at the same times, and their axes must be parallel.

    Arguments:
        files (FILE…): Recording at rest of all units: one file with columns such as gyro_x[0] and gyro_x[1] or with
            several topics, or a file for each unit.
    Options:
        horizon (LENGTH): Use constant weights that minimize the wavelet variance at this scale, such as 60s, 10min or a
            number of seconds; over a range of scales, such as 1s-10min; or for the slowest noise of a model, inf.
            Default: use a Kalman filter.
        model (MODEL): Joint model of the noise of all units, such as 'WN + shared(RW)'. Default for the Kalman filter:
            WN, RW and k GM processes, each shared(…), with the smallest k that fits the data.
        nonnegative: Allow no negative weights; these amplify errors of the scale factors.
    Result:
        apply (FILE): Apply the weights or the filter to this recording of the same array, for example one in motion.
            Repeat the option if there is a file for each unit.
        output: Write the fused recording to this .csv or .parquet file.
        csv: Write the predicted wavelet deviations to this CSV file."""
    scales = None if horizon is None else _scales(horizon)
    units = _load(files, reading, axis)
    tell_inspection(next(iter(units.values())))
    with progress("measuring"):
        virtual = gmwm.fuse(units, horizon=scales, model=model, nonnegative=nonnegative)
    new = [] if csv is None else [text_file(csv, virtual.to_polars().write_csv())]
    if apply and output is None:
        raise OptionError(argument="apply", expected="given with {--output}", got=[str(file) for file in apply])
    if output is not None:
        moving = _load(apply, reading, axis) if apply else units
        # Files of several units are in the same order, but their names differ.
        fused = virtual.apply(dict(zip(units, moving.values(), strict=False)) if apply and len(apply) > 1 else moving)
        new.append(NewFile(output, fused.write, "writing"))
    return Outcome(
        command="fuse", document={"files": list(map(str, files)), **virtual.to_dict()},
        text=virtual.summary(Dialect.SHELL), files=(*new, *plot_file(plot, lambda path: virtual.plot(path=path))),
    )  # fmt: skip


def _scales(text: str) -> float | tuple[float, float]:
    """Parse a scale, or a range of scales.

    >>> _scales("60s"), _scales("1s-10min"), _scales("inf")
    (60.0, (1.0, 600.0), inf)
    """
    low, dash, high = text.partition("-")
    if dash:
        return parse_length(low, "horizon"), parse_length(high, "horizon")
    return math.inf if text == "inf" else parse_length(text, "horizon")


def _load(files: list[Path], reading: ReadOptions, axis: list[str] | None) -> dict[str, Imu]:
    """Read the recordings of all units, with the chosen axes."""
    from gmwm.files.readers.api import read_units

    with progress(f"reading {files[0].name}"):
        units = read_units(files, reading)
    return {
        name: Imu({a: imu[a] for a in chosen_names(imu.axes, axis)}) for name, imu in units.items()
    }  # fmt: skip
