"""What several commands share beside the recording: options of estimation and of the result, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import typer

from gmwm.cli.option_names import checked, prefixed
from gmwm.errors import OptionError
from gmwm.options import as_confidence
from gmwm.variance.biweight import biweight

if TYPE_CHECKING:
    from gmwm.processes.model import Model

RESULT = "Result"

Json = Annotated[
    bool,
    typer.Option(
        "--json",
        help="JSON on stdout and nothing else; warnings and progress on stderr.",
        rich_help_panel=RESULT,
    ),
]
AllRemarks = Annotated[
    bool,
    typer.Option("--all-remarks", help="Show all remarks instead of the gravest five.", rich_help_panel=RESULT),
]
View = Annotated[
    Literal["wavelet", "allan"],
    typer.Option(
        help="Wavelet variance over its scale, or Allan deviation over its averaging time.",
        rich_help_panel=RESULT,
    ),
]
Datasheet = Annotated[
    bool, typer.Option("--datasheet", help="deg/h and mg in place of rad/s and m/s².", rich_help_panel=RESULT)
]
Filter = Annotated[
    str,
    typer.Option(
        help="Wavelet filter: haar, d4 … d16, la8 … la20, fk4 … fk22, bl14, bl20, mb4 … mb24, or one of PyWavelets'.",
        rich_help_panel="Estimation",
    ),
]
TransformName = Annotated[
    Literal["modwt", "dwt"],
    typer.Option(
        "--transform",
        help="Maximal-overlap transform, or the decimated one, which scatters more.",
        rich_help_panel="Estimation",
    ),
]
Robust = Annotated[
    bool,
    typer.Option(
        "--robust", help="By the robust wavelet variance, which outliers do not reach.", rich_help_panel="Estimation"
    ),
]


Efficiency = Annotated[
    float | None,
    typer.Option(
        callback=checked(biweight),
        help="Of the robust wavelet variance under Gaussian noise, from 0.3 to 0.99: a low one stands outliers "
        "that are near, a high one more of those that are far. Default: 0.6.",
        rich_help_panel="Estimation",
        show_default=False,
    ),
]
Within = Annotated[
    str,
    typer.Option(
        help="The largest model; every part of it is compared. Held values are in all: WN(sigma2=fixed(1e-6)).",
        metavar="MODEL",
        rich_help_panel="Estimation",
    ),
]
ChoiceWeighting = Annotated[
    Literal["optimal", "diagonal"],
    typer.Option(
        "--weighting",
        help="Weigh the levels with all their covariances, or each by its own variance.",
        rich_help_panel="Estimation",
    ),
]
CriterionName = Annotated[
    Literal["asymptotic", "bootstrap"],
    typer.Option(
        "--criterion",
        help="The penalty of a model by theory, or from simulated records.",
        rich_help_panel="Estimation",
    ),
]


checked_confidence = checked(as_confidence)
Confidence = Annotated[
    float,
    typer.Option(
        callback=checked_confidence,
        help="Level of the intervals, and of what counts as equally good.",
        metavar="LEVEL",
        rich_help_panel="Estimation",
    ),
]
Seed = Annotated[
    int, typer.Option(help="Of the records that a choice is tested with.", min=0, rich_help_panel="Estimation")
]


def parse_within(text: str) -> Model:
    """The model of --within.

    >>> parse_within("GM + WN")
    Model('GM + WN')
    """
    from gmwm import Model

    with prefixed("within"):
        return Model.parse(text)


def chosen_efficiency(robust: bool, efficiency: float | None) -> float:
    """The efficiency of what --robust asks for; an error if it is given for nothing."""
    if efficiency is not None and not robust:
        raise OptionError("--efficiency belongs to the robust wavelet variance; pass --robust too, or leave it out")
    return 0.6 if efficiency is None else efficiency
