"""gmwm watch: show the curves and estimates of a recording while it is written."""

from __future__ import annotations

import math
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gmwm
from gmwm.base.errors import FitWarning, GmwmError, OptionError
from gmwm.base.remarks import Remark
from gmwm.base.text import duration_text
from gmwm.base.time_base import parse_length, parse_share
from gmwm.base.units import by_sensor
from gmwm.cli.command import command, with_settings
from gmwm.cli.measuring import growing_source, interruptible, remarks_on_end
from gmwm.cli.output import Outcome, table_text
from gmwm.cli.read_options import ReadOptionTexts, chosen_names
from gmwm.recording.chunks import MINIMUM_SAMPLES, Chunk

if TYPE_CHECKING:
    from rich.text import Text

    from gmwm.files.readers.streams import Stream


def fit_curves(
    model: gmwm.Model | None, curves: Mapping[str, gmwm.WaveletVariance]
) -> tuple[dict[str, gmwm.Fit], dict[str, str]]:
    """Fit a model to each axis's wavelet variance; return fits, and reasons of failures, empty without model."""
    fits: dict[str, gmwm.Fit] = {}
    failed: dict[str, str] = {}
    if model is None:
        return fits, failed
    for axis, curve in curves.items():
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", FitWarning)
                fits[axis] = gmwm.fit(model, curve, certify=False)
        except GmwmError as error:
            failed[axis] = error.reason
    return fits, failed


def _needed_durations(fit: gmwm.Fit, accuracy: float) -> dict[str, float | None]:
    """Return the recording duration (s) at which each parameter reaches an accuracy; None if unknown or infinite."""
    wv = fit.wavelet_variance
    present = tuple(process for process in fit.model.processes if process.scale > 0)
    try:
        now = wv.samples / wv.rate
        needed = gmwm.plan(gmwm.Model(present), duration=now, rate=wv.rate).needed(accuracy) if present else {}
    except GmwmError:
        needed = {}
    return {name: (seconds if seconds < float("inf") else None) for name, seconds in needed.items()}


def _errors(fit: gmwm.Fit) -> dict[str, float]:
    """Return the relative standard error of each parameter; an empty mapping if they cannot be computed."""
    try:
        errors = fit.standard_errors
    except GmwmError:
        return {}
    return {name: error / abs(fit.parameters[name]) for name, error in errors.items() if fit.parameters[name]}


def whole_text(
    curves: Mapping[str, gmwm.WaveletVariance], fits: Mapping[str, gmwm.Fit], failed: Mapping[str, str],
    accuracy: float, datasheet: bool, live: bool = False,
) -> str:  # fmt: skip
    """Format the complete status: a table of deviations for each sensor, and a table of estimates for each axis."""
    from gmwm.showing.plots.labels import view_of

    first = next(iter(curves.values()))
    parts = [f"{first.extent}: {duration_text(first.samples / first.rate)}"]
    sensors = by_sensor(curves)
    for group in sensors.values():
        leading = next(iter(group.values()))
        shown = view_of(leading.unit, "allan", "datasheet" if datasheet else "si")
        heights = [shown.height(curve.variance) for curve in group.values()]
        rows = [
            [f"{t:.6g}", *(f"{h[k]:.3e}" for h in heights), f"{100 * e:.2g} %"]
            for k, (t, e) in enumerate(zip(shown.time(leading.tau), _relative(leading), strict=True))
        ]
        parts.append(table_text(["τ (s)", *group, "±"], rows, title=shown.height_label, texts=0))
    answers = [_estimates(axis, fit, accuracy) for axis, fit in fits.items()]
    answers += [f"{axis}: not fitted: {reason}" for axis, reason in failed.items()]
    # A terminal cuts a live view at its height, so the most important part comes first.
    return "\n\n".join([parts[0], *answers, *parts[1:]] if live else [*parts, *answers])


def _relative(wv: gmwm.WaveletVariance) -> Any:
    """Return the relative error ½ √(2/η) of the deviation by scale, whose square is χ² with η degrees of freedom."""
    return 0.5 * (2.0 / wv.degrees_of_freedom) ** 0.5


def _estimates(axis: str, fit: gmwm.Fit, accuracy: float) -> str:
    """Format the estimates of an axis as a table, with intervals and whether the recording is long enough."""
    from gmwm.fitting.estimation.summary import IntervalMethod, intervals_if_known, rows

    errors, needed = _errors(fit), _needed_durations(fit, accuracy)
    now = fit.wavelet_variance.samples / fit.wavelet_variance.rate
    lines = []
    for row in rows(fit, intervals_if_known(fit, IntervalMethod())[0], IntervalMethod()):
        error, least = errors.get(row.name), needed.get(row.name)
        if row.name in fit.model.fixed_names:
            enough = ""
        elif error is None or not math.isfinite(error):
            enough = "unknown"
        elif error <= accuracy:
            enough = "yes"
        else:
            enough = "no" if least is None or least <= now else f"at {duration_text(least)}"
        lines.append([row.name, row.estimate, row.interval, row.error, enough, row.unit])
    heads = ["parameter", "estimate", "95 % interval", "error", f"{100 * accuracy:g} %?", "unit"]
    return table_text(heads, lines, title=f"{axis}: {fit.model.structure}")


