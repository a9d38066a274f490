"""The command `gmwm`, the names and the help of its subcommands, and the entry point of the script."""

from __future__ import annotations

import io
import os
import signal
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from types import FrameType
from typing import Annotated, Any

import typer
from typer.core import TyperCommand
from typer.main import get_command

from gmwm.base.guests import admit_guests
from gmwm.cli.errors import OnceCommand, OneLineErrors, Terminated
from gmwm.cli.output import one_line

NAMES = {
    "calibrate": "Choose and fit the noise model of each axis, and print its numbers as in a datasheet.",
    "app": "Calibrate in the browser: look at a recording, leave out time ranges, try models, and download the files.",
    "fleet": "Calibrate every recording in a folder, and find the units that differ from the others.",
    "report": "Write a calibration as one HTML page that needs no network, or as a PDF.",
    "info": "Inspect a recording, and report whether it can be used for a calibration.",
    "wv": "Print the wavelet variance of each axis, or its Allan deviation.",
    "allan": "Print the Allan deviation of each axis, with confidence intervals and the dominant noise type.",
    "psd": "Print the lines and the resonances in the power spectral density of each axis.",
    "cross": "Test whether the axes of a recording share noise, at which scales, and how much.",
    "same": "Test whether recordings have the same noise at each scale, or the same parameters of a model.",
    "fuse": "Fuse the parallel axes of several units into one virtual sensor with less noise.",
    "compare": "Compare the classical and robust wavelet variances of one or several recordings.",
    "fit": "Fit a noise model to each axis, and print its parameters, confidence intervals and goodness of fit.",
    "joint": "Fit one model to several axes at once, including the noise that the axes share.",
    "select": "Compare all models that are part of a largest model, and recommend one for each axis.",
    "track": "Estimate the bias and every other process of a model over time, with a Kalman filter.",
    "residuals": "Test the residuals of a model, which are the standardized innovations of its Kalman filter.",
    "watch": "Watch a recording while it is written, and show when it is long enough.",
    "monitor": "Report when a sensor at rest has changed: noise, level, drift, hum, spikes, frozen values, "
    "lost samples.",
    "agree": "Test whether calibrations of one unit agree with each other, or with a reference.",
    "consistency": "Test whether a filter with the calibrated noise claims the error that it makes on a recording at "
    "rest.",
    "budget": "Compute how attitude, velocity and position errors of unaided inertial navigation grow.",
    "export": "Write the noise of a calibrated unit in the format of another program.",
    "explain": "Explain a message: what it means for the results, and what to do.",
    "plan": "Plan how long to record: print the standard error of each parameter for several durations.",
    "convert": "Convert a recording to Parquet, CSV, MCAP or .imu.",
    "simulate": "Simulate a static recording with known noise.",
    "demo": "Simulate a six-axis IMU, calibrate it, and compare the result with the truth.",
}
"""Names of the commands, in the order of the help, with the first sentences of their help, so that the help imports no
command. The function of a command is in the module with its name."""


class Commands(Mapping[str, Any]):
    """The commands by name, which are imported when they are looked up, and the commands `others` that a script has
    added."""

    def __init__(self, others: Mapping[str, Any]) -> None:
        self._loaded = dict(others)

    def __getitem__(self, name: str) -> Any:
        if name not in self._loaded:
            if name in NAMES:
                self._loaded[name] = _load(getattr(import_module(f"gmwm.cli.{name}"), name))
            else:
                admit_guests("gmwm.commands", self._admit)
        return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        admit_guests("gmwm.commands", self._admit)
        return iter(dict.fromkeys((*NAMES, *self._loaded)))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def _admit(self, name: str, function: Any) -> None:
        """Add a command of another package. Its entry point names a function that returns an Outcome."""
        if name in (*NAMES, *self._loaded):
            raise ValueError(f"gmwm has a command {name} already")
        self._loaded[name] = _load(function)


