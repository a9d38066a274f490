"""gmwm plan: how long a recording must be for each parameter of a model."""

from __future__ import annotations

import json as json_module
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from gmwm.cli.command import command
from gmwm.cli.durations import parse_length, parse_share
from gmwm.cli.options import RESULT
from gmwm.cli.output import NewFile, Outcome, progress, tell
from gmwm.errors import OptionError, ReadError
from gmwm.remarks import Remark

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gmwm._arrays import Matrix
    from gmwm.filters import WaveletFilter
    from gmwm.inference.planning import Plan
    from gmwm.processes.base import Process

EXAMPLES = (
    "gmwm plan 'GM(beta=1, sigma2=1e-8) + WN(sigma2=4e-6)' --rate 100 --duration 2h",
    "gmwm plan --from-fits fits.json --axis gyro_x --duration 1d --accuracy 5%",
)


@command
def plan(
    duration: Annotated[
        str,
        typer.Option(
            help="Length of the recording that is planned: 90s, 30min, 1h30m, 2h, 1d, or a number of seconds.",
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
            help="In place of MODEL: the fits.json of gmwm fit, or the calibration.json of gmwm calibrate, for a pilot "
            "recording.",
            show_default=False,
        ),
    ] = None,
    axis: Annotated[str | None, typer.Option(help="Which axis of that file.", show_default=False)] = None,
    rate: Annotated[
        float | None, typer.Option(help="Samples per second (Hz). Such a file has its own.", show_default=False)
    ] = None,
    accuracy: Annotated[
        str,
        typer.Option(help="Relative standard error that is wanted: 0.1 or 10%, 0.5 the most.", metavar="SHARE"),
    ] = "0.1",
    weighting: Annotated[
        Literal["diagonal", "optimal"] | None,
        typer.Option(
            help="Of the fit to come: each level by its own variance, or by all their covariances. Default: diagonal; "
            "optimal where a process has several parameters of its shape.",
            show_default=False,
        ),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw to this .png, .pdf or .svg file.", rich_help_panel=RESULT)
    ] = None,
) -> Outcome:
    """Say how long to record: the error of each parameter by the length of the recording.

    Standard errors are those of a fit that is still to come, relative to the values, from the exact covariance of
    the wavelet variance under the model; nothing is simulated. Take the values from a pilot recording (gmwm fit
    --output) or a datasheet. A parameter with more than 50 % is not to be seen.
    """
    if (model is None) == (from_fits is None):
        raise OptionError(
            "give a model with its values, or --from-fits with a fits.json or calibration.json, one of them"
        )
    seconds, wanted = parse_length(duration), parse_share(accuracy)
    source: dict[str, Any] = {}
    unit = ""
    if from_fits is not None:
        axis, found = pilot(from_fits, axis)
        source = {"file": str(from_fits), "axis": axis}
        model, remarks = _as_seen(found)
        for remark in remarks:
            tell(remark)
        unit, rate = found["wavelet_variance"]["unit"], _pilot_rate(found, rate, from_fits)
    elif axis is not None:
        raise OptionError("--axis belongs to --from-fits; leave it out, or pass the file too")
    made, needed = _planned(str(model), seconds, rate=rate, accuracy=wanted, weighting=weighting, unit=unit)
    drawn = () if plot is None else (NewFile(plot, lambda path: made.plot(accuracy=wanted, path=path), "drawing"),)
    return Outcome(
        command="plan",
        document={**source, **made.to_dict(), "accuracy": wanted, "needed": needed},
        text=made.summary(wanted),
        files=drawn,
        in_text=made.remarks,
    )


def _pilot_rate(found: Mapping[str, Any], rate: float | None, file: Path) -> float:
    """The rate of a pilot fit, with which --rate must agree."""
    own = float(found["wavelet_variance"]["rate"])
    if rate is not None and abs(rate / own - 1) > 1e-3:
        raise OptionError(
            f"--rate {rate:g} is not the {own:g} Hz of {file}, whose values are per sample; leave --rate out"
        )
    return own