def one_line_of(
    curves: Mapping[str, gmwm.WaveletVariance], fits: Mapping[str, gmwm.Fit], failed: Mapping[str, str],
    accuracy: float, datasheet: bool,
) -> str:  # fmt: skip
    """Format the status in one line: the duration, and for each axis the estimates, or deviations without a model."""
    from gmwm.fitting.estimation.summary import IntervalMethod, short_values
    from gmwm.showing.plots.labels import view_of

    first = next(iter(curves.values()))
    parts = [f"{duration_text(first.samples / first.rate)}, {first.samples} samples"]
    for axis, curve in curves.items():
        if axis in fits:
            texts, units = short_values(fits[axis], IntervalMethod()), fits[axis].units()
            values = ", ".join(f"{name} {_with_unit(value, units[name])}" for name, value in texts.items())
            errors = _errors(fits[axis])
            free = [name for name in fits[axis].parameters if name not in fits[axis].model.fixed_names]
            inaccurate = ", ".join(name for name in free if not errors.get(name, math.inf) <= accuracy)
            share = f"{100 * accuracy:g} %"
            parts.append(
                f"{axis}: {values}; {f'not yet {share}: {inaccurate}' if inaccurate else f'all within {share}'}"
            )
        elif axis in failed:
            parts.append(f"{axis}: not fitted: {failed[axis]}")
        else:
            shown = view_of(curve.unit, "allan", "datasheet" if datasheet else "si")
            heights, times = shown.height(curve.variance), shown.time(curve.tau)
            k = int(heights.argmin())
            error = f"{100 * _relative(curve)[k]:.2g} %"
            first_height, least = (_with_unit(f"{heights[place]:.4g}", shown.unit) for place in (0, k))
            parts.append(f"{axis}: {first_height} at {times[0]:.3g} s, least {least} ± {error} at {times[k]:.3g} s")
    return " | ".join(parts)


def _with_unit(text: str, unit: str) -> str:
    """Return the text of a number with the unit before its error; words such as "fixed" stay as they are."""
    number, plus_minus, error = text.partition(" ± ")
    return f"{number} {unit}".rstrip() + plus_minus + error if number[-1].isdigit() else text


def as_dicts(
    curves: Mapping[str, gmwm.WaveletVariance], fits: Mapping[str, gmwm.Fit], accuracy: float
) -> dict[str, dict[str, Any]]:
    """Return the wavelet variance, fit, relative errors and needed duration of each axis as plain values for JSON."""
    from gmwm.fitting.estimation.summary import IntervalMethod, inference

    out = {}
    for axis, curve in curves.items():
        out[axis] = {"wavelet_variance": curve.to_dict()}
        if axis in fits:
            fit = fits[axis]
            out[axis]["fit"] = fit.to_dict() | inference(fit, IntervalMethod())
            out[axis]["relative_errors"] = _errors(fit)
            out[axis]["needed"] = _needed_durations(fit, accuracy)
    return out


EXAMPLES = (
    "gmwm watch log.csv --axis gyro",
    'gmwm watch log.csv --model "GM + WN" --axis gyro_x --accuracy 10%',
    "logger | gmwm watch - --rate 200 --units gyro=deg/s --columns gyro_x,gyro_y",
)


