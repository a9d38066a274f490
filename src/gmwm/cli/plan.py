"""gmwm plan: find how long a recording must be for a desired accuracy of the parameters."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import gmwm
from gmwm.base.arrays import Integers, Matrix, as_rate
from gmwm.base.atomic_files import read_json
from gmwm.base.errors import OptionError, ReadError
from gmwm.base.remarks import Remark
from gmwm.base.time_base import parse_length, parse_share
from gmwm.base.units import SI_UNIT
from gmwm.cli.command import command
from gmwm.cli.model_source import read_given
from gmwm.cli.output import Outcome, plot_file, progress, tell
from gmwm.theory.filters import WaveletFilter, find_filter

if TYPE_CHECKING:
    from gmwm.fitting.inference.planning import Plan

EXAMPLES = (
    'gmwm plan "GM(beta=1, sigma2=1e-8) + WN(sigma2=4e-6)" --rate 100 --duration 2h',
    "gmwm plan --from-fits fits.json --axis gyro_x --duration 1d --accuracy 5%",
    'gmwm plan --from "gyro: N=0.15deg/√h, K=2deg/h/√h" --rate 100 --duration 2h',
)

_FITS = "Pass the folder or the file that `gmwm fit` or `gmwm calibrate` wrote."


@command
def plan(
    duration: str,
    model: str | None = None,
    from_fits: Path | None = None,
    source: str | None = None,
    axis: str | None = None,
    rate: float | None = None,
    accuracy: str = "0.1",
    weighting: Literal["diagonal", "optimal"] | None = None,
    plot: Path | None = None,
) -> Outcome:
    """Plan how long to record: print the standard error of each parameter for several durations.

    The relative standard errors of a future fit are computed from the exact covariance of the wavelet variance under
    the model, without simulation. Take the values of the model from a pilot recording (gmwm fit --output) or from a
    datasheet. If the relative standard error of a parameter is above 50 %, the recording does not determine it. With
    --from-fits, the planned recording is assumed to have gaps like those of the pilot recording.

    Arguments:
        model (MODEL): Model with all parameter values (in SI units, per sample where time enters, but GM.beta in 1/s).
            Values in fixed(…) are treated as known.
    Options:
        duration (LENGTH): Duration of the planned recording, such as 90s, 30min, 1h30m, 2h, 1d or a number of seconds.
        from_fits: Instead of MODEL: the fits.json of gmwm fit or the calibration.json of gmwm calibrate for a pilot
            recording.
        axis: Axis to use from --from-fits or --from.
        rate: Sampling rate (Hz). Not needed with --from-fits.
        accuracy (SHARE): Desired relative standard error, as 0.1 or 10%; at most 0.5.
        weighting: Weights of the planned fit: inverse variances (diagonal) or inverse covariance matrix (optimal).
            Default: diagonal, but optimal for processes with several shape parameters such as AR(2)."""
    if sum(source_given is not None for source_given in (model, from_fits, source)) != 1:
        raise OptionError(
            "exactly one of MODEL, --from-fits and --from is needed", argument="model", got=model,
            advice="Write a model with its values, or pass a fits.json or calibration.json with {--from_fits}, or the "
            "numbers of a datasheet with {--from}.",
        )  # fmt: skip
    if model is not None and Path(model).exists():
        raise OptionError(
            f"MODEL is a model with values, and {model} is a file", argument="model", got=model,
            advice="Pass the file with {--from_fits}.",
        )  # fmt: skip
    seconds, share = parse_length(duration), parse_share(accuracy)
    origin: dict[str, Any] = {}
    unit, curve = "", None
    if from_fits is not None:
        axis, pilot_fit = pilot(from_fits, axis)
        origin = {"file": str(from_fits), "axis": axis}
        model, remarks = _as_seen(pilot_fit)
        for remark in remarks:
            tell(remark)
        unit, rate = pilot_fit["wavelet_variance"]["unit"], _pilot_rate(pilot_fit, rate, from_fits)
        curve = pilot_fit["wavelet_variance"]
    elif source is not None:
        axis, model, rate = _given_axis(source, axis, rate)
        origin = {"file": source, "axis": axis}
        unit = SI_UNIT["gyro" if axis.startswith("gyro") else "accel"]
    elif axis is not None:
        raise OptionError(
            "--axis applies only to --from-fits and --from", argument="axis", got=axis, advice="Leave {--axis} out."
        )
    design, needed = _plan(str(model), seconds, rate=rate, accuracy=share, weighting=weighting, unit=unit, curve=curve)
    return Outcome(
        command="plan", document={**origin, **design.to_dict(), "accuracy": share, "needed": needed},
        text=design.summary(share), files=plot_file(plot, lambda path: design.plot(accuracy=share, path=path)),
        in_text=design.remarks,
    )  # fmt: skip


def _given_axis(source: str, axis: str | None, rate: float | None) -> tuple[str, str, float]:
    """Return axis, model and rate of a datasheet or file; `axis` can be None if all axes have one model."""
    noise = read_given(source, rate)
    models = {name: str(model) for name, model in noise.models.items()}
    if axis is None and len(set(models.values())) == 1:
        axis = next(iter(models))
    if axis not in models:
        raise OptionError(argument="axis", expected=f"one of {', '.join(models)}", got=axis)
    return str(axis), models[axis], noise.rate


def _pilot_rate(found: Mapping[str, Any], rate: float | None, file: Path) -> float:
    """Return the sampling rate (Hz) of a pilot fit. Raises an OptionError if --rate is given and differs from it."""
    pilot_rate = float(found["wavelet_variance"]["rate"])
    if rate is not None and abs(rate / pilot_rate - 1) > 1e-3:
        raise OptionError(
            f"--rate {rate:g} differs from the rate in {file}, {pilot_rate:g} Hz, for which its values are",
            argument="rate", got=rate, advice="Leave {--rate} out.",
        )  # fmt: skip
    return pilot_rate


def _plan(
    model: str, seconds: float, rate: float | None, accuracy: float, weighting: Literal["diagonal", "optimal"] | None,
    unit: str, curve: Mapping[str, Any] | None,
) -> tuple[Plan, dict[str, float]]:  # fmt: skip
    from gmwm.fitting.inference.planning import as_accuracy

    as_accuracy(accuracy)
    with progress("planning"):
        pilot = None if curve is None else gmwm.WaveletVariance.from_dict(curve)
        design = gmwm.plan(model, duration=seconds, rate=as_rate(rate), weighting=weighting, unit=unit, pilot=pilot)
        return design, design.needed(accuracy)


def pilot(path: Path, axis: str | None) -> tuple[str, dict[str, Any]]:
    """Return an axis's name and fit from fits.json or calibration.json; `axis` can be None for a single one."""
    _, fits = fits_in(path)
    name = axis if axis is not None or len(fits) > 1 else next(iter(fits))
    if name not in fits:
        raise OptionError(argument="axis", expected=f"one of {', '.join(fits)}, the axes in {path}", got=axis)
    return str(name), fits[name]


