"""The model of the commands that run a Kalman filter: which model, and where its values come from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gmwm.cli.likelihood_output import LIKELIHOOD, likelihood_fits, require_states
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
        help="A sum of processes that have a state-space form, as gmwm fit takes it. With values of all parameters it "
        "is taken as it is; else it is fitted to each axis first.",
        metavar="MODEL",
        show_default=False,
    ),
]
FromFits = Annotated[
    Path | None,
    typer.Option(
        help="In place of --model: the fits.json of gmwm fit, or the calibration.json of gmwm calibrate, for this "
        "recording or another of the same unit at the same rate.",
        show_default=False,
    ),
]
ByLikelihood = Annotated[
    bool,
    typer.Option(
        *LIKELIHOOD,
        help="Fit by maximum likelihood, from the wavelet fit on; with --from-fits, take the fit by it in that file.",
        rich_help_panel="Estimation",
    ),
]


@dataclass(frozen=True, eq=False)
class AxisModel:
    """The model of an axis with its values, their origin, and whether they were estimated from this very record."""

    model: Fit | LikelihoodFit | Model
    origin: str
    own: bool

    @property
    def values(self) -> Model:
        """The model itself."""
        from gmwm.processes.model import Model

        return self.model if isinstance(self.model, Model) else self.model.model

    def to_dict(self) -> dict[str, Any]:
        """Model and values as plain texts and numbers."""
        return {"model": str(self.values), "parameters": dict(self.values.parameters), "values": self.origin}


@dataclass(frozen=True)
class ModelSource:
    """The options on the model, checked before a file is read."""

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
    """The source of the model, or an error if options contradict each other."""
    from gmwm import Model
    from gmwm.cli.plan import fits_in

    if (model is None) == (from_fits is None):
        raise OptionError("give a model as --model, or --from-fits with a fits.json or calibration.json, one of them")
    if from_fits is not None:
        if robust:
            raise OptionError("--robust is how a model is fitted; with --from-fits it is fitted already, leave one out")
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
    require_states(parsed, "--model")
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
    """The model of each axis with its values; fitted ones pass on their warnings."""
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
    """The signals that there is a model for: those of the file of fits, unless axes are named."""
    if source.model is not None or chosen:
        return signals
    there = {axis: signal for axis, signal in signals.items() if axis in source.fits}
    if not there:
        raise OptionError(
            f"--from-fits holds {', '.join(source.fits)}, the recording {', '.join(signals)}: none in common"
        )
    return there


# --- inside -------------------------------------------------------------------------------------------


def _from_file(source: ModelSource, axis: str, file: Path) -> AxisModel:
    from gmwm import Fit
    from gmwm.likelihood import LikelihoodFit

    if axis not in source.fits:
        raise OptionError(f"--axis must be one of {', '.join(source.fits)}, which {source.fits_file} holds; got {axis}")
    content = source.fits[axis]
    fit: Fit | LikelihoodFit
    if source.likelihood:
        if "likelihood" not in content:
            raise ReadError(
                f"{source.fits_file} has no fit by maximum likelihood of {axis}: write it with gmwm fit --ml"
            )
        fit = LikelihoodFit.from_dict(content["likelihood"])
    else:
        fit = Fit.from_dict(content)
    require_states(fit.model, f"{axis} of {source.fits_file}")
    same = source.fitted_file is not None and Path(source.fitted_file).name == file.name
    return AxisModel(fit, f"of {source.fits_file}", same)