class Program(OneLineErrors):
    """The command `gmwm` with its subcommands."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.commands = Commands(self.commands)  # type: ignore[assignment]  # none is added or removed from here on
        self._lists = False

    def list_commands(self, ctx: typer.Context) -> list[str]:  # type: ignore[override]
        """Return the names of the commands, without importing those of gmwm."""
        return [*self.commands]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command; for the list of commands, one with its name and its first sentences only."""
        if self._lists and cmd_name in NAMES:
            return TyperCommand(cmd_name, help=NAMES[cmd_name])
        return super().get_command(ctx, cmd_name)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help, with the list of commands."""
        self._lists = True
        super().format_help(ctx, formatter)
        self._lists = False

    def shell_complete(self, ctx: Any, incomplete: str) -> Any:
        """Return the names and first sentences of the commands that a shell proposes."""
        self._lists = True
        proposals = super().shell_complete(ctx, incomplete)
        self._lists = False
        return proposals


def help_text(text: str | None) -> str:
    """Return a docstring with each paragraph on one line, so that the help wraps at the width of the terminal."""
    return "\n\n".join(one_line(paragraph) for paragraph in (text or "").split("\n\n"))


def _load(function: Any) -> Any:
    """Return the command of a function, with the examples of its module below the help."""
    name, examples = function.__name__, getattr(import_module(function.__module__), "EXAMPLES", ())
    program = typer.Typer(rich_markup_mode="rich", pretty_exceptions_enable=False, add_completion=False)
    epilog = "\n\n".join(("Examples:", *examples)) if examples else None
    program.command(name, cls=OnceCommand, help=help_text(function.__doc__), epilog=epilog)(function)
    return typer.main.get_command(program)


app = typer.Typer(
    name="gmwm", cls=Program, rich_markup_mode="rich", pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)  # fmt: skip


def _print_version(wanted: bool) -> None:
    if wanted:
        from gmwm import __version__

        print(f"gmwm {__version__}")
        raise typer.Exit


def _print_manual(context: typer.Context, wanted: bool) -> None:
    if wanted:
        from gmwm.cli.manual import manual

        print(manual(context), end="")
        raise typer.Exit


_PURPOSE = """Find the noise model of an inertial sensor from a static recording.

gmwm fits a sum of noise processes to the wavelet variance, which is half the Allan variance (Generalized Method of
Wavelet Moments). A recording is a file with data of gyroscopes, accelerometers or both, in one of many formats.

With --json, a command prints its result as JSON on stdout and everything else on stderr. Exit codes: 0 success,
2 error (one line on stderr), 130 interrupted by Ctrl-C, 143 terminated (SIGTERM),
129 terminal closed (SIGHUP)."""


@app.callback(
    invoke_without_command=True,
    help=help_text(_PURPOSE),
    epilog="Start with:  gmwm demo\n\nFor your own file:  gmwm info FILE,  then  gmwm calibrate FILE --output results",
)
def _gmwm(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
    man: Annotated[
        bool,
        typer.Option("--man", callback=_print_manual, is_eager=True, help="Print the manual page, for man -l -."),
    ] = False,
) -> None:
    """Print the help if no command is given."""
    if context.invoked_subcommand is None:
        print(context.get_help())


def accept_all_characters(stream: io.TextIOWrapper) -> None:
    """Make a standard stream accept every character. Files and pipes are UTF-8, unless PYTHONIOENCODING or PYTHONUTF8
    is set. A terminal keeps its encoding, and characters that it lacks, such as σ, become question marks."""
    requested = os.environ.get("PYTHONIOENCODING", "").partition(":")[0] or os.environ.get("PYTHONUTF8")
    keep = requested or stream.isatty()
    stream.reconfigure(encoding=None if keep else "utf-8", errors="replace")


def _terminate(number: int, _frame: FrameType | None) -> None:
    """Handle SIGTERM and SIGHUP by an exception, as for Ctrl-C, so that temporary files are removed."""
    raise Terminated(number)


def run(on_interrupt: Any = signal.default_int_handler) -> None:
    """Run the command line, as `gmwm.cli.start` does. `on_interrupt` handles Ctrl-C while a command runs. Before and
    after it, signals end the process at once, because an exception there would show a traceback."""
    # A stream that the caller has closed is None. It is replaced, so that nothing is read from it or printed to it.
    sys.stdin = sys.stdin or open(os.devnull, encoding="utf-8")  # noqa: SIM115
    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    os.environ["MPLBACKEND"] = "agg"  # commands draw into files
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            accept_all_characters(stream)
    command = get_command(app)
    # Windows has no SIGHUP, and nohup has it ignored.
    ends = [number for name in ("SIGTERM", "SIGHUP") if (number := getattr(signal, name, None)) is not None]
    ends = [number for number in ends if signal.getsignal(number) is signal.SIG_DFL]
    for number in ends:
        signal.signal(number, _terminate)
    signal.signal(signal.SIGINT, on_interrupt)
    try:
        command(prog_name="gmwm")
    finally:
        for number in ends:
            signal.signal(number, signal.SIG_DFL)
        if on_interrupt is signal.default_int_handler:
            signal.signal(signal.SIGINT, signal.SIG_DFL)
