"""gmwm track: estimate the bias and the other processes of a model over time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

import gmwm
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.text import counted
from gmwm.base.time_base import parse_length
from gmwm.cli.command import command
from gmwm.cli.measuring import tell_inspection
from gmwm.cli.model_source import AxisModel, axes_of, axis_models, model_source
from gmwm.cli.options import chosen_efficiency, unit_system
from gmwm.cli.output import NewFile, Outcome, file_names, over_axes, plot_file, table_text
from gmwm.cli.read_options import chosen_axes, load, require_one_axis
from gmwm.recording.options import ReadOptions

if TYPE_CHECKING:
    from gmwm.base.arrays import Vector
    from gmwm.fitting.likelihood import Tracks

NUMBERS = ("mean", "rms_about_mean", "rms_error", "first", "first_reach", "last", "last_reach")
"""Numbers that summarize a process, in the unit of the data; a reach is half of the confidence band."""


def as_dict(model: AxisModel, found: Tracks, level: float) -> dict[str, Any]:
    """Return a summary of an axis's tracks and model for JSON; --output writes the complete tracks."""
    return {
        **model.to_dict(), "kind": found.kind, "rate": found.rate, "unit": found.unit, "samples": len(found),
        "missing": _missing(found), "first_time": float(found.times[0]), "last_time": float(found.times[-1]),
        "tracks": {label: _brief(found, label, level) for label in found.labels},
    }  # fmt: skip


def _missing(found: Tracks) -> int:
    return 0 if found.kind == "predict" else int(np.count_nonzero(np.isnan(found.data)))


def _brief(found: Tracks, label: str, level: float) -> dict[str, float | None]:
    """Return a track's `NUMBERS` or None: mean, RMS about it, RMS error, first and last value with half their bands."""
    path, error = found.mean[label], found.error[label]
    finite = np.isfinite(error)
    low, _ = found.band(label, level)
    numbers: dict[str, float] = {}
    for end, at in (("first", 0), ("last", -1)):
        if finite[at]:
            numbers |= {end: float(path[at]), f"{end}_reach": float(path[at] - low[at])}
    if np.any(finite):
        mean, rms = float(np.mean(path[finite])), float(np.std(path[finite]))
        numbers |= {"mean": mean, "rms_about_mean": rms, "rms_error": math.sqrt(np.mean(np.square(error[finite])))}
    return {name: numbers.get(name) for name in NUMBERS}


def tracks_text(name: str, model: AxisModel, found: Tracks, level: float, datasheet: bool) -> str:
    """Format the summary of each process of an axis as a table."""
    from gmwm.showing.plots.labels import view_of

    shown = view_of(found.unit, "allan", "datasheet" if datasheet else "si")
    rows = [_row(label, _brief(found, label, level), found.kind == "predict", shown.factor) for label in found.labels]
    duration = f"{len(found) / found.rate:g} s"
    missing = f", {counted(_missing(found), 'sample')} missing" if _missing(found) else ""
    description = {
        "smooth": f"smoothed over {counted(len(found), 'sample')}, {duration}{missing}",
        "filter": f"filtered over {counted(len(found), 'sample')}, {duration}{missing}",
        "predict": f"predicted for the {duration} after the recording",
    }
    head = f"{name}: {model.values.structure}, values {model.origin}\n{description[found.kind]}, in {shown.unit}"
    reach = f"± {100 * level:g} %"
    middle = ["first", reach] if found.kind == "predict" else ["mean", "rms about mean", "rms error"]
    return f"{head}\n{table_text(['process', *middle, 'last', reach], rows)}"


