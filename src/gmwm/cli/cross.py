"""gmwm cross: test whether the axes of a recording share noise."""

from __future__ import annotations

from pathlib import Path

import gmwm
from gmwm.base.remarks import Dialect
from gmwm.cli.command import command
from gmwm.cli.measuring import open_recording, tell_inspection
from gmwm.cli.options import Chunked
from gmwm.cli.output import Outcome, plot_file, progress, text_file
from gmwm.cli.read_options import chosen_names
from gmwm.recording.options import ReadOptions

EXAMPLES = ("gmwm cross static.csv --axis gyro --plot cross.png", "gmwm cross static.csv --robust --csv cross.csv")


@command
def cross(
    file: Path,
    reading: ReadOptions,
    axis: list[str] | None = None,
    robust: bool = False,
    efficiency: float | None = None,
    chunked: Chunked = "auto",
    size: float = 0.05,
    csv: Path | None = None,
    plot: Path | None = None,
) -> Outcome:
    """Test whether the axes of a recording share noise, at which scales, and how much.

    For each pair of axes and each scale, the command estimates the correlation of the wavelet coefficients, with a
    confidence interval and a test. Axes can share noise through the supply voltage, the temperature or vibrations of
    the table. A filter that treats such axes as independent underestimates its errors, and averaging them reduces the
    noise less.

    Estimation:
        robust: Use robust estimates, which are insensitive to knocks.
        size: Significance level: probability of any false detection in all tests together.
    Result:
        csv: Write the correlations of all pairs and scales to this CSV file."""
    recording = open_recording(file, reading, chunked)
    axes = chosen_names(recording.axes, axis)
    with progress("measuring"):
        result = gmwm.cross(
            recording, axes=axes, robust=robust, efficiency=0.6 if efficiency is None else efficiency, size=size
        )
    tell_inspection(recording)
    files = () if csv is None else (text_file(csv, result.to_polars().write_csv()),)
    return Outcome(
        command="cross", document={"file": str(file), **result.to_dict()}, text=result.summary(Dialect.SHELL),
        files=files + plot_file(plot, lambda path: result.plot(path=path)),
    )  # fmt: skip
