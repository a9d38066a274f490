"""gmwm info: inspect a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import gmwm
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Dialect
from gmwm.cli.command import command
from gmwm.cli.measuring import memory_for, open_recording
from gmwm.cli.options import Chunked, Repeated, joined_against
from gmwm.cli.output import Outcome, plot_file, progress
from gmwm.measuring.inspection.result import text
from gmwm.measuring.regression.against import AUTO, TEMPERATURE, TIME, Against
from gmwm.recording.options import ReadOptions
from gmwm.recording.signals import Imu

if TYPE_CHECKING:
    from gmwm.fitting.inference import NoiseAgainst

EXAMPLES = (
    "gmwm info static.csv", "gmwm info log.txt --rate 100 --units gyro=deg/s,accel=g",
    "gmwm info static.csv --against warmup", "gmwm info static.csv --noise-against temperature",
    "gmwm info static.csv --plot recording.png",
)  # fmt: skip


@command
def info(
    file: Path,
    reading: ReadOptions,
    chunked: Chunked = "auto",
    against: list[str] | None = None,
    repeated: Repeated = "auto",
    noise_against: Literal["temperature", "time"] | None = None,
    plot: Path | None = None,
) -> Outcome:
    """Inspect a recording, and report whether it can be used for a calibration.

    The report covers the rate, duration, gaps and jitter of the time stamps, axes and units, faults of the logger such
    as repeated values, clipping, quantization, motion, knocks, jumps, warm-up, and whether an axis follows the
    temperature.

    Columns of the table: mean; sd, the standard deviation of all samples; noise, the standard deviation of
    the white noise, computed from differences of neighbouring samples so that offset and slow drift do not affect it;
    LSB, the quantization step if there is one; wander, the largest difference between the means of 64 equal windows.

    Result:
        noise_against: Test whether the noise of each axis depends on the temperature or on time, at each scale and for
            each term of the noise model.
        plot: Plot all axes over time, with the samples of each finding, to this .png, .pdf or .svg file."""
    terms = joined_against(against, AUTO)
    memory = "--plot" if plot is not None else "--noise-against" if noise_against is not None else memory_for(terms)
    recording = open_recording(file, reading, chunked, whole=memory)
    with progress("inspecting"):
        inspection = gmwm.inspect(recording, against=terms, repeated=repeated)
    changes = _noise_changes(recording, noise_against) if noise_against and isinstance(recording, Imu) else {}
    document = {"file": str(file), **inspection.to_dict()}
    if noise_against is not None:
        document["noise_against"] = {axis: change.to_dict() for axis, change in changes.items()}
    below = "".join(f"\n\n{change.summary()}" for change in changes.values())
    return Outcome(
        command="info", document=document, text=text(inspection, Dialect.SHELL) + below,
        all_text=text(inspection, Dialect.SHELL, every=True) + below,
        files=plot_file(plot, lambda path: recording.plot(units="auto", inspection=inspection, path=path))
        if isinstance(recording, Imu) else (),
    )  # fmt: skip


def _noise_changes(recording: Imu, condition: str) -> dict[str, NoiseAgainst]:
    """Test for each axis whether its noise depends on the temperature of the recording, or on time."""
    from gmwm.fitting.inference import noise_against

    if condition == TIME:
        covariates: Against = TIME
    elif recording.temperature is None:
        raise OptionError(
            "the recording has no temperature", argument="noise_against", got=condition,
            advice="Name its column with {--columns=temperature:…}, or use {--noise-against=time}.",
        )  # fmt: skip
    else:
        covariates = {TEMPERATURE: recording.temperature}
    with progress("noise against conditions"):
        return {axis: noise_against(signal, covariates) for axis, signal in recording.signals.items()}
