"""The noise of a sensor as an argument of a command: a calibration, fits, a datasheet or a file of another program."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gmwm.base.atomic_files import read_json
from gmwm.cli.options import named_as_options

if TYPE_CHECKING:
    from gmwm.calibration import Calibration
    from gmwm.files.importers import Given
    from gmwm.fitting.estimation.result import Fit
    from gmwm.theory.processes.model import Model

NoiseText = Annotated[
    str,
    typer.Argument(
        help="The calibration.json of gmwm calibrate, the fits.json of gmwm fit, or the folder of one of them; or the "
        "numbers of a datasheet or a file of another program, as for gmwm export --from.",
        metavar="SOURCE",
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
    ),
]


@dataclass(frozen=True, eq=False)
class NoiseSource:
    """The noise of each axis. `rate` is the sampling rate (Hz) of axes with a model, because only a fit has its own."""

    axes: Mapping[str, Fit | Model]
    rate: float | None = None


def read_given(text: str, rate: float | None, option: str = "--from") -> Given:
    """Read noise from a datasheet or a file of another program. Error messages name the shell option."""
    from gmwm.files.importers import given_noise

    with named_as_options({"source": option}):
        return given_noise(text, rate)


def calibration_in(text: str) -> Calibration | None:
    """Return the calibration in a file or folder; None if `text` is another source of noise."""
    from gmwm import Calibration
    from gmwm.cli.plan import fits_in

    path = Path(text)
    if path.is_dir():
        fits_in(path)  # Raises an error if the folder has both calibration.json and fits.json.
        path = path / "calibration.json"
    if path.suffix != ".json" or not path.is_file():
        return None
    try:
        content = read_json(path)
    except ValueError:
        return None  # `noise_of` reports the error.
    return Calibration.load(path) if isinstance(content, dict) and "settings" in content else None


def noise_of(text: str, rate: float | None, option: str = "SOURCE") -> NoiseSource:
    """Read the noise of a sensor from a calibration, from fits, or from a datasheet or file of another program."""
    from gmwm import Fit
    from gmwm.cli.plan import fits_in

    path = Path(text)
    if path.is_dir() or path.suffix == ".json":
        _, fits = fits_in(path)
        return NoiseSource({axis: Fit.from_dict(content) for axis, content in fits.items()}, rate)
    noise = read_given(text, rate, option)
    return NoiseSource(noise.models, noise.rate)
