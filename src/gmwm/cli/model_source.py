"""Models of the axes: from options, fits, datasheets and files of other programs; and fits by maximum likelihood."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gmwm
from gmwm.base.atomic_files import read_json
from gmwm.base.errors import OptionError, ReadError
from gmwm.base.remarks import Dialect, Remark, texts
from gmwm.base.text import p_text
from gmwm.base.threads import in_threads
from gmwm.base.units import by_sensor
from gmwm.cli.options import named_as_options
from gmwm.cli.output import progress, table_text, tell, units_text
from gmwm.measuring.regression.against import TEMPERATURE, Asked

if TYPE_CHECKING:
    from gmwm.base.arrays import Vector
    from gmwm.files.importers import Given
    from gmwm.fitting.estimation.intervals import Interval
    from gmwm.fitting.likelihood import LikelihoodFit, Residuals
    from gmwm.measuring.regression.result import Regression


@dataclass(frozen=True, eq=False)
class LikelihoodResult:
    """A maximum-likelihood fit with residuals and intervals, or the reason why these are `missing`."""

    fit: LikelihoodFit
    level: float
    intervals: Mapping[str, Interval]
    missing: Remark | None
    residuals: Residuals


def likelihood_fits(
    fits: Mapping[str, gmwm.Fit], signals: Mapping[str, gmwm.Signal], given: gmwm.Model | None = None,
    asked: Mapping[str, Asked | None] | None = None,
) -> dict[str, LikelihoodFit]:  # fmt: skip
    """Fit axes by maximum likelihood in parallel, from wavelet fits or `given`, with regressions `asked`."""
    complete = given if given is not None and given.is_complete else None
    with progress("maximum likelihood", len(fits)) as advance:

        def carried_on(axis: str, start: gmwm.Fit) -> LikelihoodFit:
            label = f"maximum likelihood: {axis}"
            return gmwm.fit_ml(
                start.model, signals[axis], start=complete or start, against=(asked or {}).get(axis),
                progress=lambda count, value: advance(f"{label}, evaluation {count}, {value:.2f}", 0),
            )  # fmt: skip

        return in_threads(carried_on, fits, done=lambda axis: advance(f"maximum likelihood: {axis}"))


def asked_again(regression: Regression | None, temperature: Vector | None) -> Asked | None:
    """Return the regression of a wavelet fit in the form that `fit_ml` takes as `against`; None without one."""
    if regression is None:
        return None
    return Asked(regression.basis.terms, {} if temperature is None else {TEMPERATURE: temperature})


def judge_fits(fits: Mapping[str, LikelihoodFit], level: float) -> dict[str, LikelihoodResult]:
    """Compute the confidence intervals and residuals of each fit, in parallel."""
    from gmwm.fitting.likelihood.intervals import intervals_if_known, own_residuals

    def one(_: str, fit: LikelihoodFit) -> LikelihoodResult:
        intervals, missing = intervals_if_known(fit, level)
        residuals = own_residuals(fit)
        assert residuals is not None  # the fit was made in this run, so it has the samples
        return LikelihoodResult(fit, level, intervals=intervals, missing=missing, residuals=residuals)

    what = "intervals of the likelihood"
    with progress(what, len(fits)) as advance:
        return in_threads(one, fits, done=lambda axis: advance(f"{what}: {axis}"))


def as_dict(found: LikelihoodResult) -> dict[str, Any]:
    """Return a fit with its intervals and tests as plain values for JSON."""
    from gmwm.fitting.likelihood.intervals import inference

    return {
        **found.fit.to_dict(),
        **inference(found.fit, found.level, found.intervals),
        "residuals": found.residuals.to_dict(),
    }


def likelihoods_text(found: Mapping[str, LikelihoodResult]) -> str:
    """Format the summary of one fit, or for several axes a table for each sensor with its axes side by side."""
    from gmwm.fitting.likelihood.intervals import in_words

    if len(found) == 1:
        judged_fit = next(iter(found.values()))
        return in_words(
            judged_fit.fit, judged_fit.level, intervals=judged_fit.intervals, residuals=judged_fit.residuals,
            missing=judged_fit.missing,
        )  # fmt: skip
    first = next(iter(found.values()))
    sensors = by_sensor(found)
    parts = [
        f"Fit by maximum likelihood: {first.fit.samples} samples at {first.fit.rate:g} Hz",
        *map(_sensor_text, sensors.values()),
        "p: p-values of the tests that the residuals are white (Ljung-Box) and normal\n(Jarque-Bera).",
    ]
    remarks = [
        remark.about(name)
        for name, judged_fit in found.items()
        for remark in (judged_fit.missing, *judged_fit.fit.remarks)
        if remark is not None
    ]
    return "\n\n".join([*parts, *(["\n".join(texts(remarks, Dialect.SHELL))] if remarks else [])])


def _sensor_text(group: Mapping[str, LikelihoodResult]) -> str:
    from gmwm.fitting.likelihood.intervals import short_values

    first = next(iter(group.values())).fit
    values = [short_values(judged_fit.fit, judged_fit.intervals) for judged_fit in group.values()]
    rows = [[name, *(shown[name] for shown in values)] for name in first.parameters]
    last = len(rows) - 1
    rows += [
        ["log-likelihood", *(f"{judged_fit.fit.loglikelihood:.3f}" for judged_fit in group.values())],
        ["AIC", *(f"{judged_fit.fit.aic:.2f}" for judged_fit in group.values())],
        ["BIC", *(f"{judged_fit.fit.bic:.2f}" for judged_fit in group.values())],
        ["Ljung-Box, p", *(p_text(judged_fit.residuals.ljung_box().p_value) for judged_fit in group.values())],
        ["Jarque-Bera, p", *(p_text(judged_fit.residuals.normality().p_value) for judged_fit in group.values())],
    ]
    return f"{table_text(['parameter', *group], rows, rules=[last])}\n{units_text(first.units())}"


@dataclass(frozen=True, eq=False)
class AxisModel:
    """The model of one axis."""

    model: gmwm.Fit | LikelihoodFit | gmwm.Model  # the fit, or the model if its values were given
    origin: str  # description of where the values come from, which the output shows
    own: bool  # whether the values were estimated from the recording that the command reads

    @property
    def values(self) -> gmwm.Model:
        """The model with its parameter values."""
        return self.model if isinstance(self.model, gmwm.Model) else self.model.model

    def to_dict(self) -> dict[str, Any]:
        """Return the model, its values and their origin as plain values for JSON."""
        return {"model": str(self.values), "parameters": dict(self.values.parameters), "values": self.origin}


@dataclass(frozen=True, kw_only=True)
class ModelSource:
    """Options that define the model, checked before reading; `fitted_file` is the known recording of `fits_file`."""

    likelihood: bool
    robust: bool
    efficiency: float
    model: gmwm.Model | None = None
    fits: Mapping[str, Any] = field(default_factory=dict)
    fits_file: str = ""
    fitted_file: str | None = None


def model_source(
    model: str | None, from_fits: Path | None, likelihood: bool, robust: bool = False, efficiency: float = 0.6
) -> ModelSource:
    """Check the options that define the model."""
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
        origin = {"model": gmwm.Model.parse(str(model))}
    return ModelSource(likelihood=likelihood, robust=robust, efficiency=efficiency, **origin)


def axis_models(source: ModelSource, signals: Mapping[str, gmwm.Signal], file: Path) -> dict[str, AxisModel]:
    """Return each axis's model with values, fitted if it has none; remarks of fits become warnings."""
    from gmwm.cli.fit import fit_axes

    if source.model is None:
        return {axis: _from_file(source, axis, file) for axis in signals}
    if not source.likelihood and not source.robust and None not in source.model.parameters.values():
        return dict.fromkeys(signals, AxisModel(source.model, "given", False))
    fits: Mapping[str, gmwm.Fit | LikelihoodFit] = fit_axes(
        dict.fromkeys(signals, source.model), signals, robust=source.robust, efficiency=source.efficiency, certify=False
    )
    origin = "fitted to the wavelet variance"
    if source.likelihood:
        fits, origin = likelihood_fits(fits, signals, source.model), "fitted by maximum likelihood"  # type: ignore[arg-type]
    for axis, fit in fits.items():
        for remark in fit.diagnostics.remarks:
            tell(remark.about(axis))
    return {axis: AxisModel(fit, origin, True) for axis, fit in fits.items()}


