"""Options for the estimation and for the output that several commands share, and their names in error messages."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeVar

import typer

from gmwm.base.errors import GmwmError, ModelError, OptionError
from gmwm.base.units import AXES, SI_UNIT
from gmwm.measuring.regression.against import Asked
from gmwm.measuring.variance.biweight import EFFICIENCY, biweight
from gmwm.recording.options import as_confidence

if TYPE_CHECKING:
    from gmwm.showing.plots.labels import UnitSystem
    from gmwm.theory.processes.model import Model, ModelLike

T = TypeVar("T")


@contextmanager
def named_as_options(options: Mapping[str, str]) -> Iterator[None]:
    """Make errors in the block name shell options, by arguments whose option has another name.

    >>> from gmwm.base.template import Dialect
    >>> from gmwm.errors import OptionError
    >>> try:
    ...     with named_as_options({"format": "--to"}):
    ...         raise OptionError(argument="format", expected="one of imu:IMAR", got="x")
    ... except OptionError as error:
    ...     print(error.text(Dialect.SHELL))
    --to must be one of imu:IMAR; got 'x'
    """
    try:
        yield
    except GmwmError as error:
        error.options = options
        raise


def checker(check: Callable[[T], object]) -> Callable[[T | None], T | None]:
    """Return a Typer callback that checks the value of an option with a function of the library."""

    def callback(given: T | None) -> T | None:
        if given is not None:
            check(given)
        return given

    return callback


@contextmanager
def prefix_errors(argument: str) -> Iterator[None]:
    """Put the name of an argument in front of the message of each ModelError that is raised in the block."""
    try:
        yield
    except ModelError as error:
        error.prefix = argument
        raise


ResultOption = partial(typer.Option, rich_help_panel="Result")
EstimationOption = partial(typer.Option, rich_help_panel="Estimation")
InputOption = partial(typer.Option, rich_help_panel="Input")
ParallelOption = partial(typer.Option, rich_help_panel="Parallel work")
_PLACE = re.compile(r"\s*(\w+)\s*=(.*)", re.DOTALL)

Json = Annotated[bool, ResultOption("--json", help="Print only JSON on stdout; warnings and progress go to stderr.")]
AllRemarks = Annotated[bool, ResultOption("--all-remarks", help="Show all remarks instead of the five most severe.")]
View = Annotated[
    Literal["wavelet", "allan"] | None,
    ResultOption(
        help="Show the wavelet variance over the scale, or the Allan deviation over the averaging time. By default, "
        "pictures show the Allan deviation, and tables the wavelet variance."
    ),
]
Datasheet = Annotated[bool, ResultOption("--datasheet", help="Use deg/h and mg instead of rad/s and m/s².")]
Units = Annotated[
    bool | None,
    ResultOption(
        "--datasheet/--si",
        help="Use deg/h and mg, or rad/s and m/s². By default, pictures of the Allan deviation have deg/h and mg, and "
        "everything else has rad/s and m/s².",
    ),
]
Filter = Annotated[
    str,
    EstimationOption(
        help="Wavelet filter: haar, d4 … d16, la8 … la20, fk4 … fk22, bl14, bl20, mb4 … mb24, or a name of PyWavelets."
    ),
]
TransformName = Annotated[
    Literal["modwt", "dwt"],
    EstimationOption(
        "--transform",
        help="Use the maximal-overlap transform (modwt), or the decimated transform (dwt), whose estimates have a "
        "larger variance.",
    ),
]
Plot = Annotated[Path | None, ResultOption(help="Plot to this .png, .pdf or .svg file.")]
Robust = Annotated[
    bool, EstimationOption("--robust", help="Use the robust wavelet variance, which is insensitive to outliers.")
]


def joined_against(parts: Sequence[str] | None, default: str) -> str:
    """Return the values of all options --against as one text."""
    text = " + ".join(parts) if parts else default
    Asked.of(text)
    return text


Efficiency = Annotated[
    float | None,
    EstimationOption(
        callback=checker(biweight),
        help="Efficiency of the robust wavelet variance for Gaussian noise, 0.3 to 0.99. Lower values suppress "
        "outliers close to the noise; higher values tolerate more distant outliers. Default: 0.6.",
    ),
]
Within = Annotated[
    str,
    EstimationOption(
        help="Largest model; all models that are part of it are compared. A term with a fixed value, such as "
        "WN(sigma2=fixed(1e-6)), is in all of them.",
        metavar="MODEL",
    ),
]
Searched = Annotated[
    str,
    EstimationOption(
        "--within",
        help="Largest model; all models that are part of it are compared. auto: search for the model with the "
        "wavelet variance and the spectrum.",
        metavar="MODEL",
    ),
]
AgainstOption = Annotated[
    list[str] | None,
    EstimationOption(
        "--against",
        help="Remove the effect of covariates from each axis before its noise is estimated. auto: remove the effect of "
        "the temperature from axes that follow it (5 % level). none: remove nothing. Otherwise: temperature, time or "
        "warmup with options such as temperature:2,lag (degree 2, and its rate of change), temperature:knots=2 or "
        "time:3; season:1y for a cycle with this period; step:2019-03-01 or step:2000d for a step at a date (UTC) or a "
        "time after the first sample. For several, repeat the option, or join them by +. The "
        "recording has one offset; +offsets gives every part between gaps its own.",
        metavar="COVARIATES",
    ),
]
RepeatedOption = Annotated[
    Literal["auto", "keep"],
    InputOption(
        help="auto: undo faults of the logger. Repeated, frozen and interpolated values are left out, and values that "
        "wrapped around are moved back. keep: use all values as they are."
    ),
]
ChoiceWeighting = Annotated[
    Literal["optimal", "diagonal"],
    EstimationOption(
        "--weighting",
        help="Weight the levels in the fit by the inverse of their covariance matrix (optimal) or of their variances "
        "(diagonal).",
    ),
]
CriterionName = Annotated[
    Literal["asymptotic", "bootstrap"],
    EstimationOption(
        "--criterion",
        help="Compute the penalty of a model, for the comparison of models, from theory (asymptotic) or from simulated "
        "records (bootstrap).",
    ),
]


checked_confidence = checker(as_confidence)
Confidence = Annotated[
    float,
    EstimationOption(
        callback=checked_confidence,
        help="Confidence level of the intervals, and of the comparison of models.",
        metavar="LEVEL",
    ),
]
Seed = Annotated[int, EstimationOption(help="Seed of the simulated records.", min=0)]


def unit_system(datasheet: bool | None) -> Literal["si", "datasheet"]:
    """Return the units of tables that --datasheet selects."""
    return "datasheet" if datasheet else "si"


def picture_units(datasheet: bool | None) -> UnitSystem:
    """Return the units of pictures that --datasheet and --si select."""
    return "auto" if datasheet is None else unit_system(datasheet)


def parse_within(text: str) -> Model:
    """Parse the value of --within to a model.

    >>> parse_within("GM + WN")
    Model('GM + WN')
    """
    from gmwm import Model

    with prefix_errors("within"):
        return Model.parse(text)


def parse_searched(text: str) -> Model | str:
    """Parse the value of --within in commands that also accept "auto".

    >>> parse_searched("auto"), parse_searched("GM + WN")
    ('auto', Model('GM + WN'))
    """
    from gmwm.calibration.options import SEARCHED

    return text if text == SEARCHED else parse_within(text)


def chosen_efficiency(robust: bool, efficiency: float | None) -> float:
    """Return the efficiency of the robust wavelet variance, 0.6 by default."""
    if efficiency is not None and not robust:
        raise OptionError(
            "--efficiency applies only to the robust wavelet variance", argument="efficiency", got=efficiency,
            advice="Add {--robust}, or leave {--efficiency} out.",
        )  # fmt: skip
    return EFFICIENCY if efficiency is None else efficiency


def parse_models(texts: Sequence[str]) -> dict[str, ModelLike] | str:
    """Parse the values of --model, and return the models by axis or sensor, or one model for all axes.

    >>> parse_models(["gyro=WN(sigma2=4e-8)", "accel_z=QN(q2=1e-6)"])
    {'gyro': 'WN(sigma2=4e-8)', 'accel_z': 'QN(q2=1e-6)'}
    >>> parse_models(["WN(sigma2=4e-8)"])
    'WN(sigma2=4e-8)'
    """
    matches = [_PLACE.fullmatch(text) for text in texts]
    if len(texts) == 1 and matches[0] is None:
        return texts[0]
    models: dict[str, ModelLike] = {}
    for text, match in zip(texts, matches, strict=True):
        if match is None:
            raise OptionError(argument="model", expected=f"AXIS=MODEL, such as gyro='{text}', if repeated", got=text)
        if match[1] not in (*SI_UNIT, *AXES):
            expected = f"[AXIS=]MODEL with an axis of {', '.join((*SI_UNIT, *AXES))}"
            raise OptionError(argument="model", expected=expected, got=match[1])
        if match[1] in models:
            raise OptionError(
                f"{match[1]} has two models", argument="model", got=match[1], advice="Write its processes as one sum."
            )
        models[match[1]] = match[2].strip()
    return models
