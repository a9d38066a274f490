"""gmwm cross: test whether the axes of a recording share noise."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gmwm.base.remarks import Dialect
from gmwm.cli.command import command
from gmwm.cli.measuring import Chunked, opened, tell_inspection
from gmwm.cli.options import Efficiency, EstimationOption, Plot, ResultOption
from gmwm.cli.output import NewFile, Outcome, progress, text_file
from gmwm.cli.read_options import Axes, File, chosen_names
from gmwm.recording.options import ReadOptions

if TYPE_CHECKING:
    from gmwm.applications.several import CrossCovariance

EXAMPLES = ("gmwm cross static.csv --axis gyro --plot cross.png", "gmwm cross static.csv --robust --csv cross.csv")


@command
def cross(
    file: File,
    reading: ReadOptions,
    axis: Axes = None,
    robust: Annotated[
        bool, EstimationOption("--robust", help="Use robust estimates, which are insensitive to knocks.")
    ] = False,
    efficiency: Efficiency = None,
    chunked: Chunked = "auto",
    size: Annotated[
        float, EstimationOption(help="Significance level: probability of any false detection in all tests together.")
    ] = 0.05,
    csv: Annotated[
        Path | None, ResultOption(help="Write the correlations of all pairs and scales to this CSV file.")
    ] = None,
    plot: Plot = None,
) -> Outcome:
    """Test whether the axes of a recording share noise, at which scales, and how much.

    For each pair of axes and each scale, the command estimates the correlation of the wavelet coefficients, with a
    confidence interval and a test. Axes can share noise through the supply voltage, the temperature or vibrations of
    the table. A filter that treats such axes as independent underestimates its errors, and averaging them reduces the
    noise less.
    """
    from gmwm.applications.several import cross

    recording = opened(file, reading, chunked)
    axes = chosen_names(recording.axes, axis)
    with progress("measuring"):
        result = cross(
            recording, axes=axes, robust=robust, efficiency=0.6 if efficiency is None else efficiency, size=size
        )
    tell_inspection(recording)
    files = [] if csv is None else [text_file(csv, _csv_text(result))]
    if plot is not None:
        files.append(NewFile(plot, partial(_draw, result), "plotting"))
    return Outcome(
        command="cross",
        document={"file": str(file), **result.to_dict()},
        text=result.summary(Dialect.SHELL),
        files=tuple(files),
    )


def _draw(found: CrossCovariance, path: Path) -> None:
    found.plot(path=path)


def _csv_text(found: CrossCovariance) -> str:
    """Format the correlations as CSV, with one line for each pair of axes and scale."""
    return found.to_frame().write_csv()
