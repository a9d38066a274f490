"""The noise of a sensor as an argument of a command: a calibration, fits, or noise without a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gmwm._files import read_json
from gmwm.cli.option_names import named_as_options

if TYPE_CHECKING:
    from gmwm.calibration import Calibration
    from gmwm.estimation.result import Fit
    from gmwm.importers import Given
    from gmwm.processes.model import Model

NoiseText = Annotated[
    str,
    typer.Argument(
        help="calibration.json of gmwm calibrate, fits.json of gmwm fit, or the folder of one of them; or a source "
        "without a recording, as for gmwm export --from.",
        metavar="SOURCE",
        show_default=False,
    ),
]
GivenText = Annotated[
    str | None,
    typer.Option(
        "--from",
        help="Noise without a recording: the numbers of a datasheet, such as 'gyro: N=0.15deg/√h, B=3deg/h over 100s; "
        "accel: N=60µg/√Hz, B=0.02mg', or a file of Kalibr, allan_variance_ros, imu_utils, OpenVINS, Kimera, VINS, "
        "ORB-SLAM3, LIO-SAM, FAST-LIO, KF-GINS, PX4, ArduPilot or MATLAB.",
        metavar="SOURCE",
        show_default=False,
    ),
]


@dataclass(frozen=True, eq=False)
class NoiseSource:
    """The noise of each axis, and the sampling rate (Hz) of axes that have a model instead of a fit."""

    axes: Mapping[str, Fit | Model]
    rate: float | None = None


def given(text: str, rate: float | None, option: str = "--from") -> Given:
    """Read noise without a recording; errors name the option."""
    from gmwm.importers import given_noise

    with named_as_options({"source": option}):
        return given_noise(text, rate)


def calibration_in(text: str) -> Calibration | None:
    """Read the calibration in a file or folder; None if the text is another source of noise."""
    from gmwm import Calibration
    from gmwm.cli.plan import fits_in

    path = Path(text)
    if path.is_dir():
        fits_in(path)  # Refuses a folder with a calibration and other fits.
        path = path / "calibration.json"
    if path.suffix != ".json" or not path.is_file():
        return None
    try:
        content = read_json(path)
    except ValueError:
        return None  # noise_of names the error.
    return Calibration.load(path) if isinstance(content, dict) and "settings" in content else None


def noise_of(text: str, rate: float | None, option: str = "SOURCE") -> NoiseSource:
    """Read the noise of a sensor: a calibration, fits, or noise without a recording.

    Raises
    ------
    OptionError
        If the source is none of them.
    ReadError
        If the file has no fits, and no numbers of another program.
    """
    from gmwm import Fit
    from gmwm.cli.plan import fits_in

    path = Path(text)
    if path.is_dir() or path.suffix == ".json":
        _, fits = fits_in(path)
        return NoiseSource({axis: Fit.from_dict(content) for axis, content in fits.items()}, rate)
    found = given(text, rate, option)
    return NoiseSource(found.models, found.rate)
