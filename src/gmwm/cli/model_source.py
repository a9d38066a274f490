"""Options that define the model in commands that run a Kalman filter, and the models that they select."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gmwm.base.errors import OptionError, ReadError
from gmwm.cli.likelihood_output import LIKELIHOOD, likelihood_fits
from gmwm.cli.options import EstimationOption

if TYPE_CHECKING:
    from gmwm.fitting.estimation.result import Fit
    from gmwm.fitting.likelihood import LikelihoodFit
    from gmwm.recording.signals import Signal
    from gmwm.theory.processes.model import Model

ModelText = Annotated[
    str | None,
    typer.Option(
        "--model",
        "-m",
        help="Sum of processes, as for gmwm fit. If all parameters have values, the command uses these values; "
        "otherwise it first fits the model to each axis.",
        metavar="MODEL",
    ),
]
FromFits = Annotated[
    Path | None,
    typer.Option(
        help="Instead of --model: the fits.json of gmwm fit or the calibration.json of gmwm calibrate. It can come "
        "from this recording, or from another recording of the same unit at the same rate."
    ),
]
ByLikelihood = Annotated[
    bool,
    EstimationOption(
        *LIKELIHOOD,
        help="Fit the model by maximum likelihood, starting from the wavelet fit. With --from-fits, use the "
        "maximum-likelihood fit in the file.",
    ),
]


@dataclass(frozen=True, eq=False)
class AxisModel:
    """The model of one axis."""

    model: Fit | LikelihoodFit | Model  # the fit, or the model if its values were given
    origin: str  # description of where the values come from, which the output shows
    own: bool  # whether the values were estimated from the recording that the command reads

    @property
    def values(self) -> Model:
        """The model with its parameter values."""
        from gmwm.theory.processes.model import Model

        return self.model if isinstance(self.model, Model) else self.model.model

    def to_dict(self) -> dict[str, Any]:
        """Return the model, its values and their origin as plain values for JSON."""
        return {"model": str(self.values), "parameters": dict(self.values.parameters), "values": self.origin}


@dataclass(frozen=True, kw_only=True)
class ModelSource:
    """The options that define the model, checked before the recording is read: `model`, or the fit of each axis from
    `fits_file`. `fitted_file` is the recording of these fits, if it is known."""

    likelihood: bool
    robust: bool
    efficiency: float
    model: Model | None = None
    fits: Mapping[str, Any] = field(default_factory=dict)
    fits_file: str = ""
    fitted_file: str | None = None


def model_source(
    model: str | None, from_fits: Path | None, likelihood: bool, robust: bool = False, efficiency: float = 0.6
) -> ModelSource:
    """Check the options that define the model."""
    from gmwm import Model
    from gmwm.cli.plan import fits_in

    if (model is None) == (from_fits is None):
        raise OptionError(
            "exactly one of --model and --from-fits is needed", argument="model", got=model,
            advice="Write a model with {--model}, or pass a fits.json or calibration.json with {--from-fits}.",
        )  # fmt: skip
    if from_fits is not None:
        if robust:
            raise OptionError(
                "--robust applies to fitting a model, but the models of --from-fits are fitted already",
                argument="robust", got=robust, advice="Leave {--robust} or {--from-fits} out.",
            )  # fmt: skip
        fitted, fits = fits_in(from_fits)
        origin: dict[str, Any] = {"fits": fits, "fits_file": str(from_fits), "fitted_file": fitted}
    else:
        origin = {"model": Model.parse(str(model))}
    return ModelSource(likelihood=likelihood, robust=robust, efficiency=efficiency, **origin)


def axis_models(source: ModelSource, signals: Mapping[str, Signal], file: Path) -> dict[str, AxisModel]:
    """Return the model of each axis with its values, and fit the model if it has none. The remarks of new fits become
    warnings of the command."""
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
    """Return the signals to use: all given ones or, with --from-fits and without --axis, those for which the file has a
    fit."""
    if source.model is not None or chosen:
        return signals
    fitted = {axis: signal for axis, signal in signals.items() if axis in source.fits}
    if not fitted:
        raise OptionError(
            f"the fits and the recording have no axis in common: {source.fits_file} has {', '.join(source.fits)}, the "
            f"recording has {', '.join(signals)}", argument="from_fits", got=source.fits_file,
        )  # fmt: skip
    return fitted


def _from_file(source: ModelSource, axis: str, file: Path) -> AxisModel:
    from gmwm import Fit
    from gmwm.fitting.likelihood import LikelihoodFit

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