@command
def watch(
    file: str,
    rate: float | None = None,
    units: str | None = None,
    columns: str | None = None,
    scale: str | None = None,
    increments: str | None = None,
    mount: str | None = None,
    axis: list[str] | None = None,
    model: str | None = None,
    accuracy: str = "0.1",
    every: str = "5s",
    idle: str | None = None,
    datasheet: bool = False,
    json: bool = False,
) -> Outcome:
    """Watch a recording while it is written, and show when it is long enough.

    The command shows the Allan deviation of each axis with its standard error. With --model, it also shows the
    parameter estimates, their standard errors, and the time to record for the desired accuracy. A terminal shows a live
    view; a file or pipe gets one line for each update. The complete table is printed at the end: after Ctrl-C, at the
    end of standard input, or after the time of --idle.

    The file must be text that grows line by line. An incomplete line is read when it is complete. If the file is
    truncated or replaced, the command stops and prints the result up to that time.

    Arguments:
        file (FILE|-): Text file that is being written, or - for standard input.
    Options:
        model (--model, -m MODEL): Sum of processes, as for gmwm fit. It is fitted again at each update.
        accuracy (SHARE): Desired relative standard error, as 0.1 or 10%; at most 0.5.
        every (LENGTH): Time between updates, such as 5s or 1min.
    Result:
        datasheet: Use deg/h and mg instead of rad/s and m/s²."""
    from gmwm.files.readers.growing_files import Lines, growing_stream
    from gmwm.fitting.inference.planning import as_accuracy
    from gmwm.measuring.streaming.passes import accumulators

    seconds, patience = parse_length(every, "every"), None if idle is None else parse_length(idle, "idle")
    share = as_accuracy(parse_share(accuracy))
    parsed = None if model is None else gmwm.Model.parse(model)
    if seconds <= 0:
        raise OptionError(argument="every", expected="longer than 0 s", got=every)
    texts = {
        "rate": rate, "units": units, "columns": columns, "scale": scale, "increments": increments, "mount": mount,
    }  # fmt: skip
    reading = ReadOptionTexts(**with_settings(texts, Path.cwd())).parse()
    with growing_source(file) as (take, name), interruptible() as stopped:
        view = _StatusDisplay(
            every=seconds, stopped=stopped, model=parsed, accuracy=share, datasheet=datasheet, json=json
        )
        lines = Lines(take, view.breathe, patience)
        source = growing_stream(lines, name, reading, patience=min(seconds, 5.0))
        measured = accumulators(source, chosen_names(source.axes, axis))
        failure = _feed(source, measured, view)
    curves = {axis_name: accumulator.result() for axis_name, accumulator in measured.items()}
    fits, failed = fit_curves(parsed, curves)
    return Outcome(
        command="watch", document={"file": file, "accuracy": share, "axes": as_dicts(curves, fits, share)},
        text=whole_text(curves, fits, failed=failed, accuracy=share, datasheet=datasheet),
        remarks=(
            *remarks_on_end(take, name, lines),
            *(Remark.of("not-calibrated", axis, case="fit", reason=reason) for axis, reason in failed.items()),
        ), failure=failure,
    )  # fmt: skip


def _feed(source: Stream, measured: Mapping[str, gmwm.WaveletAccumulator], view: _StatusDisplay) -> GmwmError | None:
    """Feed the accumulators until the source ends; return its error or None, raised if samples are too few."""
    from gmwm.measuring.streaming.passes import feed_chunks

    failures: list[GmwmError] = []

    def chunks() -> Iterator[Chunk]:
        try:
            yield from source
        except KeyboardInterrupt:
            pass  # Polars handles Ctrl-C itself while it reads, and raises this. It ends the watch without an error.
        except GmwmError as error:
            failures.append(error)

    with view.show_during(measured), suppress(KeyboardInterrupt):
        feed_chunks(chunks(), measured)
    if failures and not all(len(accumulator) >= MINIMUM_SAMPLES for accumulator in measured.values()):
        raise failures[0]
    return failures[0] if failures else None


class _StatusDisplay:
    """The status display of a running watch. It shows the status at regular times, on a terminal or in lines."""

    def __init__(
        self, every: float, stopped: Callable[[], bool], model: gmwm.Model | None, accuracy: float, datasheet: bool,
        json: bool,
    ) -> None:  # fmt: skip
        self._every, self._stopped = every, stopped
        self._model, self._accuracy, self._datasheet = model, accuracy, datasheet
        self._out = sys.stderr if json else sys.stdout
        self._measured: Mapping[str, gmwm.WaveletAccumulator] = {}
        self._update: Callable[[str], None] = lambda text: None
        self._shown = time.monotonic()
        self._samples = 0

    def breathe(self) -> bool:
        """Update the display if the time between updates has passed. Returns False if the user pressed Ctrl-C."""
        now = time.monotonic()
        if self._measured and now - self._shown >= self._every:
            self._show()
            self._shown = time.monotonic()
        return not self._stopped()

    @contextmanager
    def show_during(self, measured: Mapping[str, gmwm.WaveletAccumulator]) -> Iterator[None]:
        """Show the status of these accumulators while the block runs: live on a terminal, otherwise in lines."""
        self._measured = measured
        if not self._out.isatty():
            self._update = lambda text: print(text, file=self._out, flush=True)
            yield
            return
        from rich.console import Console
        from rich.live import Live
        from rich.text import Text

        with Live(console=Console(file=self._out), transient=True, auto_refresh=False) as live:
            self._update = lambda text: live.update(_unwrap(Text.from_ansi(text)), refresh=True)
            try:
                yield
            finally:
                # Without this, Rich would print a view that is higher than the terminal once more before removing it.
                live.update(Text(""), refresh=True)

    def _show(self) -> None:
        samples = len(next(iter(self._measured.values())))
        if samples == self._samples:
            return
        self._samples = samples
        try:
            curves = {axis_name: accumulator.result() for axis_name, accumulator in self._measured.items()}
        except GmwmError:
            return  # too few samples yet
        fits, failed = fit_curves(self._model, curves)
        live = self._out.isatty()
        self._update(
            whole_text(curves, fits, failed=failed, accuracy=self._accuracy, datasheet=self._datasheet, live=True)
            if live
            else one_line_of(curves, fits, failed=failed, accuracy=self._accuracy, datasheet=self._datasheet)
        )


def _unwrap(text: Text) -> Text:
    text.no_wrap = True
    return text
