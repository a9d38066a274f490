"""A command: the mean and the standard deviation of each axis."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from gmwm.options import ReadOptions

from gmwm.base.results import Plotted
from gmwm.cli.command import command
from gmwm.cli.options import ResultOption
from gmwm.cli.output import NewFile, Outcome, table_text
from gmwm.cli.read_options import Axes, File, chosen_axes, load

EXAMPLES = ("gmwm spread static.csv", "gmwm spread static.csv --axis gyro --digits 3 --plot spread.png")


@dataclass(frozen=True)
class Spread(Plotted):
    """Mean and standard deviation of each axis."""

    axes: Mapping[str, tuple[float, float]]


@command
def spread(
    file: File,
    reading: ReadOptions,
    axis: Axes = None,
    digits: Annotated[int, ResultOption(help="Significant digits.", min=1, max=17)] = 5,
    plot: Annotated[Path | None, ResultOption(help="Plot to this file.")] = None,
) -> Outcome:
    """Print the mean and the standard deviation of each axis."""
    signals = chosen_axes(load(file, reading), axis)
    result = Spread(
        {name: (float(signal.values.mean()), float(signal.values.std())) for name, signal in signals.items()}
    )
    rows = [[name, *(f"{value:.{digits}g}" for value in pair)] for name, pair in result.axes.items()]
    axes = {name: {"mean": mean, "sd": sd} for name, (mean, sd) in result.axes.items()}
    return Outcome(
        command="spread",
        document={"file": str(file), "axes": axes},
        text=table_text(["axis", "mean", "sd"], rows),
        files=() if plot is None else (NewFile(plot, lambda path: result.plot(path=path), "plotting"),),
    )
