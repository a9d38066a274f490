"""gmwm consistency: test whether a filter claims the error that it makes on a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from gmwm.base.time_base import parse_length
from gmwm.cli.command import command
from gmwm.cli.measuring import tell_inspection
from gmwm.cli.model_source import calibration_in, noise_of
from gmwm.cli.output import Outcome, file_names, plot_file, progress
from gmwm.cli.read_options import chosen_names, load
from gmwm.recording.options import ReadOptions

EXAMPLES = (
    "gmwm consistency results night.csv --plot consistency.png",
    "gmwm consistency imu.yaml night.csv --rate 200",
    "gmwm consistency results night.csv --filter model --horizons 1s,1min",
)
FORMS: dict[str, Literal["N, K", "N, sigma, T", "model"]] = {"nk": "N, K", "markov": "N, sigma, T", "model": "model"}


@command
def consistency(
    source: str,
    file: Path,
    reading: ReadOptions,
    axis: list[str] | None = None,
    filter: Literal["nk", "markov", "model"] = "nk",
    horizons: str = "1s,10s,60s",
    level: float = 0.95,
    plot: Path | None = None,
) -> Outcome:
    """Test whether a filter with the calibrated noise claims the error that it makes on a recording at rest.

    The filter of each axis predicts the mean of the signal over the next 1, 10 and 60 s. The table compares the error
    that the filter claims with the error that it makes, and has the normalised innovation squared (NIS) of single
    samples. ✓ is a claim of 0.8 to 1.3 times the error, ✗ a claim outside, and ? a recording that is too short. Use a
    recording from which the noise was not calibrated.

    Arguments:
        source (SOURCE): The calibration.json of gmwm calibrate, the fits.json of gmwm fit, or the folder of one of
            them; or the numbers of a datasheet or a file of another program, as for gmwm export --from.
    Result:
        filter: nk: white noise N and a random walk K. markov: N and a Gauss-Markov bias with sigma and T. model: the
            state space of the whole model.
        horizons (LENGTHS): Horizons of the verdict, separated by commas.
        level: Confidence level of intervals and bands."""
    from gmwm.applications.monitor import consistency

    imu = load(file, reading)
    calibration = calibration_in(source)
    noise = noise_of(source, imu.rate).axes if calibration is None else calibration
    names = chosen_names([name for name in imu.axes if name in noise] or list(imu.axes), axis)
    tell_inspection(imu)
    times = [parse_length(text, "horizons") for text in horizons.split(",")]
    with progress("filtering"):
        result = consistency(noise, imu[names], filter=FORMS[filter], horizons=times, level=level)
    files = plot_file(plot, lambda path: result.plot(path=path))
    return Outcome(
        command="consistency",
        document={"source": source, "file": str(file), **result.to_dict(), "written": file_names(files)},
        text=result.summary(), files=files,
    )  # fmt: skip
