"""gmwm wv: wavelet variance of a recording as a table, CSV, plot or JSON."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import gmwm
from gmwm.base.units import by_sensor
from gmwm.cli.command import command
from gmwm.cli.measuring import needs_memory, open_recording, stream_curves, tell_inspection
from gmwm.cli.options import Chunked, Transform, View, chosen_efficiency, picture_units, unit_system
from gmwm.cli.output import Outcome, csv_file, over_axes, plot_file, table_text
from gmwm.cli.read_options import chosen_axes, chosen_names
from gmwm.recording.options import ReadOptions

if TYPE_CHECKING:
    from gmwm.files.readers.streams import Stream
    from gmwm.showing.plots.labels import UnitSystem, ViewName

EXAMPLES = (
    "gmwm wv static.csv --plot wv.png", "gmwm wv static.csv --axis gyro --view allan --datasheet",
    "gmwm wv static.csv --robust", "gmwm wv static.csv --filter la8 --transform dwt",
)  # fmt: skip


@command
def wv(
    file: Path,
    reading: ReadOptions,
    axis: list[str] | None = None,
    filter: str = "haar",
    transform: Transform = "modwt",
    robust: bool = False,
    efficiency: float | None = None,
    chunked: Chunked = "auto",
    scheduler: str | None = None,
    workers: int | None = None,
    view: View | None = None,
    datasheet: bool | None = None,
    csv: Path | None = None,
    plot: Path | None = None,
    overlay: bool = False,
) -> Outcome:
    """Print the wavelet variance of each axis, or its Allan deviation.

    The scale of level j is τ = 2^j samples. Twice the wavelet variance at scale τ is the Allan variance at averaging
    time τ/2. The 95 % confidence intervals come from a chi-square distribution.

    --robust reduces the effect of outliers. If 1 % of the samples are bad, it works up to about level 4, because each
    bad sample affects 2^j coefficients of level j. If more than half of the coefficients are zero, as for a coarsely
    quantized sensor, the robust variance may be zero, and the command prints a warning. gmwm compare plots the
    classical and the robust variance.

    Estimation:
        filter: Wavelet filter: haar, d4 … d16, la8 … la20, fk4 … fk22, bl14, bl20, mb4 … mb24, or a name of PyWavelets.
    Result:
        csv: Write all levels of all axes to this CSV file (SI units).
        overlay: Plot the axes x, y and z of a sensor in one panel."""
    from gmwm.showing.plots.labels import view_of

    strength = chosen_efficiency(robust, efficiency)
    recording = open_recording(
        file, reading, chunked, spread=scheduler is not None or workers is not None,
        whole=needs_memory(filter, transform),
    )  # fmt: skip
    results = _measure(
        recording, axis, filter=filter, transform=transform, robust=robust, efficiency=strength, scheduler=scheduler,
        workers=workers,
    )  # fmt: skip
    system = unit_system(datasheet)
    heading = "axis,unit,level,scale_samples,tau_s,variance,lower,upper,coefficients,averaging_time_s,allan_deviation"
    allans = {name: view_of(result.unit, "allan", "si") for name, result in results.items()}
    tables = [
        ((name, r.unit), (r.levels, r.scales, r.tau, r.variance, r.lower, r.upper, r.counts, allans[name].time(r.tau),
                          allans[name].height(r.variance)))
        for name, r in results.items()
    ]  # fmt: skip
    return Outcome(
        command="wv",
        document={"file": str(file), "axes": {name: result.to_dict() for name, result in results.items()}},
        text=_curves_text(results, view or "wavelet", system),
        files=csv_file(csv, heading, tables)
        + plot_file(plot, partial(_draw, results, view or "auto", picture_units(datasheet), overlay)),
        remarks=tuple(remark.about(name) for name, result in results.items() for remark in result.remarks),
    )


def _measure(
    recording: gmwm.Imu | Stream, axis: list[str] | None, *, filter: str, transform: Literal["modwt", "dwt"],
    robust: bool, efficiency: float, scheduler: str | None, workers: int | None,
) -> dict[str, gmwm.WaveletVariance]:  # fmt: skip
    """Compute the wavelet variance of each axis. The remarks of the inspection become warnings of the command."""
    from gmwm.files.readers.streams import Stream

    chosen = chosen_names(recording.axes, axis)
    if isinstance(recording, Stream):
        return stream_curves(
            recording, chosen, robust=robust, efficiency=efficiency, scheduler=scheduler, workers=workers
        )
    measure = partial(gmwm.wavelet_variance, filter=filter, transform=transform, robust=robust, efficiency=efficiency)
    results = over_axes(measure, chosen_axes(recording, axis), "wavelet variance")
    tell_inspection(recording)
    return results


def _draw(
    results: Mapping[str, gmwm.WaveletVariance], view: ViewName, system: UnitSystem, overlay: bool, path: Path
) -> None:
    from gmwm.showing.plots.imu import plot_imu

    if len(results) == 1:
        next(iter(results.values())).plot(view=view, units=system, path=path)
    else:
        plot_imu(results, split=not overlay, view=view, units=system, path=path)


def _curves_text(results: Mapping[str, gmwm.WaveletVariance], view: ViewName, system: UnitSystem) -> str:
    """Format a table for each sensor: several axes side by side, or one axis with its confidence intervals."""
    from gmwm.showing.plots.labels import view_of

    sensors = by_sensor(results)
    first = next(iter(results.values()))
    alone = any(len(group) == 1 for group in sensors.values())
    limits = f", {100 * first.confidence:g} % confidence intervals for any noise" if alone else ""
    limits += ' (for the identified noise: "gmwm allan")' if alone and view == "allan" else ""
    robust = f", robust with efficiency {first.efficiency:g}" if first.robust else ""
    transform = "" if (first.filter, first.transform) == ("haar", "modwt") else f", {first.filter} {first.transform}"
    parts = [f"{first.extent}{transform}{robust}{limits}"]
    # Deviations in deg/h and mg are neither very small nor very large, so they are easier to read without exponents.
    style = "#.5g" if view == "allan" and system == "datasheet" else ".4e"
    for group in sensors.values():
        leading = next(iter(group.values()))
        shown = view_of(leading.unit, view, system)
        if len(group) == 1:
            heads = ["lower", next(iter(group)), "upper"]
            curves = [leading.lower, leading.variance, leading.upper]
        else:
            heads, curves = list(group), [result.variance for result in group.values()]
        heights = [shown.height(curve) for curve in curves]
        rows = [
            [f"{j}", f"{t:.6g}", *(f"{curve[k]:{style}}" for curve in heights), f"{m}"]
            for k, (j, t, m) in enumerate(zip(leading.levels, shown.time(leading.tau), leading.counts, strict=True))
        ]
        parts.append(table_text(["level", "τ (s)", *heads, "coefficients"], rows, title=shown.height_label, texts=0))
    return "\n\n".join(parts)