def _row(label: str, brief: Mapping[str, float | None], ahead: bool, factor: float) -> list[str]:
    """Format a process's row: first and last value of a prediction (`ahead`), or mean, deviation, error and last."""

    def number(key: str) -> str:
        value = brief.get(key)
        if value is None:
            return "unknown"
        # The deviation of a constant process consists of rounding errors only.
        if value <= 1e-9 * (brief["rms_error"] or 0.0):
            return "0"
        return f"{factor * value:.{'3g' if factor * value >= 0.01 else '2e'}}"

    def value_text(key: str, by: str) -> str:
        value, error = brief.get(key), brief.get(by)
        if value is None or error is None:
            return "unknown"
        # If the standard error is zero, the deviation determines the number of digits.
        least = 1e-4 * (brief.get("rms_about_mean") or 0.0)
        return _rounded_to_error(factor * value, factor * max(error, least))

    last = [value_text("last", "last_reach"), number("last_reach")]
    if ahead:
        return [label, value_text("first", "first_reach"), number("first_reach"), *last]
    return [label, value_text("mean", "rms_error"), number("rms_about_mean"), number("rms_error"), *last]


def _rounded_to_error(value: float, error: float) -> str:
    """Format a value with the digits that are significant given its error.

    >>> _rounded_to_error(9.80665123456, 2e-4), _rounded_to_error(-7e-21, 1e-3), _rounded_to_error(1.23456e-4, 1e-4)
    ('9.806651', '0', '1.23e-04')
    """
    if not error:
        return f"{value or 0.0:.3g}"
    # At most six digits, if the error is tiny.
    digits = math.floor(math.log10(abs(value))) if value else 0
    places = min(2 - math.floor(math.log10(error)), 6 - digits)
    value = round(value, places)
    if not value:
        return "0"
    if abs(value) >= 0.01:
        return f"{value:.{max(places, 0)}f}"
    return f"{value:.{max(math.floor(math.log10(abs(value))) + places, 0)}e}"


EXAMPLES = (
    'gmwm track static.csv --model "GM + WN + RW" --axis gyro --output bias.csv',
    "gmwm track static.csv --from-fits fits.json --axis gyro_y --plot bias.png",
    'gmwm track static.csv --model "WN + RW" --axis gyro_x --predict 10min',
)


@command
def track(
    file: Path,
    reading: ReadOptions,
    model: str | None = None,
    from_fits: Path | None = None,
    axis: list[str] | None = None,
    likelihood: bool = False,
    robust: bool = False,
    efficiency: float | None = None,
    kind: Literal["smooth", "filter"] = "smooth",
    predict: str | None = None,
    label: list[str] | None = None,
    confidence: float = 0.95,
    output: Path | None = None,
    plot: Path | None = None,
    datasheet: bool = False,
) -> Outcome:
    """Estimate the bias and every other process of a model over time, with a Kalman filter.

    The result is each process at each sample, with its standard deviation. The bias is the constant level plus all
    processes except white noise and quantization noise. Samples in gaps are missing: the filter predicts across them,
    and the band widens. The band does not include the uncertainty of the parameters.

    Result:
        kind: Estimate each sample from the whole recording (smooth), or from the samples up to it (filter).
        predict (LENGTH): Predict the processes for this time after the end of the recording, such as 90s, 10min, 1h30m
            or a number of seconds, instead of estimating them in it.
        label (LABEL): Process for --output and --plot: bias, level, or a term of the model such as GM[1]. Repeat the
            option for more processes. Default: all processes for --output, the bias for --plot.
        confidence (LEVEL): Level of the confidence bands.
        output (--output, -o): Write the time, the data, and each process with its standard deviation to this .csv or
            .parquet file, in SI units. Missing samples are NaN.
        plot: Plot the data and the processes of one axis, with confidence bands, to this .png, .pdf or .svg file.
        datasheet: Use deg/h and mg instead of rad/s and m/s²."""
    from gmwm.recording.writers import table_path

    source = model_source(
        model, from_fits, likelihood=likelihood, robust=robust, efficiency=chosen_efficiency(robust, efficiency)
    )
    if predict is not None and kind != "smooth":
        raise OptionError(
            "--predict uses the whole recording", argument="kind", got=kind, advice="Leave {--kind=filter} out."
        )
    length = None if predict is None else parse_length(predict, "predict")
    if output is not None:
        table_path(output)
        if output.exists() and output.resolve() == file.resolve():
            raise OptionError(argument="output", expected="another file than FILE", got=str(output))
    imu = load(file, reading)
    signals = axes_of(source, chosen_axes(imu, axis), bool(axis))
    require_one_axis(list(signals), plot)
    tell_inspection(imu)
    models = axis_models(source, signals, file)
    tracks = _tracks(models, signals, kind, length)
    _check_labels(tracks, label or ())
    first, system = next(iter(tracks.values())), unit_system(datasheet)
    files = (
        *(() if output is None else (NewFile(output, partial(_write, tracks, label), f"writing {output.name}"),)),
        *plot_file(plot, lambda path: first.plot(label or None, level=confidence, units=system, path=path)),
    )
    axes = {name: as_dict(models[name], axis_tracks, confidence) for name, axis_tracks in tracks.items()}
    parts = [
        tracks_text(name, models[name], found=axis_tracks, level=confidence, datasheet=datasheet)
        for name, axis_tracks in tracks.items()
    ]
    return Outcome(
        command="track",
        document={"file": str(file), "confidence": confidence, "axes": axes, "written": file_names(files)},
        text="\n\n".join(parts),
        files=files,
        remarks=tuple(remark for name, axis_tracks in tracks.items() for remark in _fast_terms(name, axis_tracks)),
    )


