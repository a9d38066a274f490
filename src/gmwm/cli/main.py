"""The command `gmwm` with its subcommands, and the entry point of the script."""

from __future__ import annotations

import io
import os
import signal
import sys
from types import FrameType
from typing import Annotated, Any

import typer
from typer.main import get_command

from gmwm.cli.commands import Program, help_text
from gmwm.cli.errors import Terminated

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


def _print_schema(name: str | None) -> None:
    if name is not None:
        import json

        from gmwm.cli.schemas import schema

        print(json.dumps(schema(name), indent=1))
        raise typer.Exit


_SCHEMA_HELP = "Print the JSON Schema of the output of a command with --json, or of calibration.json."
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
    schema: Annotated[
        str | None,
        typer.Option(callback=_print_schema, is_eager=True, metavar="COMMAND", help=_SCHEMA_HELP),
    ] = None,
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