def fits_in(path: Path) -> tuple[str | None, dict[str, Any]]:
    """Read the fits from a fits.json or calibration.json, or from the one of these files that a folder contains."""
    if path.is_dir():
        candidates = [path / name for name in ("calibration.json", "fits.json") if (path / name).is_file()]
        if not candidates:
            raise ReadError(f"{path} contains neither fits.json nor calibration.json", got=str(path), advice=_FITS)
        if len(candidates) > 1:
            raise ReadError(
                f"{path} contains both fits.json and calibration.json", got=str(path), advice="Pass one of the files."
            )
        (path,) = candidates
    try:
        content = read_json(path)
    except ValueError as error:
        raise _not_fits(path, f"it is not JSON, or it is truncated: {error}") from error
    try:
        file, fits = _fits(content)
    except ReadError as error:
        raise _not_fits(path, error.reason) from error
    if not fits:
        raise ReadError(f"{path} contains no fit", got=str(path), advice=_FITS)
    return file, fits


def _not_fits(path: Path, why: str) -> ReadError:
    return ReadError(
        f"{path} is neither a fits.json nor a calibration.json of gmwm ({why})", got=str(path), advice=_FITS
    )


def _fits(content: Any) -> tuple[str | None, dict[str, Any]]:
    """Return the recording and the fit of each axis in a fits.json or calibration.json."""
    from gmwm.calibration.document import FORMAT
    from gmwm.fitting.likelihood import LikelihoodFit

    if not isinstance(content, Mapping):
        raise ReadError("it is not an object")
    if content.get("format") == FORMAT:
        calibration = gmwm.Calibration.from_dict(content)
        file = None if calibration.recording is None else calibration.recording.file
        return file, {axis: document.to_dict() for axis, document in calibration.items()}
    if content.get("command") != "fit":
        raise ReadError('it has neither "format": "gmwm-calibration" nor "command": "fit"')
    file, axes = content.get("file"), content.get("axes")
    if not isinstance(axes, Mapping) or not all(isinstance(document, Mapping) for document in axes.values()):
        raise ReadError("axes must be an object of fits")
    if not isinstance(file, str | None):
        raise ReadError("file must be a string or null")
    fits = {}
    for axis, document in axes.items():
        try:
            # Values that the document leaves out have defaults.
            fits[axis] = dict(document) | gmwm.Fit.from_dict(document).to_dict()
            if document.get("likelihood") is not None:
                LikelihoodFit.from_dict(document["likelihood"])
        except ReadError as error:
            raise error.at(axis) from error
    return file, fits


def _as_seen(found: Mapping[str, Any]) -> tuple[str, list[Remark]]:
    """Return a pilot fit's model to plan with, and remarks. Zero terms are left out, and simpler processes replace
    terms that act as them, such as a slow GM as a walk."""
    from gmwm.theory.processes.equivalence import likeness

    model, remarks = gmwm.Model.parse(found["model"]), []
    processes = model.by_term
    if zero := [term for term, process in processes.items() if process.scale == 0]:
        remarks.append(Remark.of("term-zero", case="pilot", terms=tuple(zero)))
    processes = {term: process for term, process in processes.items() if term not in zero}
    levels, rate, filter, matrix = _measure(found)
    for term, name in found["acts_as"].items():
        like = (
            likeness(processes[term], name, levels=levels, rate=rate, filter=filter, matrix=matrix)
            if term in processes
            else None
        )
        if like is None:
            remarks.append(Remark.of("correlation-time-unknown", case="undetermined", term=term, process=name))
            continue
        del processes[term]
        value = ", ".join(f"{parameter}={value:.4g}" for parameter, value in like.values.items())
        remarks.append(Remark.of("correlation-time-unknown", case="pilot", term=term, process=f"{name}({value})"))
        processes[name] = like.with_scale(processes[name].scale + like.scale) if name in processes else like
    return (str(gmwm.Model(tuple(processes.values()))) if processes else found["model"]), remarks


def _measure(found: Mapping[str, Any]) -> tuple[Integers, float, WaveletFilter, Matrix]:
    """Return the levels, sampling rate (Hz), wavelet filter and weighting matrix of a fit from its JSON document."""
    import numpy as np

    curve = found["wavelet_variance"]
    return (
        np.array(curve["levels"], dtype=np.int64), float(curve["rate"]), find_filter(curve["filter"]),
        np.array(found["weighting_matrix"], dtype=np.float64),
    )  # fmt: skip
