"""Options for the model of commands that run a Kalman filter, and the origin of its values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gmwm.cli.likelihood_output import LIKELIHOOD, likelihood_fits
from gmwm.errors import OptionError, ReadError

if TYPE_CHECKING:
    from gmwm.estimation.result import Fit
    from gmwm.likelihood import LikelihoodFit
    from gmwm.processes.model import Model
    from gmwm.signals import Signal

ModelText = Annotated[
    str | None,
    typer.Option(
        "--model",
        "-m",
        help="Sum of processes, as for gmwm fit. If all parameters have values, these are used; otherwise the model is "
        "first fitted to each axis.",
        metavar="MODEL",
        show_default=False,
    ),
]
FromFits = Annotated[
    Path | None,
    typer.Option(
        help="Instead of --model: fits.json of gmwm fit or calibration.json of gmwm calibrate, from this recording or "
        "from another one of the same unit at the same rate.",
        show_default=False,
    ),
]
ByLikelihood = Annotated[
    bool,
    typer.Option(
        *LIKELIHOOD,
        help="Fit by maximum likelihood, starting from the wavelet fit. With --from-fits, use the fit by maximum "
        "likelihood in the file.",
        rich_help_panel="Estimation",
    ),
]


@dataclass(frozen=True, eq=False)
class AxisModel:
    """The model of an axis with its values, their origin, and whether they were estimated from the same recording."""

    model: Fit | LikelihoodFit | Model
    origin: str
    own: bool

    @property
    def values(self) -> Model:
        """The model itself."""
        from gmwm.processes.model import Model

        return self.model if isinstance(self.model, Model) else self.model.model

    def to_dict(self) -> dict[str, Any]:
        """Return the model and its values as plain texts and numbers."""
        return {"model": str(self.values), "parameters": dict(self.values.parameters), "values": self.origin}


@dataclass(frozen=True)
class ModelSource:
    """The options that define the model, checked before a recording is read."""

    model: Model | None
    fits: Mapping[str, Any]
    fits_file: str
    fitted_file: str | None
    likelihood: bool
    robust: bool
    efficiency: float


def model_source(
    model: str | None, from_fits: Path | None, likelihood: bool, robust: bool = False, efficiency: float = 0.6
) -> ModelSource:
    """Check the options that define the model.

    Raises
    ------
    OptionError
        If they contradict each other.
    """
    from gmwm import Model
    from gmwm.cli.plan import fits_in

    if (model is None) == (from_fits is None):
        raise OptionError(
            "exactly one of --model and --from-fits is needed",
            argument="model",
            got=model,
            advice="Write a model with {--model}, or pass a fits.json or calibration.json with {--from-fits}.",
        )
    if from_fits is not None:
        if robust:
            raise OptionError(
                "--robust applies to fitting a model, but the models of --from-fits are fitted already",
                argument="robust",
                got=robust,
                advice="Leave {--robust} or {--from-fits} out.",
            )
        fitted, fits = fits_in(from_fits)
        return ModelSource(
            model=None,
            fits=fits,
            fits_file=str(from_fits),
            fitted_file=fitted,
            likelihood=likelihood,
            robust=robust,
            efficiency=efficiency,
        )
    parsed = Model.parse(str(model))
    return ModelSource(
        model=parsed,
        fits={},
        fits_file="",
        fitted_file=None,
        likelihood=likelihood,
        robust=robust,
        efficiency=efficiency,
    )


def axis_models(source: ModelSource, signals: Mapping[str, Signal], file: Path) -> dict[str, AxisModel]:
    """Return the model of each axis with its values. The remarks of new fits become warnings."""
    from gmwm.cli.fit import fit_axes
    from gmwm.cli.output import tell

    if source.model is None:
        return {axis: _from_file(source, axis, file) for axis in signals}
    if not source.likelihood and not source.robust and None not in source.model.parameters.values():
        return dict.fromkeys(signals, AxisModel(source.model, "given", False))
    fits: Mapping[str, Fit | LikelihoodFit] = fit_axes(
        dict.fromkeys(signals, source.model), signals, robust=source.robust, efficiency=source.efficiency, certify=False
    )
    origin = "fitted to the wavelet variance"
    if source.likelihood:
        fits, origin = likelihood_fits(fits, signals, source.model), "fitted by maximum likelihood"  # type: ignore[arg-type]
    for axis, fit in fits.items():
        for remark in fit.diagnostics.remarks:
            tell(remark.about(axis))
    return {axis: AxisModel(fit, origin, True) for axis, fit in fits.items()}


def axes_of(source: ModelSource, signals: Mapping[str, Signal], chosen: bool) -> Mapping[str, Signal]:
    """Return the signals to use: the axes for which the file of fits has models, or the axes that --axis selects."""
    if source.model is not None or chosen:
        return signals
    there = {axis: signal for axis, signal in signals.items() if axis in source.fits}
    if not there:
        raise OptionError(
            f"the fits and the recording have no axis in common: {source.fits_file} has {', '.join(source.fits)}, the "
            f"recording has {', '.join(signals)}",
            argument="from_fits",
            got=source.fits_file,
        )
    return there


def _from_file(source: ModelSource, axis: str, file: Path) -> AxisModel:
    from gmwm import Fit
    from gmwm.likelihood import LikelihoodFit

    if axis not in source.fits:
        expected = f"one of {', '.join(source.fits)}, the axes in {source.fits_file}"
        raise OptionError(argument="axis", expected=expected, got=axis)
    content = source.fits[axis]
    fit: Fit | LikelihoodFit
    if source.likelihood:
        if "likelihood" not in content:
            raise ReadError(
                f"{source.fits_file} has no fit of {axis} by maximum likelihood",
                advice="Write one with {gmwm fit --likelihood} and {--output}.",
            )
        fit = LikelihoodFit.from_dict(content["likelihood"])
    else:
        fit = Fit.from_dict(content)
    same = source.fitted_file is not None and Path(source.fitted_file).name == file.name
    return AxisModel(fit, f"from {source.fits_file}", same)
