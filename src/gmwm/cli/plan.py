"""gmwm plan: how long a recording must be for each parameter of a model."""

from __future__ import annotations

import json as json_module
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from gmwm.cli.options import RESULT, Json
from gmwm.errors import OptionError, ReadError

if TYPE_CHECKING:
    from gmwm.inference.plan import Plan

EXAMPLES = (
    "gmwm plan 'GM(beta=0.1, sigma2=1e-8) + WN(sigma2=4e-6)' --rate 100 --duration 2h",
    "gmwm plan --from-fits results/fits.json --axis gyro_x --duration 1d --accuracy 0.05 --plot plan.png",
)
_SECONDS = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}
_LENGTH = re.compile(r"\s*([0-9]+(?:\.[0-9]*)?(?:e[+-]?[0-9]+)?|\.[0-9]+)\s*(s|min|h|d|)\s*", re.IGNORECASE)


def plan(
    duration: Annotated[
        str,
        typer.Option(
            help="Length of the recording that is planned: 90s, 30min, 2h, 1d, or a number of seconds.",
            metavar="LENGTH",
            show_default=False,
        ),
    ],
    model: Annotated[
        str | None,
        typer.Argument(
            help="A model with all its values (SI units and per sample, GM.beta in 1/s); fixed(…) is taken as known.",
            metavar="MODEL",
            show_default=False,
        ),
    ] = None,
    from_fits: Annotated[
        Path | None,
        typer.Option(
            help="In place of MODEL: the fits.json that gmwm fit wrote for a pilot recording.", show_default=False
        ),
    ] = None,
    axis: Annotated[str | None, typer.Option(help="Which axis of fits.json.", show_default=False)] = None,
    rate: Annotated[
        float | None, typer.Option(help="Samples per second (Hz). fits.json has its own.", show_default=False)
    ] = None,
    accuracy: Annotated[
        float, typer.Option(help="Relative standard error that is wanted: 0.1 is 10 %, 0.5 the most.")
    ] = 0.1,
    weighting: Annotated[
        Literal["diagonal", "optimal"],
        typer.Option(help="Of the fit to come: each level by its own variance, or by all their covariances."),
    ] = "diagonal",
    plot: Annotated[
        Path | None, typer.Option(help="Draw to this .png, .pdf or .svg file.", rich_help_panel=RESULT)
    ] = None,
    json: Json = False,
) -> None:
    """Say how long to record: the error of each parameter by the length of the recording.

    Standard errors are those of a fit that is still to come, relative to the values, from the exact covariance of
    the wavelet variance under the model; nothing is simulated. Take the values from a pilot recording (gmwm fit
    --output) or a datasheet. A parameter with more than 50 % is not to be seen.
    """
    from gmwm.cli.output import print_json, print_written, progress, tell, told_warnings

    with told_warnings() as told:
        source: dict[str, Any] = {}
        if (model is None) == (from_fits is None):
            raise OptionError("give a model with its values, or --from-fits with a fits.json, one of them")
        seconds = parse_length(duration)
        unit = ""
        if from_fits is not None:
            axis, found = pilot(from_fits, axis)
            source = {"file": str(from_fits), "axis": axis}
            model, zero = _without_zeros(found["model"])
            if zero:
                tell(told, f"left out, as the pilot recording does not show it: {', '.join(zero)}")
            for term, other in found["acts_as"].items():
                tell(told, f"{term} acts as {other} in the pilot recording: its values, and their errors, mean nothing")
            unit, pilot_rate = found["wavelet_variance"]["unit"], found["wavelet_variance"]["rate"]
            if rate is not None and abs(rate / pilot_rate - 1) > 1e-3:
                raise OptionError(
                    f"--rate {rate:g} is not the {pilot_rate:g} Hz of {from_fits}, whose values are per sample; "
                    "leave --rate out"
                )
            rate = pilot_rate
        elif axis is not None:
            raise OptionError("--axis belongs to --from-fits; leave it out, or pass the fits.json too")
        made, needed = _planned(str(model), seconds, rate, accuracy, weighting, unit)
        if plot is not None:
            with progress("drawing"):
                made.plot(accuracy=accuracy, path=plot)
        if json:
            for note in made.notes():
                tell(told, note)
            print_json("plan", {**source, **made.to_dict(), "accuracy": accuracy, "needed": needed}, told)
            return
        print(made.summary(accuracy))
        print_written([plot] if plot is not None else [])


def _planned(
    model: str,
    seconds: float,
    rate: float | None,
    accuracy: float,
    weighting: Literal["diagonal", "optimal"],
    unit: str,
) -> tuple[Plan, dict[str, float]]:
    from gmwm import plan as planned
    from gmwm._arrays import as_rate
    from gmwm.cli.output import progress
    from gmwm.inference.plan import as_accuracy

    as_accuracy(accuracy)
    with progress("planning"):
        made = planned(model, seconds, as_rate(rate), weighting=weighting, unit=unit)
        return made, made.needed(accuracy)


def parse_length(text: str) -> float:
    """A length of time in seconds.

    >>> parse_length("90"), parse_length("30min"), parse_length("2 h"), parse_length("1.5d")
    (90.0, 1800.0, 7200.0, 129600.0)
    """
    match = _LENGTH.fullmatch(text)
    if match is None:
        raise OptionError(f"--duration takes a length as 90s, 30min, 2h or 1d, got {text!r}")
    return float(match[1]) * _SECONDS[match[2].lower()]


def pilot(path: Path, axis: str | None) -> tuple[str, dict[str, Any]]:
    """The name of an axis and its fit, from what `gmwm fit --output` wrote."""
    try:
        content = json_module.loads(path.read_text(encoding="utf-8"))
        fits = content["axes"] if content["command"] == "fit" else {}
    except (ValueError, KeyError, TypeError) as error:
        raise ReadError(f"{path} is not a fits.json of gmwm fit ({type(error).__name__}: {error})") from error
    if not fits:
        raise ReadError(f"{path} is not a fits.json of gmwm fit: it holds no fit")
    name = axis if axis is not None or len(fits) > 1 else next(iter(fits))
    if name not in fits:
        raise OptionError(f"--axis must be one of {', '.join(fits)}, which {path} holds; got {axis or 'none'}")
    return str(name), fits[name]


def _without_zeros(text: str) -> tuple[str, list[str]]:
    """The model without the terms that were estimated as zero, and their names."""
    from gmwm import Model, parse_model

    model = parse_model(text)
    shown = tuple(process for process in model.processes if process.scale > 0)
    zero = [term for term, process in zip(model.terms, model.processes, strict=True) if process.scale == 0]
    return (str(Model(shown)) if shown else text), zero
