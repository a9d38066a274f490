"""gmwm monitor: report when a sensor at rest has changed."""

from __future__ import annotations

import json as json_module
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gmwm
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Remark
from gmwm.base.text import counted
from gmwm.base.time_base import parse_length
from gmwm.cli.command import command
from gmwm.cli.measuring import growing_source, interruptible, remarks_on_end
from gmwm.cli.model_source import read_given
from gmwm.cli.output import NewFile, Outcome, calibration_file, file_names, plot_file, tell
from gmwm.cli.read_options import chosen_names, names_of
from gmwm.recording.options import ReadOptions

if TYPE_CHECKING:
    from gmwm.applications.monitor import Baseline, Event, Trace, UnitEvent
    from gmwm.files.readers.streams import Stream

EXAMPLES = (
    "gmwm monitor night.csv --from-fits results --every 30d",
    "logger | gmwm monitor - --rate 100 --from-fits results/calibration.json --json",
    "gmwm monitor log.csv --follow --from-fits results --plot soak.png",
    "gmwm monitor a.csv b.csv c.csv --from-fits results",
    "gmwm monitor unit.bag --from-fits fits.json --reference good.bag --axis gyro",
)


@command
def monitor(
    files: list[str],
    reading: ReadOptions,
    from_fits: Path | None = None,
    source: str | None = None,
    reference: Path | None = None,
    every: str = "30d",
    axis: list[str] | None = None,
    follow: bool = False,
    idle: str | None = None,
    plot: Path | None = None,
    output: Path | None = None,
    json: bool = False,
) -> Outcome:
    """Report when a sensor at rest has changed: noise, level, drift, hum, spikes, frozen values, lost samples.

    The command prints one line for each event as soon as its kind is known. This takes one second after the first
    alarm, and up to a minute for slow changes of the level. With --json, each event is one line of JSON, and the last
    line is a summary.

    Control charts compare the innovations of the calibrated models with a baseline. The sensor must be at rest. If
    three axes change within a second, not by a drift, the monitor assumes that the unit was moved, and the charts pause
    until it is at rest again.

    If three or more recordings are given, the units must be at rest next to each other. The monitor then compares the
    units with each other, which removes disturbances that they share. Each event names the unit that has changed.

    Exit codes: 0 no event, 1 at least one event, 2 error.

    Arguments:
        files (FILE|-…): One recording in any supported format, or - for text on standard input; or the recordings of
            three or more units that were recorded at the same time.
    Options:
        from_fits: Noise models of the sensor: the calibration.json of gmwm calibrate, the fits.json of gmwm fit, or the
            folder of one of them.
        reference: Recording of the healthy sensor at rest, from which the baseline of the control charts is computed.
            Default: the baseline in calibration.json.
        every (LENGTH): Average time between false alarms if the sensor does not change, for all axes together.
        follow: Wait for more data at the end of a text file that is being written.
    Result:
        plot: Plot the signals with the events, and the control charts, to this .png, .pdf or .svg file.
        output (--output, -o): Write a summary to this .html file."""
    patience = None if idle is None else parse_length(idle, "idle")
    seconds = parse_length(every, "every")
    origin = Origin(from_fits, source)
    if len(files) > 1:
        _require_alone(reference=reference, follow=follow, idle=idle, plot=plot, output=output)
        return _side_by_side(files, reading, origin=origin, every=seconds, axes=axis, json=json)
    (file,) = files
    with _open(file, reading, follow, patience) as (stream, ended):
        trace = _trace(
            origin, stream, reference=reference, reading=reading, every=seconds, axes=axis,
            pictures=plot is not None or output is not None, source="standard input" if file == "-" else file,
        )  # fmt: skip
        _print_events(_watch(stream, trace), json)
    remarks = ended()
    new = plot_file(plot, lambda path: trace.plot(path=path))
    if output is not None:
        new += (NewFile(output, trace.report, f"writing {output.name}"),)
    summary = trace.to_dict()
    return Outcome(
        command="monitor", document={"file": file, **summary, "written": file_names(new)}, text=trace.summary(),
        files=new, remarks=remarks, status=int(bool(trace.events)), in_one_line=True,
    )  # fmt: skip


@contextmanager
def _open(
    file: str, reading: ReadOptions, follow: bool, idle: float | None
) -> Iterator[tuple[Stream, Callable[[], tuple[Remark, ...]]]]:
    """Open a recording or a growing text; yield its stream and a function for remarks on the text's end."""
    from gmwm.files.readers.api import stream_file
    from gmwm.files.readers.growing_files import Lines, growing_stream

    if file != "-" and not follow:
        if idle is not None:
            raise OptionError(
                "--idle needs a file that is being written", argument="idle", got=idle,
                advice="Add {--follow}, or leave {--idle} out.",
            )  # fmt: skip
        yield stream_file(file, reading), tuple
        return
    with growing_source(file) as (take, name), interruptible() as stopped:
        lines = Lines(take, lambda: not stopped(), idle)
        yield growing_stream(lines, name, reading), lambda: remarks_on_end(take, name, lines)


