"""gmwm fit: fit a noise model to each axis of a recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

import gmwm
from gmwm.base.remarks import Dialect, Remark, texts
from gmwm.base.text import wrap_text
from gmwm.base.units import by_sensor
from gmwm.cli.command import command
from gmwm.cli.conditions import fit_conditions, require_unused
from gmwm.cli.measuring import measure_together, memory_for, needs_memory, open_together
from gmwm.cli.model_source import LikelihoodResult, asked_again, judge_fits, likelihood_fits, likelihoods_text
from gmwm.cli.model_source import as_dict as likelihood_as_dict
from gmwm.cli.options import Chunked, Transform, View, chosen_efficiency, joined_against, picture_units
from gmwm.cli.output import (
    NewFile,
    Outcome,
    json_text,
    make_directory,
    optional_plots,
    over_axes,
    progress,
    table_text,
    tell,
    text_file,
    units_text,
)
from gmwm.cli.read_options import chosen_axes, document_of, only_file
from gmwm.measuring.regression.against import NONE
from gmwm.recording.options import ReadOptions
from gmwm.theory.processes import ordered_classes, registry

if TYPE_CHECKING:
    from gmwm.fitting.estimation.starts import Sampled
    from gmwm.fitting.estimation.summary import IntervalMethod
    from gmwm.showing.plots.labels import UnitSystem, ViewName

EXAMPLES = (
    'gmwm fit static.csv --model "2*GM + WN + QN + RW" --output results',
    'gmwm fit static.csv --axis gyro_y --model "GM + WN" --plot fit.png',
    'gmwm fit static.csv --axis gyro_x --model "GM + WN + RW" --likelihood',
    'gmwm fit monday.csv tuesday.csv --axis gyro_x --model "WN + RW"',
    'gmwm fit turn.csv --model WN --conditions rates.csv --varies "WN: 1 + rate**2"',
    'gmwm fit a.csv --model "GM + WN" --conditions t.csv --varies "GM.beta: t"',
    'gmwm fit P496.tenv3 --axis up -m "WN + FN" --against time+season:1y',
    'gmwm fit log.txt --rate 100 --units gyro=deg/s,accel=g --model "WN + RW"',
)
_PROCESSES = ", ".join(
    [f"{name} {process.title}" for name, process in registry.items()]
    + [f"{ordered.written()} {ordered.title}" for ordered in ordered_classes.values()]
)


@command
def fit(
    files: list[Path],
    reading: ReadOptions,
    model: Annotated[
        str,
        typer.Option(
            "--model",
            "-m",
            help=f"Sum of processes: {_PROCESSES}. 2*GM means two Gauss-Markov processes. Values in the model are "
            "starting values; a value in fixed(…), as in GM(beta=fixed(0.01)), is not estimated.",
            metavar="MODEL",
        ),
    ],
    axis: list[str] | None = None,
    against: list[str] | None = None,
    conditions: Path | None = None,
    varies: list[str] | None = None,
    weighting: Literal["diagonal", "optimal", "identity"] | None = None,
    filter: str = "haar",
    transform: Transform = "modwt",
    robust: bool = False,
    efficiency: float | None = None,
    likelihood: bool = False,
    certify: bool = True,
    start_draws: int | None = None,
    confidence: float = 0.95,
    bootstrap_draws: int | None = None,
    seed: int = 0,
    chunked: Chunked = "auto",
    plot: Path | None = None,
    output: Path | None = None,
    view: View | None = None,
    datasheet: bool | None = None,
) -> Outcome:
    """Fit a noise model to each axis, and print its parameters, confidence intervals and goodness of fit.

    Parameters are in SI units, and their unit of time is one sample. The exception is GM.beta, the inverse correlation
    time, in 1/s. No starting values are needed: the fit is the global optimum. A certificate states by how many
    per cent, at most, other parameter values could lower the objective. Models with several shape parameters per
    process, such as AR(2), have no certificate; their search starts from a scan of all shapes.

    If several files are given, they must be recordings of one unit. One model is fitted to the mean of their curves,
    and a test shows whether the recordings have the same noise. The intervals include the spread between recordings.

    Estimation:
        conditions (TABLE): CSV table of a condition. Its columns are start, stop (s from the first sample) and the
            condition, for example start,stop,rate, if it was constant in parts of the recording; or time and the
            condition, time,rate, if it moved. One model is fitted to all values.
        varies (TERM: SUM): With --conditions: how the variance of a term depends on the condition, as a sum of known
            functions with unknown coefficients, for example 'WN: 1 + rate**2' or 'WN: hats(-20, 20, 60)'. 'GM.beta:
            rate' is the shape β = exp(a + b rate). Repeat the option for other terms.
        weighting: Weights of the levels in the fit: inverse variances (diagonal), inverse covariance matrix (optimal),
            or equal weights (identity). Default: diagonal, but optimal for processes with several shape parameters such
            as AR(2).
        filter (--filter, --moments): Wavelet filter, or moments of the fit. 'haar + lags:8' adds the autocovariances of
            first differences at the lags 1 to 8, which makes MA and ARMA models as precise as maximum likelihood.
            Filters: haar, d4 … d16, la8 … la20, fk4 … fk22, bl14, bl20, mb4 … mb24, or a name of PyWavelets.
        likelihood (--likelihood, --ml): Refine the wavelet fit by maximum likelihood, and print both. Outliers affect
            the likelihood.
        certify (--certify/--no-certify): Compute a certificate that the fit is the global optimum.
        start_draws (DRAWS ≥ 1): Start from the best of this number of random parameter values instead of the usual
            search. Only for comparisons with the original method. --seed sets the random numbers.
    Result:
        confidence (LEVEL): Level of the confidence intervals.
        bootstrap_draws (DRAWS): Compute the intervals and the goodness-of-fit test from this number of simulated
            records, for example 500, instead of from theory. Intervals at 95 % need at least 39 records.
        seed (≥ 0): Seed of the bootstrap and of the random draws.
        plot: Plot the fits to this .png, .pdf or .svg file.
        output: Write fits.json and a plot of each fit to this directory."""
    from gmwm.fitting.estimation import Sampled

    parsed, strength = gmwm.Model.parse(model), chosen_efficiency(robust, efficiency)
    require_unused(
        conditions is not None, varies=bool(varies), against=against is not None, likelihood=likelihood,
        start_draws=start_draws is not None, bootstrap_draws=bootstrap_draws is not None, filter=filter != "haar",
        transform=transform != "modwt", chunked=chunked == "yes",
    )  # fmt: skip
    if conditions is not None:
        return fit_conditions(
            only_file(files, "--conditions"), reading, model=parsed, table=conditions, varies=varies or [], axis=axis,
            weighting=weighting, robust=robust, efficiency=strength, certify=certify, plot=plot, output=output,
        )  # fmt: skip
    if likelihood:
        only_file(files, "--likelihood")
    how = _interval_method(confidence, bootstrap_draws, seed)
    terms = joined_against(against, NONE)
    memory = memory_for(terms, needs_memory(filter, transform))
    recordings = open_together(files, reading, chunked, whole="--likelihood" if likelihood else memory)
    if output is not None:
        make_directory(output)
    signals = measure_together(
        recordings, axis, robust=robust, efficiency=strength, against=terms, filter=filter, transform=transform
    )
    fits = fit_axes(
        dict.fromkeys(signals, parsed), signals, start=None if start_draws is None else Sampled(start_draws, seed),
        weighting=weighting, robust=robust, efficiency=strength, certify=certify, filter=filter, transform=transform,
    )  # fmt: skip
    _tell_curves(fits)
    carried = {}
    if likelihood and isinstance(recording := next(iter(recordings.values())), gmwm.Imu):
        covariates = {name: asked_again(axis_fit.regression, recording.temperature) for name, axis_fit in fits.items()}
        carried = judge_fits(likelihood_fits(fits, chosen_axes(recording, axis), parsed, covariates), confidence)
    picture = partial(_picture, view=view or "auto", units=picture_units(datasheet))
    content = {**document_of(files), "model": str(parsed), "axes": _axes_document(fits, carried, how)}
    parts = [*replicates_text(fits), fits_text(fits, how), *([likelihoods_text(carried)] if carried else [])]
    return Outcome(
        command="fit", document=content, in_text=tuple(_remarks(fits, carried)), text="\n\n".join(parts),
        files=tuple(_files(fits, content, output, plot, picture=picture)),
    )  # fmt: skip


def _tell_curves(fits: Mapping[str, gmwm.Fit]) -> None:
    """Add the remarks on the wavelet variances to the warnings of the command."""
    for name, axis_fit in fits.items():
        for remark in axis_fit.wavelet_variance.remarks:
            tell(remark.about(name))


def _remarks(fits: Mapping[str, gmwm.Fit], carried: Mapping[str, LikelihoodResult]) -> Iterator[Remark]:
    """Yield the remarks about the wavelet fits and the maximum-likelihood fits."""
    for name, axis_fit in fits.items():
        yield from (remark.about(name) for remark in axis_fit.diagnostics.remarks)
    for name, likelihood_fit in carried.items():
        yield from (remark.about(f"{name}, by maximum likelihood") for remark in likelihood_fit.fit.remarks)


def _axes_document(
    fits: Mapping[str, gmwm.Fit], carried: Mapping[str, LikelihoodResult], how: IntervalMethod
) -> dict[str, Any]:
    """Return the fit of each axis with its intervals and tests, as plain values for JSON."""
    from gmwm.fitting.estimation.summary import inference

    axes = {}
    with progress("intervals and tests", len(fits)) as advance:
        for name, axis_fit in fits.items():
            axes[name] = axis_fit.to_dict() | inference(axis_fit, how)
            if axis_fit.replicates is not None:
                axes[name]["replicates"] = axis_fit.replicates.to_dict()
            if name in carried:
                axes[name]["likelihood"] = likelihood_as_dict(carried[name])
            advance(f"intervals and tests: {name}")
    return axes


def _files(
    fits: Mapping[str, gmwm.Fit], content: Mapping[str, Any], folder: Path | None, plot: Path | None,
    picture: Callable[[Mapping[str, gmwm.Fit], Path], NewFile],
) -> Iterator[NewFile]:  # fmt: skip
    """Yield the files to write: fits.json and a plot of each fit for --output, and the plot for --plot."""
    if folder is not None:
        yield text_file(folder / "fits.json", json_text("fit", content) + "\n")
        yield from optional_plots(*(picture({name: f}, folder / f"fit_{name}.png") for name, f in fits.items()))
    if plot is not None:
        yield picture(fits, plot)


def _interval_method(confidence: float, draws: int | None, seed: int) -> IntervalMethod:
    """Return the method for intervals and tests: theory, or a bootstrap if `draws` is given."""
    from gmwm.fitting.estimation.bootstrap import as_draws
    from gmwm.fitting.estimation.summary import IntervalMethod

    how = IntervalMethod(confidence)
    if draws is None:
        return how
    as_draws(draws, how.least_draws, f"a test at 5 % with intervals of {100 * confidence:g} %", "bootstrap_draws")
    return IntervalMethod(confidence, "bootstrap", draws, seed)


def fit_axes(
    models: Mapping[str, Any], signals: Mapping[str, Any], *,
    weighting: Literal["diagonal", "optimal", "identity"] | None = None, robust: bool = False, efficiency: float = 0.6,
    certify: bool = True, filter: str = "haar", transform: Literal["modwt", "dwt"] = "modwt",
    start: Sampled | None = None,
) -> dict[str, gmwm.Fit]:  # fmt: skip
    """Fit the model of each axis to its signal or wavelet variance, in parallel."""
    import gmwm
    from gmwm.measuring.covariance.tails import with_tails

    def measured_and_fitted(signal: gmwm.Signal | gmwm.WaveletVariance) -> gmwm.Fit:
        wv = signal
        if not isinstance(signal, gmwm.WaveletVariance):
            wv = gmwm.wavelet_variance(signal, filter=filter, transform=transform, robust=robust, efficiency=efficiency)
            wv = with_tails(wv, signal)
        return gmwm.fit(models[signal.axis], wv, weighting=weighting, certify=certify, start=start)

    return over_axes(measured_and_fitted, signals, "fitting")


def _picture(fits: Mapping[str, gmwm.Fit], path: Path, view: ViewName, units: UnitSystem) -> NewFile:
    """Return a file with a plot of one fit and its terms, or of several fits with a panel for each."""
    from gmwm.showing.plots.imu import plot_imu

    def draw(target: Path) -> None:
        if len(fits) == 1:
            next(iter(fits.values())).plot(view=view, units=units, path=target)
        else:
            plot_imu(fits, view=view, units=units, path=target)

    return NewFile(path, draw, f"plotting {path.name}")


def replicates_text(fits: Mapping[str, gmwm.Fit]) -> Iterator[str]:
    """Yield the comparison of several recordings as text, for each axis."""
    for name, axis_fit in fits.items():
        if axis_fit.replicates is not None:
            summary = axis_fit.replicates.summary()
            yield f"{name}\n{summary}" if len(fits) > 1 else summary


def fits_text(fits: Mapping[str, gmwm.Fit], how: IntervalMethod) -> str:
    """Format the summary of one fit, or for several axes a table for each sensor with its axes side by side."""
    from gmwm.fitting.estimation.summary import intervals_if_known

    if len(fits) == 1:
        return next(iter(fits.values())).summary(how.level, how.method, draws=how.draws, rng=how.seed)
    first = next(iter(fits.values()))
    wv = first.wavelet_variance
    robust = f"robust with efficiency {wv.efficiency:g}, " if wv.robust else ""
    sensors = by_sensor(fits)
    parts = [
        f"{first.model.structure}, {wv.extent}, {robust}weighting {first.weighting}",
        *(_sensor_text(group, how) for group in sensors.values()),
        f"±: relative standard error. ≤: upper limit at {50 + 50 * how.level:g} %. p: p-value of the\n"
        "goodness-of-fit test. For confidence intervals, select one axis or use --json.",
    ]
    remarks = [
        remark.about(name)
        for name, axis_fit in fits.items()
        for remark in (intervals_if_known(axis_fit, how)[1], *axis_fit.diagnostics.remarks)
        if remark is not None
    ]
    lines = [line for text in texts(remarks, Dialect.SHELL) for line in wrap_text(text)]
    return "\n\n".join([*parts, *(["\n".join(lines)] if lines else [])])


def _sensor_text(group: Mapping[str, gmwm.Fit], how: IntervalMethod) -> str:
    from gmwm.fitting.estimation.summary import short_values, test_in_words

    first = next(iter(group.values()))
    units = first.units()
    values = [short_values(axis_fit, how) for axis_fit in group.values()]
    rows = [[name, *(shown[name] for shown in values)] for name in first.parameters]
    last = len(rows) - 1
    tests = [test_in_words(axis_fit, how)[0] for axis_fit in group.values()]
    rows.append(["p of the fit", *("not tested" if t is None else t.pvalue_in_words for t in tests)])
    rows.append(["objective", *(f"{axis_fit.objective:.5g}" for axis_fit in group.values())])
    rows.append(
        ["optimality gap", *("none" if fit.gap is None else f"{100 * fit.gap:.2g} %" for fit in group.values())]
    )
    return f"{table_text(['parameter', *group], rows, rules=[last])}\n{units_text(units)}"
