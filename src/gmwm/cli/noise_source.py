"""The noise of a sensor as the argument of a command: a calibration or fits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gmwm.errors import OptionError

if TYPE_CHECKING:
    from gmwm.estimation.result import Fit
    from gmwm.processes.model import Model

NoiseText = Annotated[
    str,
    typer.Argument(
        help="calibration.json of gmwm calibrate, fits.json of gmwm fit, or the folder of one of them.",
        metavar="SOURCE",
        show_default=False,
    ),
]


@dataclass(frozen=True, eq=False)
class NoiseSource:
    """The noise of each axis, and the sampling rate (Hz) of axes that have a model instead of a fit."""

    axes: Mapping[str, Fit | Model]
    rate: float | None = None


def noise_of(text: str, rate: float | None) -> NoiseSource:
    """Read the noise of a sensor.

    Raises
    ------
    OptionError
        If there is no such file.
    ReadError
        If the file has no fits.
    """
    from gmwm import Fit
    from gmwm.cli.plan import fits_in

    path = Path(text)
    if not path.exists():
        raise OptionError(argument="source", expected="an existing file or folder", got=text)
    _, fits = fits_in(path)
    return NoiseSource({axis: Fit.from_dict(content) for axis, content in fits.items()}, rate)