def _tracks(
    models: Mapping[str, AxisModel], signals: Mapping[str, gmwm.Signal], kind: Literal["smooth", "filter"],
    ahead: float | None,
) -> dict[str, Tracks]:  # fmt: skip
    from gmwm.fitting.likelihood import filter_tracks, predict_tracks, smooth_tracks

    def one(signal: gmwm.Signal) -> Tracks:
        model = models[signal.axis].model
        if ahead is not None:
            steps = round(ahead * signal.rate)
            if steps < 1:
                raise OptionError(argument="predict", expected=f"at least {1 / signal.rate:g} s, one sample", got=ahead)
            return predict_tracks(model, signal, steps)
        return smooth_tracks(model, signal) if kind == "smooth" else filter_tracks(model, signal)

    return over_axes(one, signals, "estimating")


def _check_labels(tracks: Mapping[str, Tracks], labels: Sequence[str]) -> None:
    for name, axis_tracks in tracks.items():
        unknown = [label for label in labels if label not in axis_tracks.labels]
        if unknown:
            expected = f"one of {', '.join(axis_tracks.labels)} for {name}"
            raise OptionError(argument="label", expected=expected, got=unknown[0])


def _fast_terms(axis: str, found: Tracks) -> Iterator[Remark]:
    """Yield a remark for each term of the bias that is correlated only over a few samples."""
    from gmwm.fitting.likelihood.tracks import wanders

    for term, process in found.model.by_term.items():
        time = process.correlation_time(found.rate) or 0.0
        # A term with a correlation time below 10 samples is rather noise than bias (tests/cli/test_cli_track.py).
        if process.scale > 0 and wanders(process, found.rate) and time * found.rate < 10.0:
            duration = Quantity(time, "s")
            yield Remark.of("bias-has-noise", axis, term=term, duration=duration, samples=time * found.rate)


def _write(tracks: Mapping[str, Tracks], labels: Sequence[str] | None, path: Path) -> None:
    """Write a table with the time, and for each axis the data and each process with its standard deviation."""
    from gmwm.recording.writers import write_table

    columns: dict[str, Vector] = {"time [s]": next(iter(tracks.values())).times}
    for name, axis_tracks in tracks.items():
        if axis_tracks.kind != "predict":
            columns[f"{name} [{axis_tracks.unit}]"] = axis_tracks.data
        for label in labels or axis_tracks.labels:
            columns[f"{name} {label} [{axis_tracks.unit}]"] = axis_tracks.mean[label]
            columns[f"{name} {label} sd [{axis_tracks.unit}]"] = axis_tracks.error[label]
    write_table(columns, path)