def axes_of(source: ModelSource, signals: Mapping[str, gmwm.Signal], chosen: bool) -> Mapping[str, gmwm.Signal]:
    """Return the signals to use: all, or, with --from-fits without --axis, those with a fit in the file."""
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
    from gmwm.fitting.likelihood import LikelihoodFit

    if axis not in source.fits:
        expected = f"one of {', '.join(source.fits)}, the axes in {source.fits_file}"
        raise OptionError(argument="axis", expected=expected, got=axis)
    content = source.fits[axis]
    fit: gmwm.Fit | LikelihoodFit
    if source.likelihood:
        if "likelihood" not in content:
            raise ReadError(
                f"{source.fits_file} has no fit of {axis} by maximum likelihood",
                advice="Write one with {gmwm fit --likelihood} and {--output}.",
            )
        fit = LikelihoodFit.from_dict(content["likelihood"])
    else:
        fit = gmwm.Fit.from_dict(content)
    same = source.fitted_file is not None and Path(source.fitted_file).name == file.name
    return AxisModel(fit, f"from {source.fits_file}", same)


@dataclass(frozen=True, eq=False)
class NoiseSource:
    """The noise of each axis. `rate` is the sampling rate (Hz) of axes with a model, because only a fit has its own."""

    axes: Mapping[str, gmwm.Fit | gmwm.Model]
    rate: float | None = None


def read_given(text: str, rate: float | None, option: str = "--from") -> Given:
    """Read noise from a datasheet or a file of another program. Error messages name the shell option."""
    from gmwm.files.importers import given_noise

    with named_as_options({"source": option}):
        return given_noise(text, rate)


def calibration_in(text: str) -> gmwm.Calibration | None:
    """Return the calibration in a file or folder; None if `text` is another source of noise."""
    from gmwm.cli.plan import fits_in

    path = Path(text)
    if path.is_dir():
        fits_in(path)  # Raises an error if the folder has both calibration.json and fits.json.
        path = path / "calibration.json"
    if path.suffix != ".json" or not path.is_file():
        return None
    try:
        content = read_json(path)
    except ValueError:
        return None  # `noise_of` reports the error.
    return gmwm.Calibration.load(path) if isinstance(content, dict) and "settings" in content else None


def noise_of(text: str, rate: float | None, option: str = "SOURCE") -> NoiseSource:
    """Read the noise of a sensor from a calibration, from fits, or from a datasheet or file of another program."""
    from gmwm.cli.plan import fits_in

    path = Path(text)
    if path.is_dir() or path.suffix == ".json":
        _, fits = fits_in(path)
        return NoiseSource({axis: gmwm.Fit.from_dict(content) for axis, content in fits.items()}, rate)
    noise = read_given(text, rate, option)
    return NoiseSource(noise.models, noise.rate)