def _planned(
    model: str,
    seconds: float,
    rate: float | None,
    accuracy: float,
    weighting: Literal["diagonal", "optimal"] | None,
    unit: str,
) -> tuple[Plan, dict[str, float]]:
    from gmwm import plan as planned
    from gmwm._arrays import as_rate
    from gmwm.inference.planning import as_accuracy

    as_accuracy(accuracy)
    with progress("planning"):
        made = planned(model, duration=seconds, rate=as_rate(rate), weighting=weighting, unit=unit)
        return made, made.needed(accuracy)


def pilot(path: Path, axis: str | None) -> tuple[str, dict[str, Any]]:
    """The name of an axis and its fit, from what `gmwm fit --output` or `gmwm calibrate --output` wrote."""
    _, fits = fits_in(path)
    name = axis if axis is not None or len(fits) > 1 else next(iter(fits))
    if name not in fits:
        raise OptionError(f"--axis must be one of {', '.join(fits)}, which {path} holds; got {axis or 'none'}")
    return str(name), fits[name]


def fits_in(path: Path) -> tuple[str | None, dict[str, Any]]:
    """The recording that was fitted, where that is known, and the fit of each axis, from such a file or its folder."""
    if path.is_dir():
        there = [path / name for name in ("calibration.json", "fits.json") if (path / name).is_file()]
        if len(there) != 1:
            held = "both fits.json and calibration.json: name the file" if there else "no fits.json or calibration.json"
            raise ReadError(f"{path} holds {held}")
        (path,) = there
    try:
        content = json_module.loads(path.read_text(encoding="utf-8"))
        fits = _fits(content)
    except (ValueError, KeyError, TypeError) as error:
        raise ReadError(
            f"{path} is neither a fits.json of gmwm fit nor a calibration.json ({type(error).__name__}: {error})"
        ) from error
    if not fits:
        raise ReadError(f"{path} is neither a fits.json of gmwm fit nor a calibration.json: it holds no fit")
    return content.get("file") or (content.get("recording") or {}).get("file"), fits


def _fits(content: Mapping[str, Any]) -> dict[str, Any]:
    """The fit of each axis in a document of fits or a calibration."""
    from gmwm.calibration.document import FORMAT

    if "format" in content and content["format"] == FORMAT:
        return {axis: one["fit"] for axis, one in content["axes"].items()}
    return dict(content["axes"]) if content["command"] == "fit" else {}


def _as_seen(found: Mapping[str, Any]) -> tuple[str, list[Remark]]:
    """The model that a pilot fit amounts to, and what was done to it.

    Without the terms that were estimated as zero; those that act as another process are that process.
    """
    from gmwm import Model
    from gmwm.processes.equivalence import likeness

    model, remarks = Model.parse(found["model"]), []
    processes = dict(zip(model.terms, model.processes, strict=True))
    if zero := [term for term, process in processes.items() if process.scale == 0]:
        remarks.append(Remark.of("pilot-left-out", terms=tuple(zero)))
    processes = {term: process for term, process in processes.items() if term not in zero}
    levels, rate, filter, matrix = _measured(found)
    for term, name in found["acts_as"].items():
        like = (
            likeness(processes[term], name, levels=levels, rate=rate, filter=filter, matrix=matrix)
            if term in processes
            else None
        )
        if like is None:
            remarks.append(Remark.of("pilot-undetermined", term=term, process=name))
            continue
        del processes[term]
        value = ", ".join(f"{parameter}={value:.4g}" for parameter, value in like.values.items())
        remarks.append(Remark.of("pilot-acts-as", term=term, process=f"{name}({value})"))
        processes[name] = _added(processes[name], like) if name in processes else like
    return (str(Model(tuple(processes.values()))) if processes else found["model"]), remarks


def _measured(found: Mapping[str, Any]) -> tuple[NDArray[np.int64], float, WaveletFilter, Matrix]:
    """Levels, rate, filter and weights of a fit."""
    import numpy as np

    from gmwm.filters import find_filter

    curve = found["wavelet_variance"]
    return (
        np.array(curve["levels"], dtype=np.int64), float(curve["rate"]), find_filter(curve["filter"]),
        np.array(found["weighting_matrix"], dtype=np.float64),
    )  # fmt: skip


def _added(process: Process, like: Process) -> Process:
    """A process and one of its kind as one."""
    value = like.value_from(process.scale + like.scale)
    return like.with_values(**{like.scale_parameter().name: value})
