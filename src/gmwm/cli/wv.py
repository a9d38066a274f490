"""gmwm wv: the wavelet variance of a recording, as table, CSV, picture or JSON."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gmwm.cli.measuring import Chunked, Scheduler, Workers, curves_and_cautions, needs_memory, opened
from gmwm.cli.options import RESULT, Datasheet, Efficiency, Filter, Json, Robust, TransformName, View, chosen_efficiency
from gmwm.cli.read_options import Axes, File, Opening, chosen_axes, chosen_names, opens

if TYPE_CHECKING:
    from gmwm.plots.view import UnitSystem, ViewName
    from gmwm.variance.result import WaveletVariance

EXAMPLES = (
    "gmwm wv static.csv --plot wv.png",
    "gmwm wv static.csv --axis gyro --view allan --datasheet",
    "gmwm wv static.csv --robust",
    "gmwm wv static.csv --filter la8 --transform dwt",
)


@opens
def wv(
    file: File,
    opening: Opening,
    axis: Axes = None,
    filter: Filter = "haar",
    transform: TransformName = "modwt",
    robust: Robust = False,
    efficiency: Efficiency = None,
    chunked: Chunked = "auto",
    scheduler: Scheduler = None,
    workers: Workers = None,
    view: View = "wavelet",
    datasheet: Datasheet = False,
    csv: Annotated[
        Path | None,
        typer.Option(help="Write every level of every axis to this CSV file (SI units).", rich_help_panel=RESULT),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw to this .png, .pdf or .svg file.", rich_help_panel=RESULT)
    ] = None,
    overlay: Annotated[
        bool,
        typer.Option(
            "--overlay",
            help="In the picture, lay x, y and z of a sensor over one another.",
            rich_help_panel=RESULT,
        ),
    ] = False,
    json: Json = False,
) -> None:
    """Print the wavelet variance of each axis, or its Allan deviation.

    The scale of level j is τ = 2^j samples. Twice the wavelet variance at scale τ is the Allan variance at
    averaging time τ/2. Limits are 95 % chi-square.

    The robust one leaves outliers out of account, 1 % of bad samples up to level 4 or so: each spoils 2^j
    coefficients of level j. Where more than half of the coefficients are zero, as at fine levels of a coarsely
    quantised sensor, it may be zero, and says so. gmwm compare draws both over one another.
    """
    from gmwm import wavelet_variance
    from gmwm.cli.output import print_json, print_written, progress, tell, tell_cautions, told_warnings
    from gmwm.cli.parallel import over_axes
    from gmwm.readers.streams import Stream

    with told_warnings() as told:
        recording = opened(
            file, opening, chunked, spread=scheduler is not None or workers is not None,
            whole=needs_memory(filter, transform),
        )  # fmt: skip
        chosen, strength = chosen_names(recording.axes, axis), chosen_efficiency(robust, efficiency)
        if isinstance(recording, Stream):
            results, seen = curves_and_cautions(
                recording, chosen, robust=robust, efficiency=strength, scheduler=scheduler, workers=workers
            )
            for warning in seen:
                tell(told, warning)
        else:
            measure = partial(
                wavelet_variance, filter=filter, transform=transform, robust=robust, efficiency=strength
            )  # fmt: skip
            results = over_axes(measure, chosen_axes(recording, axis), "wavelet variance")
            tell_cautions(told, recording)
        for name, result in results.items():
            for note in result.notes():
                tell(told, f"{name}: {note}")
        system: UnitSystem = "datasheet" if datasheet else "si"
        if csv is not None:
            _write_csv(csv, results)
        if plot is not None:
            from gmwm.plots.imu import plot_imu

            with progress("drawing"):
                if len(results) == 1:
                    next(iter(results.values())).plot(view=view, units=system, path=plot)
                else:
                    plot_imu(results, split=not overlay, view=view, units=system, path=plot)
        if json:
            curves = {name: result.to_dict() for name, result in results.items()}
            print_json("wv", {"file": str(file), "axes": curves}, told)
            return
        _print_curves(results, view, system)
        print_written([path for path in (csv, plot) if path is not None])


def _print_curves(results: Mapping[str, WaveletVariance], view: ViewName, system: UnitSystem) -> None:
    """One axis with its limits, or all of a sensor side by side."""
    from gmwm.cli.output import print_table
    from gmwm.plots.view import view_of
    from gmwm.signals import by_sensor

    sensors = by_sensor(results)
    first = next(iter(results.values()))
    alone = any(len(group) == 1 for group in sensors.values())
    limits = f", {100 * first.confidence:g} % limits" if alone else ""
    robust = f", robust with efficiency {first.efficiency:g}" if first.robust else ""
    transform = "" if (first.filter, first.transform) == ("haar", "modwt") else f", {first.filter} {first.transform}"
    print(f"{first.extent}{transform}{robust}{limits}")
    # A deviation in deg/h or mg has a size that reads better without an exponent.
    style = "#.5g" if view == "allan" and system == "datasheet" else ".4e"
    for group in sensors.values():
        one = next(iter(group.values()))
        shown = view_of(one.unit, view, system)
        if len(group) == 1:
            heads = ["lower", next(iter(group)), "upper"]
            curves = [one.lower, one.variance, one.upper]
        else:
            heads, curves = list(group), [result.variance for result in group.values()]
        heights = [shown.height(curve) for curve in curves]
        rows = [
            [f"{j}", f"{t:.6g}", *(f"{curve[k]:{style}}" for curve in heights), f"{m}"]
            for k, (j, t, m) in enumerate(zip(one.levels, shown.time(one.tau), one.counts, strict=True))
        ]
        print()
        print_table(["level", "τ (s)", *heads, "coefficients"], rows, title=shown.height_label, texts=0)


def _write_csv(path: Path, results: Mapping[str, WaveletVariance]) -> None:
    """One line for each level of each axis; the deviation and its time are Allan's."""
    from gmwm._files import write_text
    from gmwm.plots.view import view_of

    lines = ["axis,unit,level,scale_samples,tau_s,variance,lower,upper,coefficients,averaging_time_s,allan_deviation"]
    for name, result in results.items():
        allan = view_of(result.unit, "allan", "si")
        columns = zip(
            result.levels, result.scales, result.tau, result.variance, result.lower, result.upper, result.counts,
            allan.time(result.tau), allan.height(result.variance), strict=True,
        )  # fmt: skip
        lines += [",".join([name, result.unit, *(str(value.item()) for value in row)]) for row in columns]
    write_text(path, "\n".join(lines) + "\n")
