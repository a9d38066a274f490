"""A command: the mean and the standard deviation of each axis."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from gmwm.options import ReadOptions

from gmwm.base.results import Plotted
from gmwm.cli.command import command
from gmwm.cli.output import NewFile, Outcome, table_text
from gmwm.cli.read_options import chosen_axes, load

EXAMPLES = ("gmwm spread static.csv", "gmwm spread static.csv --axis gyro --digits 3 --plot spread.png")


@dataclass(frozen=True)
class Spread(Plotted):
    """Mean and standard deviation of each axis."""

    axes: Mapping[str, tuple[float, float]]


@command
def spread(
    file: Path, reading: ReadOptions, axis: list[str] | None = None, digits: int = 5, plot: Path | None = None
) -> Outcome:
    """Print the mean and the standard deviation of each axis.

    Result:
        digits (1 … 17): Significant digits.
        plot: Plot to this file.
    """
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
