"""gmwm watch: show the curves and estimates of a recording while it is written."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gmwm.base.durations import parse_length, parse_share
from gmwm.base.errors import GmwmError, OptionError
from gmwm.base.remarks import Remark
from gmwm.cli.command import command
from gmwm.cli.growing_source import Idle, growing_source, interruptible, remarks_on_end
from gmwm.cli.options import Datasheet, Json
from gmwm.cli.output import Outcome
from gmwm.cli.read_options import Axes, Columns, Increments, Mount, Rate, ReadOptionTexts, Scale, Units, chosen_names
from gmwm.cli.settings import with_settings
from gmwm.cli.watch_status import as_dicts, fit_curves, one_line_of, whole_text
from gmwm.recording.signals import MINIMUM_SAMPLES

if TYPE_CHECKING:
    from rich.text import Text

    from gmwm.files.readers.streams import Stream
    from gmwm.measuring.variance.accumulate import WaveletAccumulator
    from gmwm.recording.chunks import Chunk
    from gmwm.theory.processes.model import Model

EXAMPLES = (
    "gmwm watch log.csv --axis gyro",
    'gmwm watch log.csv --model "GM + WN" --axis gyro_x --accuracy 10%',
    "logger | gmwm watch - --rate 200 --units gyro=deg/s --columns gyro_x,gyro_y",
)


@command
def watch(
    file: Annotated[
        str, typer.Argument(help="Text file that is being written, or - for standard input.", metavar="FILE|-")
    ],
    rate: Rate = None,
    units: Units = None,
    columns: Columns = None,
    scale: Scale = None,
    increments: Increments = None,
    mount: Mount = None,
    axis: Axes = None,
    model: Annotated[
        str | None,
        typer.Option(
            "--model", "-m", help="Sum of processes, as for gmwm fit. It is fitted again at each update.",
            metavar="MODEL",
        ),
    ] = None,
    accuracy: Annotated[
        str, typer.Option(help="Desired relative standard error, as 0.1 or 10%; at most 0.5.", metavar="SHARE")
    ] = "0.1",
    every: Annotated[str, typer.Option(help="Time between updates, such as 5s or 1min.", metavar="LENGTH")] = "5s",
    idle: Idle = None,
    datasheet: Datasheet = False,
    json: Json = False,
) -> Outcome:  # fmt: skip
    """Watch a recording while it is written, and show when it is long enough.

    The command shows the Allan deviation of each axis with its standard error. With --model, it also shows the
    parameter estimates, their standard errors, and the time to record for the desired accuracy. A terminal shows a live
    view; a file or pipe gets one line for each update. The complete table is printed at the end: after Ctrl-C, at the
    end of standard input, or after the time of --idle.

    The file must be text that grows line by line. An incomplete line is read when it is complete. If the file is
    truncated or replaced, the command stops and prints the result up to that time.
    """
    from gmwm import Model
    from gmwm.files.readers.growing_files import Lines, growing_stream
    from gmwm.fitting.inference.planning import as_accuracy
    from gmwm.measuring.streaming.passes import accumulators

    seconds, patience = parse_length(every, "every"), None if idle is None else parse_length(idle, "idle")
    share = as_accuracy(parse_share(accuracy))
    parsed = None if model is None else Model.parse(model)
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


def _feed(source: Stream, measured: Mapping[str, WaveletAccumulator], view: _StatusDisplay) -> GmwmError | None:
    """Feed the accumulators until the source ends. Returns the error that ended the source, or None. Raises the error
    if the samples before it are too few for a result."""
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
        self, every: float, stopped: Callable[[], bool], model: Model | None, accuracy: float, datasheet: bool,
        json: bool,
    ) -> None:  # fmt: skip
        self._every, self._stopped = every, stopped
        self._model, self._accuracy, self._datasheet = model, accuracy, datasheet
        self._out = sys.stderr if json else sys.stdout
        self._measured: Mapping[str, WaveletAccumulator] = {}
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
    def show_during(self, measured: Mapping[str, WaveletAccumulator]) -> Iterator[None]:
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
