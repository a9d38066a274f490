"""gmwm allan: Allan, Hadamard and total deviations of a recording as a table, CSV, plot or JSON."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import gmwm
from gmwm.base.errors import OptionError
from gmwm.base.units import by_sensor
from gmwm.cli.command import command
from gmwm.cli.options import picture_units, unit_system
from gmwm.cli.output import Outcome, csv_file, over_axes, plot_file, progress, table_text
from gmwm.cli.read_options import chosen_axes, load
from gmwm.recording.options import ReadOptions

if TYPE_CHECKING:
    from gmwm.measuring.variance.allan_regression import AllanRegression
    from gmwm.measuring.variance.clusters import ClusterVariance
    from gmwm.showing.plots.labels import UnitSystem

EXAMPLES = (
    "gmwm allan static.csv --datasheet --plot allan.png",
    "gmwm allan static.csv --kind hadamard --axis gyro",
    "gmwm allan static.csv --axis gyro_x --slopes --plot slopes.png",
)

Kind = Literal["overlapping", "nonoverlapping", "modified", "hadamard", "nonoverlapping-hadamard", "total"]


@command
def allan(
    file: Path,
    reading: ReadOptions,
    axis: list[str] | None = None,
    kind: Kind = "overlapping",
    clusters: Literal["octave", "decade", "all"] = "octave",
    slopes: bool = False,
    datasheet: bool | None = None,
    csv: Path | None = None,
    plot: Path | None = None,
) -> Outcome:
    """Print the Allan deviation of each axis, with confidence intervals and the dominant noise type.

    The samples are angular rates and specific forces. The 95 % confidence intervals come from a chi-square
    distribution, whose degrees of freedom depend on the dominant noise type at each averaging time.

    Estimation:
        kind: Estimator: overlapping, nonoverlapping or modified Allan variance; Hadamard variance, which a linear drift
            does not affect; or total variance, which has more degrees of freedom at long averaging times.
        clusters: Cluster sizes: 1, 2, 4, 8 … (octave); 1, 2, 4, 10, 20, 40 … (decade); or every size (all). The time
            for all sizes is proportional to the square of the number of samples.
    Result:
        slopes: Estimate Q, N, B, K and R from the slopes of the Allan deviation.
        csv: Write all values of all axes to this CSV file (SI units)."""
    if slopes and kind not in ("overlapping", "nonoverlapping", "total"):
        raise OptionError(
            f"--slopes needs an Allan deviation, not --kind {kind}", argument="kind", got=kind,
            advice="Use {--kind=overlapping}.",
        )  # fmt: skip
    imu = load(file, reading)

    results = _measure(chosen_axes(imu, axis), kind, clusters)
    regressions = {name: gmwm.avlr(result) for name, result in results.items()} if slopes else {}
    system = unit_system(datasheet)
    heading = "axis,unit,cluster_samples,tau_s,deviation,lower,upper,variance,differences,degrees_of_freedom,noise"
    tables = [
        ((name, r.unit), (r.clusters, r.tau, r.deviation, r.lower_deviation, r.upper_deviation, r.variance, r.counts,
                          r.degrees_of_freedom, r.noise))
        for name, r in results.items()
    ]  # fmt: skip
    slope_documents = {
        name: {key: value for key, value in regression.to_dict().items() if key != "allan"}
        for name, regression in regressions.items()
    }
    curves = {name: result.to_dict() for name, result in results.items()}
    return Outcome(
        command="allan",
        document={"file": str(file), "kind": kind, "axes": curves, **({"slopes": slope_documents} if slopes else {})},
        text="\n\n".join(
            [_curves_text(results, system), *(regression.summary(system) for regression in regressions.values())]
        ),
        files=csv_file(csv, heading, tables)
        + plot_file(plot, partial(_draw, results, regressions, picture_units(datasheet))),
    )


def _measure(
    signals: Mapping[str, gmwm.Signal], kind: Kind, clusters: Literal["octave", "decade", "all"]
) -> dict[str, ClusterVariance]:
    """Compute the variance of each signal. If all cluster sizes are asked for, first print the expected time."""
    if clusters != "all":
        return over_axes(lambda signal: _variance(signal, kind, clusters), signals, f"{kind} variance")
    first = next(iter(signals.values()))
    sizes = len(first) // 2
    octaves = _variance(first, kind, "decade").clusters.size
    start = time.perf_counter()
    _variance(first, kind, "decade")
    seconds = (time.perf_counter() - start) / octaves / 2 * sizes * len(signals)
    print(
        f"up to {sizes} cluster sizes for each of {len(signals)} axes: about {max(seconds, 1):.0f} s. Ctrl-C stops.",
        file=sys.stderr,
    )
    results = {}
    for name, signal in signals.items():
        with _bar(name) as advance:
            results[name] = _variance(signal, kind, "all", advance)
    return results


def _variance(
    signal: gmwm.Signal, kind: Kind, clusters: Literal["octave", "decade", "all"],
    progress: Callable[[int, int], object] | None = None,
) -> ClusterVariance:  # fmt: skip
    if kind == "total":
        return gmwm.total_variance(signal, clusters=clusters, progress=progress)
    if kind == "hadamard":
        return gmwm.hadamard_variance(signal, clusters=clusters, progress=progress)
    if kind == "nonoverlapping-hadamard":
        return gmwm.hadamard_variance(signal, kind="nonoverlapping", clusters=clusters, progress=progress)
    return gmwm.allan_variance(signal, kind=kind, clusters=clusters, progress=progress)


@contextmanager
def _bar(name: str) -> Iterator[Callable[[int, int], None]]:
    """Show a progress bar of one axis; the yielded function takes numbers of finished and all cluster sizes."""
    with progress(name, 100) as step:
        moved = 0

        def advance(done: int, every: int) -> None:
            nonlocal moved
            while moved < 100 * done // max(every, 1):
                moved += 1
                step(f"{name}: cluster {done} of {every}")

        yield advance


def _draw(
    results: Mapping[str, ClusterVariance], regressions: Mapping[str, AllanRegression], system: UnitSystem, path: Path
) -> None:
    from gmwm.showing.plots.allan import plot_allan_axes

    if len(results) > 1:
        plot_allan_axes(regressions or results, units=system, path=path)
        return
    for result in regressions.values() or results.values():
        result.plot(units=system, path=path)


def _curves_text(results: Mapping[str, ClusterVariance], system: UnitSystem) -> str:
    """Format a table for each sensor: several axes side by side, or one axis with its intervals and noise types."""
    from gmwm.showing.plots.allan import cluster_view

    sensors = {sensor: list(group.values()) for sensor, group in by_sensor(results).items()}
    first = next(iter(results.values()))
    alone = any(len(group) == 1 for group in sensors.values())
    limits = f", {100 * first.confidence:g} % confidence intervals for the identified noise" if alone else ""
    head = f"{first.samples} samples at {first.rate:g} Hz{limits}"
    style = "#.5g" if system == "datasheet" else ".4e"
    shown = list(range(len(first)))
    if len(first) > 100:  # a long table (--clusters all) shows octaves only
        shown = [n - 1 for n in (2**k for k in range(len(first).bit_length())) if n <= len(first)]
        head += f"\n{len(first)} cluster sizes. The table shows octaves; --csv writes all."
    parts = [head]
    for group in sensors.values():
        leading = group[0]
        view = cluster_view(leading, system)
        if len(group) == 1:
            heads, curves = (
                ["lower", leading.axis or "value", "upper"],
                [leading.lower, leading.variance, leading.upper],
            )
        else:
            heads, curves = [curve.axis for curve in group], [curve.variance for curve in group]
        heights = [view.height(curve) for curve in curves]
        ends = [
            [f"{leading.degrees_of_freedom[k]:.4g}", leading.noise[k]] if len(group) == 1 else []
            for k in range(len(leading))
        ]
        rows = [
            [f"{leading.clusters[k]}", f"{leading.tau[k]:.6g}", *(f"{curve[k]:{style}}" for curve in heights), *ends[k]]
            for k in shown
        ]
        columns = ["cluster", "τ (s)", *heads, *(["edf", "noise"] if len(group) == 1 else [])]
        parts.append(table_text(columns, rows, title=view.height_label, texts=0))
    return "\n\n".join(parts)
