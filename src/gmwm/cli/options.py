"""Options for the estimation and for the output that several commands share."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from gmwm.base.axis_names import AXES
from gmwm.base.errors import OptionError
from gmwm.base.units import SI_UNIT
from gmwm.cli.option_names import checked, prefixed
from gmwm.measuring.regression.against import Asked
from gmwm.measuring.variance.biweight import EFFICIENCY, biweight
from gmwm.recording.options import as_confidence

if TYPE_CHECKING:
    from gmwm.theory.processes.model import Model, ModelLike

RESULT = "Result"
_PLACE = re.compile(r"\s*(\w+)\s*=(.*)", re.DOTALL)

Json = Annotated[
    bool,
    typer.Option(
        "--json",
        help="Print only JSON on stdout; warnings and progress go to stderr.",
        rich_help_panel=RESULT,
    ),
]
AllRemarks = Annotated[
    bool,
    typer.Option("--all-remarks", help="Show all remarks instead of the five most severe.", rich_help_panel=RESULT),
]
View = Annotated[
    Literal["wavelet", "allan"],
    typer.Option(
        help="Show the wavelet variance over the scale, or the Allan deviation over the averaging time.",
        rich_help_panel=RESULT,
    ),
]
Datasheet = Annotated[
    bool, typer.Option("--datasheet", help="Use deg/h and mg instead of rad/s and m/s².", rich_help_panel=RESULT)
]
Filter = Annotated[
    str,
    typer.Option(
        help="Wavelet filter: haar, d4 … d16, la8 … la20, fk4 … fk22, bl14, bl20, mb4 … mb24, or a name of PyWavelets.",
        rich_help_panel="Estimation",
    ),
]
TransformName = Annotated[
    Literal["modwt", "dwt"],
    typer.Option(
        "--transform",
        help="Use the maximal-overlap transform (modwt), or the decimated transform (dwt), whose estimates have a "
        "larger variance.",
        rich_help_panel="Estimation",
    ),
]
Robust = Annotated[
    bool,
    typer.Option(
        "--robust",
        help="Use the robust wavelet variance, which is insensitive to outliers.",
        rich_help_panel="Estimation",
    ),
]


checked_against = checked(Asked.of)
Efficiency = Annotated[
    float | None,
    typer.Option(
        callback=checked(biweight),
        help="Efficiency of the robust wavelet variance for Gaussian noise, 0.3 to 0.99. Lower values suppress "
        "outliers close to the noise; higher values tolerate more distant outliers. Default: 0.6.",
        rich_help_panel="Estimation",
    ),
]
Within = Annotated[
    str,
    typer.Option(
        help="Largest model; all models that are part of it are compared. A term with a fixed value, such as "
        "WN(sigma2=fixed(1e-6)), is in all of them.",
        metavar="MODEL",
        rich_help_panel="Estimation",
    ),
]
Searched = Annotated[
    str,
    typer.Option(
        "--within",
        help="Largest model; all models that are part of it are compared. auto: search for the model with the "
        "wavelet variance and the spectrum.",
        metavar="MODEL",
        rich_help_panel="Estimation",
    ),
]
AgainstOption = Annotated[
    str,
    typer.Option(
        "--against",
        callback=checked_against,
        help="Remove the effect of covariates from each axis before its noise is estimated. auto: remove the effect of "
        "the temperature from axes that follow it (5 % level). none: remove nothing. Otherwise: temperature, time or "
        "warmup, or several joined by +, with options such as temperature:2,lag (degree 2, and its rate of change), "
        "temperature:knots=2 or time:3.",
        metavar="COVARIATES",
        rich_help_panel="Estimation",
    ),
]
ChoiceWeighting = Annotated[
    Literal["optimal", "diagonal"],
    typer.Option(
        "--weighting",
        help="Weight the levels in the fit by the inverse of their covariance matrix (optimal) or of their variances "
        "(diagonal).",
        rich_help_panel="Estimation",
    ),
]
CriterionName = Annotated[
    Literal["asymptotic", "bootstrap"],
    typer.Option(
        "--criterion",
        help="Compute the penalty of a model, for the comparison of models, from theory (asymptotic) or from simulated "
        "records (bootstrap).",
        rich_help_panel="Estimation",
    ),
]


checked_confidence = checked(as_confidence)
Confidence = Annotated[
    float,
    typer.Option(
        callback=checked_confidence,
        help="Confidence level of the intervals, and of the comparison of models.",
        metavar="LEVEL",
        rich_help_panel="Estimation",
    ),
]
Seed = Annotated[int, typer.Option(help="Seed of the simulated records.", min=0, rich_help_panel="Estimation")]


def parse_within(text: str) -> Model:
    """Parse the value of --within to a model.

    >>> parse_within("GM + WN")
    Model('GM + WN')
    """
    from gmwm import Model

    with prefixed("within"):
        return Model.parse(text)


def parse_searched(text: str) -> Model | str:
    """Parse the value of --within in commands that also accept "auto".

    >>> parse_searched("auto"), parse_searched("GM + WN")
    ('auto', Model('GM + WN'))
    """
    from gmwm.calibration.options import SEARCHED

    return text if text == SEARCHED else parse_within(text)


def chosen_efficiency(robust: bool, efficiency: float | None) -> float:
    """Return the efficiency of the robust wavelet variance, 0.6 by default.

    Raises
    ------
    OptionError
        If --efficiency is given without --robust.
    """
    if efficiency is not None and not robust:
        raise OptionError(
            "--efficiency applies only to the robust wavelet variance",
            argument="efficiency",
            got=efficiency,
            advice="Add {--robust}, or leave {--efficiency} out.",
        )
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