def _trace(
    origin: Origin, stream: Stream, *, reference: Path | None, reading: ReadOptions, every: float,
    axes: list[str] | None, pictures: bool, source: str,
) -> Trace:  # fmt: skip
    """Return the monitor for a stream, with a trace for plots. The remarks of the monitor become warnings."""
    from gmwm.applications.monitor import Trace, baselines
    from gmwm.applications.monitor.baseline import check_rate
    from gmwm.files.readers.api import stream_file

    models, rate = _models(origin, stream.rate)
    both = [axis for axis in stream.axes if axis in models]
    if not both:
        raise OptionError(
            f"the models and the recording have no axis in common: {origin} has {', '.join(models)}, the recording "
            f"has {', '.join(stream.axes)}", argument="from_fits", got=str(origin),
        )  # fmt: skip
    names = chosen_names(both, axes)
    check_rate(stream.rate, rate)
    reference_baselines: Mapping[str, Baseline] | None = None
    if reference is not None:
        reference_baselines = baselines(models, stream_file(reference, reading), names)
    watcher = gmwm.Monitor(
        models, every, rate=rate, baseline="auto" if reference_baselines is None else reference_baselines, axes=names
    )
    for remark in watcher.remarks:
        tell(remark)
    return Trace(watcher, pictures=pictures, source=source)


def _require_alone(**options: object) -> None:
    """Raise an OptionError if an option is given that applies only to a single recording."""
    for name, value in options.items():
        if value:
            raise OptionError(
                f"--{name} applies to one recording, and there are several", argument=name, got=str(value),
                advice="Leave it out, or monitor each recording alone.",
            )  # fmt: skip


def _side_by_side(
    files: list[str], reading: ReadOptions, *, origin: Origin, every: float, axes: list[str] | None, json: bool
) -> Outcome:
    """Monitor several units by comparison with each other, and return the outcome of the command."""
    from gmwm.applications.monitor import redundant
    from gmwm.files.readers.api import stream_file

    streams = {
        name: stream_file(file, reading) for name, file in zip(names_of([Path(f) for f in files]), files, strict=True)
    }
    models, _ = _models(origin, next(iter(streams.values())).rate)
    both = [axis for axis in models if all(axis in stream.axes for stream in streams.values())]
    events: list[UnitEvent] = []

    def record() -> Iterator[UnitEvent]:
        for event in redundant(models, streams, every, axes=chosen_names(both, axes)):
            events.append(event)
            yield event

    _print_events(record(), json)
    return Outcome(
        command="monitor",
        document={"files": files, "axes": both, "every": every, "events": [event.to_dict() for event in events]},
        text=f"{counted(len(events), 'event') if events else 'no event'} of {counted(len(files), 'unit')}",
        status=int(bool(events)),
        in_one_line=True,
    )


@dataclass(frozen=True)
class Origin:
    """Origin of the noise models: calibration or fits (`fits`), or datasheet or file of another program (`source`)."""

    fits: Path | None
    source: str | None

    def __post_init__(self) -> None:
        if (self.fits is None) == (self.source is None):
            raise OptionError(
                "exactly one of --from-fits and --from is needed", argument="from_fits", got=self.source,
                advice="Pass a calibration with {--from-fits}, or the numbers of a datasheet with {--from}.",
            )  # fmt: skip

    def __str__(self) -> str:
        return str(self.fits or self.source)


def _models(origin: Origin, rate: float) -> tuple[Mapping[str, Any], float]:
    """Return calibration, fits or models by axis, and their rate (Hz); --from has the recording's rate."""
    if origin.source is not None:
        return read_given(origin.source, rate).models, rate
    assert origin.fits is not None
    models = _fit_models(origin.fits)
    return models, next(iter(models.values())).wavelet_variance.rate


def _fit_models(path: Path) -> Mapping[str, Any]:
    """Return the calibration in a file or folder, or the fits by axis if it holds a fits.json."""
    from gmwm.cli.plan import fits_in

    file = calibration_file(path)
    if file.is_file() and '"gmwm-calibration"' in file.read_text(encoding="utf-8", errors="replace")[:200]:
        return gmwm.Calibration.load(file)
    _, fits = fits_in(path)
    return {axis: gmwm.Fit.from_dict(content) for axis, content in fits.items()}


def _watch(stream: Stream, trace: Trace) -> Iterator[Event]:
    """Yield a stream's events with times from the first sample; Ctrl-C while Polars reads ends it without error."""
    origin = stream.time_base.start - stream.time_base.left
    try:
        for chunk in stream:
            yield from trace.update(replace(chunk, start=chunk.start - origin))
    except KeyboardInterrupt:
        pass
    yield from trace.finish()


def _print_events(events: Iterable[Event | UnitEvent], json: bool) -> None:
    """Print each event, as text or as one line of JSON."""
    for event in events:
        print(json_module.dumps(event.to_dict()) if json else event, file=sys.stdout, flush=True)
