"""gmwm watch: the curve and the estimates of a recording that is still being made."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gmwm.cli.command import command
from gmwm.cli.durations import parse_length, parse_share
from gmwm.cli.options import Datasheet, Json
from gmwm.cli.output import Outcome
from gmwm.cli.read_options import Axes, Columns, Increments, Rate, ReadOptionTexts, Scale, Units, chosen_names
from gmwm.cli.watch_status import as_dicts, fitted, one_line_of, whole_text
from gmwm.errors import GmwmError, OptionError
from gmwm.remarks import Remark
from gmwm.signals import MINIMUM_SAMPLES

if TYPE_CHECKING:
    from rich.text import Text

    from gmwm.processes.model import Model
    from gmwm.readers.growing_files import GrowingFile, GrowingPipe
    from gmwm.readers.streams import Stream
    from gmwm.variance.accumulate import WaveletAccumulator

EXAMPLES = (
    "gmwm watch log.csv --axis gyro",
    "gmwm watch log.csv --model 'GM + WN' --axis gyro_x --accuracy 10%",
    "logger | gmwm watch - --rate 200 --units gyro=deg/s --columns gyro_x,gyro_y",
)


@command
def watch(
    file: Annotated[str, typer.Argument(help="Text that is being written, or - for standard input.", metavar="FILE|-")],
    rate: Rate = None,
    units: Units = None,
    columns: Columns = None,
    scale: Scale = None,
    increments: Increments = None,
    axis: Axes = None,
    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            "-m",
            help="A sum of processes, as gmwm fit takes it: fitted anew each time.",
            metavar="MODEL",
            show_default=False,
        ),
    ] = None,
    accuracy: Annotated[
        str,
        typer.Option(help="Relative standard error that is enough: 0.1 or 10%, 0.5 the most.", metavar="SHARE"),
    ] = "0.1",
    every: Annotated[str, typer.Option(help="How often to look anew: 5s, 1min.", metavar="LENGTH")] = "5s",
    idle: Annotated[
        str | None,
        typer.Option(
            help="End when nothing has come for so long. Default: at Ctrl-C, or at the end of standard input.",
            metavar="LENGTH",
            show_default=False,
        ),
    ] = None,
    datasheet: Datasheet = False,
    json: Json = False,
) -> Outcome:
    """Follow a recording while it is made: is it enough yet?

    Shows the Allan deviation of each axis and how well it is known so far; with a model also the estimates, their
    errors, and how long the recording must be for the accuracy that is wanted. A live view on a terminal, a line each
    time elsewhere; the whole table at the end, which is Ctrl-C, the end of standard input, or --idle.

    The file is text, and grows line by line. A line that is half written waits for its rest; a file that is cut or
    replaced ends the watch, with what came before.
    """
    from gmwm import Model
    from gmwm.inference.planning import as_accuracy
    from gmwm.readers.growing_files import Lines, growing_stream
    from gmwm.streaming.passes import accumulators

    seconds, patience = parse_length(every, "--every"), None if idle is None else parse_length(idle, "--idle")
    wanted = as_accuracy(parse_share(accuracy))
    parsed = None if model is None else Model.parse(model)
    if seconds <= 0:
        raise OptionError(f"--every takes a length of time above 0, got {every!r}")
    reading = ReadOptionTexts(rate=rate, units=units, columns=columns, scale=scale, increments=increments).parsed()
    with _source(file) as (take, name), _interruptible() as stopped:
        view = _View(
            every=seconds, idle=patience, stopped=stopped, model=parsed, accuracy=wanted, datasheet=datasheet, json=json
        )
        lines = Lines(view.noting(take), view.breathe)
        source = growing_stream(lines, name, reading, patience=min(seconds, 5.0))
        measured = accumulators(chosen_names(source.axes, axis), source.rate)
        failure = _fed(source, measured, view)
    remarks = [Remark.of("watch-ended", str(name), reason=take.trouble)] if take.trouble else []
    if lines.rest:
        remarks.append(Remark.of("last-line-left-out", str(name)))
    curves = {one: made.result() for one, made in measured.items()}
    fits, failed = fitted(parsed, curves)
    return Outcome(
        command="watch",
        document={"file": file, "accuracy": wanted, "axes": as_dicts(curves, fits, wanted)},
        text=whole_text(curves, fits, failed=failed, accuracy=wanted, datasheet=datasheet),
        remarks=(*remarks, *(Remark.of("not-fitted", one, reason=why.rstrip(".")) for one, why in failed.items())),
        failure=failure,
    )


def _fed(source: Stream, measured: Mapping[str, WaveletAccumulator], view: _View) -> GmwmError | None:
    """Measure what comes until it ends; the error that ended it, if what came before it can be used."""
    from gmwm.streaming.passes import feed

    with view.shown(measured):
        try:
            feed(source, measured)
        except KeyboardInterrupt:
            pass  # Polars has its own handler, if Ctrl-C comes while it reads; an end like any other
        except GmwmError as error:
            if not all(len(made) >= MINIMUM_SAMPLES for made in measured.values()):
                raise
            return error
    return None


class _View:
    """What is seen while it runs: when it is made anew, and where it goes."""

    def __init__(
        self, every: float, idle: float | None, stopped: Callable[[], bool], model: Model | None, accuracy: float,
        datasheet: bool, json: bool,
    ) -> None:  # fmt: skip
        self._every, self._idle, self._stopped = every, idle, stopped
        self._model, self._accuracy, self._datasheet = model, accuracy, datasheet
        self._out = sys.stderr if json else sys.stdout
        self._measured: Mapping[str, WaveletAccumulator] = {}
        self._update: Callable[[str], None] = lambda text: None
        self._came = self._shown = time.monotonic()
        self._samples = 0

    def noting(self, take: Callable[[], bytes | None]) -> Callable[[], bytes | None]:
        """The same source, of which is noted when something came."""

        def noted() -> bytes | None:
            data = take()
            if data:
                self._came = time.monotonic()
            return data

        return noted

    def breathe(self) -> bool:
        """Show what there is if it is time; False where it is time to end."""
        now = time.monotonic()
        if self._measured and now - self._shown >= self._every:
            self._show()
            self._shown = time.monotonic()
        return not self._stopped() and (self._idle is None or now - self._came < self._idle)

    @contextmanager
    def shown(self, measured: Mapping[str, WaveletAccumulator]) -> Iterator[None]:
        """Show these from now on: live on a terminal, in lines elsewhere."""
        self._measured = measured
        if not self._out.isatty():
            self._update = lambda text: print(text, file=self._out, flush=True)
            yield
            return
        from rich.console import Console
        from rich.live import Live
        from rich.text import Text

        with Live(console=Console(file=self._out), transient=True, auto_refresh=False) as live:
            self._update = lambda text: live.update(_unwrapped(Text.from_ansi(text)), refresh=True)
            try:
                yield
            finally:
                # What is higher than the terminal would else be printed whole before it is taken away.
                live.update(Text(""), refresh=True)

    def _show(self) -> None:
        samples = len(next(iter(self._measured.values())))
        if samples == self._samples:
            return
        self._samples = samples
        try:
            curves = {one: made.result() for one, made in self._measured.items()}
        except GmwmError:
            return  # too few samples yet
        fits, failed = fitted(self._model, curves)
        live = self._out.isatty()
        self._update(
            whole_text(curves, fits, failed=failed, accuracy=self._accuracy, datasheet=self._datasheet, live=True)
            if live
            else one_line_of(curves, fits, failed=failed, accuracy=self._accuracy, datasheet=self._datasheet)
        )


def _unwrapped(text: Text) -> Text:
    text.no_wrap = True
    return text


@contextmanager
def _source(file: str) -> Iterator[tuple[GrowingFile | GrowingPipe, Path]]:
    """What is watched, and its name."""
    from gmwm.readers.growing_files import GrowingFile, GrowingPipe

    if file != "-" and not Path(file).is_file():
        what = "is no file" if Path(file).exists() else "does not exist"
        raise OptionError(f"{file} {what}; pass a text file that is being written, or - for standard input")
    take = GrowingPipe(sys.stdin.buffer) if file == "-" else GrowingFile(Path(file))
    try:
        yield take, Path("standard input" if file == "-" else file)
    finally:
        take.close()


@contextmanager
def _interruptible() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C was pressed: the first ends the watch in good order, the second at once."""
    pressed = False

    def note(*_: Any) -> None:
        nonlocal pressed
        pressed = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, note)
    try:
        yield lambda: pressed
    finally:
        signal.signal(signal.SIGINT, before)
