"""gmwm fit: a noise model for each axis of a recording, with its certificate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from gmwm.cli.likelihood_output import LIKELIHOOD, judged, likelihood_fits, print_likelihoods, require_states
from gmwm.cli.likelihood_output import as_dict as likelihood_as_dict
from gmwm.cli.measuring import Chunked, needs_memory, opened, signals_or_curves
from gmwm.cli.options import (
    RESULT,
    Datasheet,
    Efficiency,
    Filter,
    Json,
    Robust,
    TransformName,
    View,
    chosen_efficiency,
    confidence_level,
)
from gmwm.cli.read_options import Axes, File, Opening, chosen_axes, opens
from gmwm.processes import ordered_classes, registry

if TYPE_CHECKING:
    from gmwm.estimation.result import Fit
    from gmwm.estimation.starts import Sampled
    from gmwm.inference.summary import IntervalMethod
    from gmwm.signals import Signal

EXAMPLES = (
    "gmwm fit static.csv --model '2*GM + WN + QN + RW' --output results",
    "gmwm fit static.csv --axis gyro_y --model 'GM + WN' --plot fit.png",
    "gmwm fit static.csv --axis gyro_x --model 'GM + WN + RW' --likelihood",
    "gmwm fit log.txt --rate 100 --units gyro=deg/s,accel=g --model 'WN + RW'",
)
_PROCESSES = ", ".join(
    [f"{name} {process.title}" for name, process in registry.items()]
    + [f"{ordered.written()} {ordered.title}" for ordered in ordered_classes.values()]
)


@opens
def fit(
    file: File,
    opening: Opening,
    model: Annotated[
        str,
        typer.Option(
            "--model",
            "-m",
            help=f"A sum of processes: {_PROCESSES}. Numbers repeat: 2*GM. Values start there, fixed values are "
            "held: GM(beta=fixed(0.01)).",
            metavar="MODEL",
            show_default=False,
        ),
    ],
    axis: Axes = None,
    weighting: Annotated[
        Literal["diagonal", "optimal", "identity"] | None,
        typer.Option(
            help="Weigh each level by its own variance, or with all covariances, or all alike. Default: diagonal; "
            "optimal where a process has several parameters of its shape.",
            rich_help_panel="Estimation",
            show_default=False,
        ),
    ] = None,
    filter: Filter = "haar",
    transform: TransformName = "modwt",
    robust: Robust = False,
    efficiency: Efficiency = None,
    likelihood: Annotated[
        bool,
        typer.Option(
            *LIKELIHOOD,
            help="Carry each fit on to the largest likelihood, and show that one too. Not robust; every process needs "
            "a state-space form, which FN, PL, FGN and MAT have not.",
            rich_help_panel="Estimation",
        ),
    ] = False,
    certify: Annotated[
        bool,
        typer.Option("--certify/--no-certify", help="Prove that no better fit exists.", rich_help_panel="Estimation"),
    ] = True,
    draws: Annotated[
        int | None,
        typer.Option(
            help="Start from the best of so many random draws, as the paper does, and --seed; for comparison only.",
            metavar="DRAWS",
            min=1,
            rich_help_panel="Estimation",
            show_default=False,
        ),
    ] = None,
    confidence: Annotated[
        float,
        typer.Option(
            callback=confidence_level,
            help="Level of the parameters' confidence intervals.",
            metavar="LEVEL",
            rich_help_panel=RESULT,
        ),
    ] = 0.95,
    bootstrap: Annotated[
        int | None,
        typer.Option(
            help="Intervals and test from so many simulated records, 500 say, in place of theory; at least 39 at 95 %.",
            metavar="DRAWS",
            rich_help_panel=RESULT,
            show_default=False,
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the bootstrap and the draws.", min=0, rich_help_panel=RESULT)] = 0,
    chunked: Chunked = "auto",
    plot: Annotated[
        Path | None,
        typer.Option(help="Draw the fits to this .png, .pdf or .svg file.", rich_help_panel=RESULT),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(help="Write fits.json and a picture of each fit into this directory.", rich_help_panel=RESULT),
    ] = None,
    view: View = "wavelet",
    datasheet: Datasheet = False,
    json: Json = False,
) -> None:
    """Fit a model to each axis and print its parameters with confidence intervals, and a test of the fit.

    Parameters are in SI units and per sample, but for GM.beta, the inverse correlation time in 1/s. The
    estimate is the best there is: no starting values are needed, and the certificate says by how many per cent
    of the objective a better one could gain at most. Processes with several parameters of their shape, as AR(2),
    have none: theirs is the best of what a scan of all shapes leads to.
    """
    import gmwm
    from gmwm import parse_model
    from gmwm.cli.output import made_directory, print_json, print_written, progress, tell, told_warnings

    parsed = parse_model(model)
    if likelihood:
        require_states(parsed, LIKELIHOOD[0])
    how = _interval_method(confidence, bootstrap, seed)
    with told_warnings() as told:
        whole = LIKELIHOOD[0] if likelihood else needs_memory(filter, transform)
        recording = opened(file, opening, chunked, whole=whole)
        if output is not None:
            made_directory(output)
        strength = chosen_efficiency(robust, efficiency)
        signals = signals_or_curves(recording, axis, robust=robust, efficiency=strength, told=told)
        fits = fit_axes(
            dict.fromkeys(recording.axes, parsed), signals, weighting=weighting, robust=robust,
            efficiency=strength, certify=certify, filter=filter, transform=transform,
            start=None if draws is None else gmwm.Sampled(draws, seed),
        )  # fmt: skip
        for name, found in fits.items():
            for note in found.wavelet_variance.notes():
                tell(told, f"{name}: {note}")
        carried = {}
        if likelihood and isinstance(recording, gmwm.Imu):
            carried = judged(likelihood_fits(fits, chosen_axes(recording, axis), parsed), confidence)
        if json:
            for name, found in fits.items():
                for note in found.diagnostics.notes():
                    tell(told, f"{name}: {note}")
            for name, one in carried.items():
                for note in one.fit.diagnostics.notes():
                    tell(told, f"{name}, by maximum likelihood: {note}")
        with progress("intervals and tests", len(fits)) as advance:
            axes = {}
            for name, f in fits.items():
                axes[name] = as_dict(f, how)
                if name in carried:
                    axes[name]["likelihood"] = likelihood_as_dict(carried[name])
                advance(f"intervals and tests: {name}")
        content = {"file": str(file), "model": str(parsed), "axes": axes}
        written = []
        if output is not None:
            written.append(write_fits(output / "fits.json", content))
            written += [draw({name: f}, output / f"fit_{name}.png", view, datasheet) for name, f in fits.items()]
        if plot is not None:
            written.append(draw(fits, plot, view, datasheet))
        if json:
            print_json("fit", content, told)
            return
        print_fits(fits, how)
        if carried:
            print_likelihoods(carried)
        print_written(written)


def _interval_method(confidence: float, draws: int | None, seed: int) -> IntervalMethod:
    """How intervals and tests are made, and enough simulated records for them."""
    from gmwm.inference.bootstrap import as_draws
    from gmwm.inference.summary import IntervalMethod

    how = IntervalMethod(confidence)
    if draws is None:
        return how
    as_draws(draws, how.least_draws, f"a test at 5 % with intervals of {100 * confidence:g} %", "--bootstrap")
    return IntervalMethod(confidence, "bootstrap", draws, seed)


def fit_axes(
    models: Mapping[str, Any],
    signals: Mapping[str, Any],
    *,
    weighting: Literal["diagonal", "optimal", "identity"] | None = None,
    robust: bool = False,
    efficiency: float = 0.6,
    certify: bool = True,
    filter: str = "haar",
    transform: Literal["modwt", "dwt"] = "modwt",
    start: Sampled | None = None,
) -> dict[str, Fit]:
    """A fit of each signal with the model of its axis, several at once."""
    import gmwm
    from gmwm.cli.parallel import over_axes

    def measured_and_fitted(signal: Signal | gmwm.WaveletVariance) -> Fit:
        wv = signal
        if not isinstance(wv, gmwm.WaveletVariance):
            wv = gmwm.wavelet_variance(wv, filter=filter, transform=transform, robust=robust, efficiency=efficiency)
        return gmwm.fit(models[signal.axis], wv, weighting=weighting, certify=certify, start=start)

    return over_axes(measured_and_fitted, signals, "fitting")


def draw(fits: Mapping[str, Fit], path: Path, view: Literal["wavelet", "allan"], datasheet: bool) -> Path:
    """A picture of one fit with its terms in words, or of several in a grid."""
    from gmwm.cli.output import progress
    from gmwm.plots.imu import plot_imu

    with progress(f"drawing {path.name}"):
        if len(fits) == 1:
            next(iter(fits.values())).plot(view=view, units="datasheet" if datasheet else "si", path=path)
        else:
            plot_imu(fits, view=view, units="datasheet" if datasheet else "si", path=path)
    return path


def write_fits(path: Path, content: Mapping[str, Any]) -> Path:
    """`content` as a JSON file, with the version of the package."""
    from gmwm._files import write_text
    from gmwm.cli.output import json_text

    write_text(path, json_text("fit", content) + "\n")
    return path


def as_dict(fit: Fit, how: IntervalMethod) -> dict[str, Any]:
    """A fit with its intervals and test as plain numbers, lists and texts."""
    from gmwm.inference.summary import inference

    return fit.to_dict() | inference(fit, how)


def print_fits(fits: Mapping[str, Fit], how: IntervalMethod) -> None:
    """The summary of one fit, or a table for each sensor with its axes side by side."""
    from gmwm.calibration.tables import wrapped
    from gmwm.inference.summary import intervals_if_known, notes
    from gmwm.signals import by_sensor

    if len(fits) == 1:
        print(next(iter(fits.values())).summary(how.level, how.method, draws=how.draws, seed=how.seed))
        return
    first = next(iter(fits.values()))
    wv = first.wavelet_variance
    robust = f"robust with efficiency {wv.efficiency:g}, " if wv.robust else ""
    print(f"{first.model.structure}, {wv.extent}, {robust}weighting {first.weighting}")
    sensors = by_sensor(fits)
    for group in sensors.values():
        _print_sensor(group, how)
    print(
        f"\n±: one relative standard error; ≤: upper limit at {50 + 50 * how.level:g} %; p: of a worse fit\n"
        "if the model is right. Confidence intervals: one --axis alone, or --json."
    )
    told = [
        f"{name}: {note}" for name, found in fits.items() for note in notes(found, intervals_if_known(found, how)[1])
    ]
    if told:
        print("\n".join(["", *(line for text in told for line in wrapped(text))]))


def _print_sensor(group: Mapping[str, Fit], how: IntervalMethod) -> None:
    from gmwm.cli.output import print_table, print_units
    from gmwm.inference.summary import short_values, test_in_words

    first = next(iter(group.values()))
    units = first.units()
    values = [short_values(found, how) for found in group.values()]
    rows = [[name, *(shown[name] for shown in values)] for name in first.parameters]
    last = len(rows) - 1
    tests = [test_in_words(found, how)[0] for found in group.values()]
    rows.append(["p of the fit", *("not tested" if t is None else t.pvalue_in_words for t in tests)])
    rows.append(["objective", *(f"{found.objective:.5g}" for found in group.values())])
    rows.append(["gain at most", *_gains(list(group.values()))])
    print()
    print_table(["parameter", *group], rows, rules=[last])
    print_units(units)


def _gains(fits: Sequence[Fit]) -> list[str]:
    return ["no proof" if found.gap is None else f"{100 * found.gap:.2g} %" for found in fits]
