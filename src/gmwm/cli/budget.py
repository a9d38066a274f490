"""gmwm budget: the errors of unaided inertial navigation that the noise of a sensor causes."""

from __future__ import annotations

from pathlib import Path

import typer

from gmwm.applications.navigation import LATITUDE, Budget
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Dialect
from gmwm.base.time_base import parse_length
from gmwm.cli.command import command
from gmwm.cli.model_source import calibration_in, noise_of
from gmwm.cli.output import Outcome, file_names, plot_file

EXAMPLES = (
    "gmwm budget results/calibration.json --duration 60s",
    "gmwm budget results/calibration.json --duration 10min --plot budget.png",
    "gmwm budget results --duration 60s --against old/calibration.json",
)
_DURATION = typer.Option(
    help="Time of navigation without corrections, such as 60s, 10min, 1h or a number of seconds.", metavar="LENGTH"
)


@command
def budget(
    source: str,
    duration: str,
    rest: str = "60s",
    latitude: float = LATITUDE,
    rate: float | None = None,
    level: float = 0.95,
    against: str | None = None,
    plot: Path | None = None,
) -> Outcome:
    """Compute how attitude, velocity and position errors of unaided inertial navigation grow.

    The errors follow from the noise models: the noise of the gyroscopes is integrated to attitude errors, which tilt
    gravity; the acceleration errors are integrated to velocity and position errors. The table has the contribution of
    each noise process, a confidence interval from the uncertainty of the calibration, and the errors of a static
    alignment and of gyro-compassing for several averaging times. Errors from constant biases, scale factors and motion
    are not included.

    Arguments:
        source (SOURCE): The calibration.json of gmwm calibrate, the fits.json of gmwm fit, or the folder of one of
            them; or the numbers of a datasheet or a file of another program, as for gmwm export --from.
    Options:
        duration (LENGTH): Time of navigation without corrections, such as 60s, 10min, 1h or a number of seconds.
        rest (LENGTH): Time at rest before navigation starts. The initial biases and the level are those that a filter
            with N and K knows after this time. With 0s, they are known exactly.
        latitude: Latitude (deg).
        rate: Sampling rate (Hz), if SOURCE is a datasheet or a file that does not state it.
        level: Confidence level of the intervals.
        against (SOURCE): Also compute the budget of this calibration, file or datasheet, and compare both budgets."""
    seconds, before = parse_length(duration), parse_length(rest, "rest")

    def budget_of(text: str, option: str = "SOURCE") -> Budget:
        from gmwm.applications.navigation import budget as budgeted

        if (calibration := calibration_in(text)) is not None:
            return calibration.budget(seconds, rest=before, latitude=latitude, level=level)
        noise = noise_of(text, rate, option)
        return budgeted(noise.axes, seconds, rate=noise.rate, rest=before, latitude=latitude, level=level)

    errors = budget_of(source)
    document = {"source": source, **errors.to_dict()}
    text = errors.summary(Dialect.SHELL)
    if against is not None:
        if against == source:
            raise OptionError(argument="against", expected="another source", got=against)
        other = budget_of(against, "--against")
        document["against"] = {"source": against, **other.to_dict()}
        text += "\n\n" + errors.compare(other, (short(source), short(against)))
    files = plot_file(plot, lambda path: errors.plot(path=path))
    return Outcome(
        command="budget", document={**document, "written": file_names(files)}, text=text, files=files,
        in_text=errors.remarks,
    )  # fmt: skip


def short(source: str) -> str:
    """Return a short name of a source for a table: its folder or file name, or the first number of a datasheet.

    >>> short("monday/calibration.json"), short("gyro: N=0.15deg/√h, B=3deg/h over 100s")
    ('monday', 'gyro: N=0.15deg/√h…')
    """
    path = Path(source)
    if path.name == "calibration.json":
        return path.parent.name or path.name
    if ":" not in source and "=" not in source:
        return path.stem
    first = source.partition(",")[0]
    return first if first == source else f"{first}…"
