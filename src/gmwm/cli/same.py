"""gmwm same: test whether two or more recordings have the same noise."""

from __future__ import annotations

from pathlib import Path

import gmwm
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Dialect
from gmwm.cli.command import command
from gmwm.cli.output import Outcome, plot_file
from gmwm.cli.read_options import chosen_axes, load, names_of
from gmwm.recording.options import ReadOptions

EXAMPLES = (
    "gmwm same monday.csv tuesday.csv",
    "gmwm same monday.csv tuesday.csv --axis gyro --tolerance 0.1",
    'gmwm same monday.csv tuesday.csv --axis gyro_x --model "WN + RW"',
)


@command
def same(
    files: list[Path],
    reading: ReadOptions,
    axis: list[str] | None = None,
    model: str | None = None,
    tolerance: float = 0.0,
    size: float = 0.05,
    plot: Path | None = None,
) -> Outcome:
    """Test whether recordings have the same noise at each scale, or the same parameters of a model.

    The command compares the wavelet variances of two recordings. If there are more than two, it compares each recording
    with the mean of the others.

    Use it for recordings before and after a change of temperature, supply or mounting, or for two units of one type. To
    compare the numbers of two calibrations, use gmwm agree.

    Arguments:
        files (FILE FILE…): Two or more recordings of any supported format.
    Options:
        model (MODEL): Compare the parameters of this model, such as 'WN + RW', instead of the noise at each scale.
        tolerance: Largest |ln| of the ratio of two deviations that counts as equal: 0.1 allows 10 %.
        size: Significance level: probability of any false difference in all tests."""
    if len(files) < 2:
        raise OptionError(f"pass at least two recordings; got one, {files[0]}", argument="files", got=str(files[0]))
    recordings = [gmwm.Imu(chosen_axes(load(file, reading), axis)) for file in files]
    noise = gmwm.same(*recordings, labels=names_of(files), model=model, tolerance=tolerance, size=size)
    return Outcome(
        command="same", document={"files": list(map(str, files)), **noise.to_dict()}, text=noise.summary(Dialect.SHELL),
        files=plot_file(plot, lambda path: noise.plot(path=path)),
    )  # fmt: skip
