"""The command `gmwm`, the names and the help of its subcommands, its manual page, and the entry point of the script."""

from __future__ import annotations

import contextlib
import io
import json
import os
import signal
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from gmwm.base.errors import GmwmError, OptionError
from gmwm.base.extras import admit_guests
from gmwm.base.helpers import end_helpers
from gmwm.base.template import Dialect
from gmwm.cli.output import one_line

_EXPECTED = {
    "float_parsing": "a number, without a unit", "int_parsing": "a whole number", "int_from_float": "a whole number",
    "float": "a number, without a unit", "integer": "a whole number",
}  # fmt: skip
"""Expected values of an option, by Pydantic's error type in new Typer, or the Click type in old versions."""

OK, USER_ERROR, INTERRUPTED = 0, 2, 130


class Terminated(BaseException):
    """Exception that is raised if the process receives SIGTERM or SIGHUP; its argument is the number of the signal."""


# UsageError of Click, which old versions of Typer import and new versions contain.
_UsageError: type[Any] = typer.BadParameter.__mro__[1]


class OneLineErrors(TyperGroup):
    """A group of commands that prints each error in one line on stderr. Exit codes: 0 success, 2 an error that the user
    can correct, 130 Ctrl-C, 143 SIGTERM, 129 SIGHUP. A bug in gmwm shows a traceback."""

    def main(
        self, args: Sequence[str] | None = None, prog_name: str | None = None, complete_var: str | None = None,
        standalone_mode: bool = True, windows_expand_args: bool = False, **extra: Any,
    ) -> NoReturn:  # fmt: skip
        """Run the named command, and exit with its code; bugs propagate. Patterns stay as they are, as in Windows
        shells, because gmwm takes `hour_*.csv` for one recording."""
        try:
            _require_address_space()
            code = super().main(args, prog_name, complete_var, False, windows_expand_args, **extra)
            sys.stdout.flush()
            if code == INTERRUPTED:
                raise KeyboardInterrupt  # Typer returns this code after Ctrl-C
        except (BrokenPipeError, SystemExit):
            # A closed pipe (`head`) is no error, but stdout, flushed at exit, needs a new target. Typer and Rich raise
            # SystemExit only for this, as standalone mode is off.
            sink = os.open(os.devnull, os.O_WRONLY)
            os.dup2(sink, sys.stdout.fileno())
            os.close(sink)
            code = OK
        except _UsageError as error:
            text = _value_text(error) or error.format_message()
            code = _print_error(text if error.ctx is None else f"{text} (see {error.ctx.command_path} --help)")
        except GmwmError as error:
            code = _print_error(error.text(Dialect.SHELL))
        except MemoryError:
            code = _print_error("there is not enough memory for a recording of this length")
        except OSError as error:
            code = _print_error(f"{error.filename or 'the output'}: {error.strerror or error}")
        except Terminated as error:
            code = _print_end("terminated", 128 + error.args[0])
        except (typer.Abort, KeyboardInterrupt):
            code = _print_end("interrupted", INTERRUPTED)
        sys.exit(code if isinstance(code, int) else OK)


def _require_address_space() -> None:
    """Raise an error if the process may not reserve the memory that Polars needs at least; it would abort later."""
    if sys.platform == "win32":
        return
    import resource

    allowed, _ = resource.getrlimit(resource.RLIMIT_AS)
    # With 2 GB, a table of 12 000 rows is read, with a warning for each thread that cannot start.
    if allowed != resource.RLIM_INFINITY and allowed < 3 << 30:
        raise OptionError(
            f"the address space is limited to {allowed / 2**30:.2f} GiB, and gmwm reserves 3 GiB, which it mostly does "
            "not use", advice="Lift the limit: `ulimit -v unlimited`.",
        )  # fmt: skip


def _print_end(word: str, code: int) -> int:
    """Print why a command ends early, end its helpers, and return its exit code."""
    with contextlib.suppress(OSError):  # the terminal may be closed
        print(word, file=sys.stderr)
    end_helpers()
    _leave_threads_behind(code)
    return code


class OnceCommand(TyperCommand):
    """A command that raises an error if a single-valued option is given twice. Click would ignore the first value."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments of the command. Raises a usage error if a single-valued option is given twice."""
        order = self.make_parser(ctx).parse_args(args=list(args))[2]
        for parameter in order:
            several = (
                parameter.nargs != 1 or getattr(parameter, "multiple", False) or getattr(parameter, "is_flag", False)
            )
            if order.count(parameter) > 1 and not several:
                name = max(parameter.opts, key=len)
                advice = f": {name} {parameter.metavar}" if "," in (parameter.metavar or "") else ""
                raise _UsageError(f"{name} is given {order.count(parameter)} times; give it once{advice}", ctx)
        return list(super().parse_args(ctx, args))


def _leave_threads_behind(code: int) -> None:
    """Exit at once if worker threads run, which the interpreter would await; only the main thread writes files."""
    if any("ThreadPool" in thread.name for thread in threading.enumerate()):
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        os._exit(code)


def _print_error(message: str) -> int:
    with contextlib.suppress(OSError):  # stderr may be closed or full
        print(f"error: {one_line(message)}", file=sys.stderr)
    return USER_ERROR


def _value_text(error: Any) -> str:
    """Return the text of an error about an option whose value is not allowed; "" for any other error."""
    parameter, cause = getattr(error, "param", None), error.__cause__
    if parameter is None:
        return ""
    option = next((name for name in parameter.opts if name.startswith("--")), parameter.opts[0])
    details = cause.errors()[0] if hasattr(cause, "errors") else {}
    kind = details.get("type") or getattr(getattr(parameter, "type", None), "name", "")
    context = details.get("ctx", {})
    if kind == "greater_than_equal":
        return f"{option} must be {context['ge']} or more; got {details['input']}"
    if "error" in context:
        return f"{option}: {context['error']}"
    if kind not in _EXPECTED or type(error) is not typer.BadParameter:
        return ""
    got = f"; got {details['input']!r}" if "input" in details else ""
    return f"{option} must be {_EXPECTED[kind]}{got}"


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
"""Commands in the order of the help, with first sentences, so that the help imports none; modules have their names."""


class Commands(Mapping[str, Any]):
    """The commands by name, imported when they are looked up, and `others` that a script has added."""

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
        print(manual(context), end="")
        raise typer.Exit


def _print_schema(name: str | None) -> None:
    if name is not None:
        import json

        print(json.dumps(schema(name), indent=1))
        raise typer.Exit


_SCHEMA_HELP = "Print the JSON Schema of the output of a command with --json, of calibration.json or session.json."
_PURPOSE = """Find the noise model of an inertial sensor from a static recording.

gmwm fits a sum of noise processes to the wavelet variance, which is half the Allan variance (Generalized Method of
Wavelet Moments). A recording is a file with data of gyroscopes, accelerometers or both, in one of many formats.

With --json, a command prints its result as JSON on stdout and everything else on stderr. Exit codes: 0 success,
1 at least one event (gmwm monitor), 2 error (one line on stderr), 130 interrupted by Ctrl-C, 143 terminated (SIGTERM),
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
        bool, typer.Option("--man", callback=_print_manual, is_eager=True, help="Print the manual page, for man -l -.")
    ] = False,
    schema: Annotated[
        str | None, typer.Option(callback=_print_schema, is_eager=True, metavar="COMMAND", help=_SCHEMA_HELP)
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


SCHEMAS = Path(__file__).with_name("schemas.json")
"""Made from the JSON that the commands print in the tests: `python -m tests.json_outputs`."""


def schema(name: str) -> dict[str, Any]:
    """Return the JSON schema of a command, of event lines (monitor-event), of calibration.json or session.json."""
    if name == "calibration.json":
        from gmwm.calibration.result import Calibration

        return Calibration.schema()
    if name == "session.json":
        from gmwm.applications.app.session import Session

        return Session.schema()
    schemas = json.loads(SCHEMAS.read_text(encoding="utf-8"))
    if name not in schemas:
        raise OptionError(
            argument="schema", expected=f"one of calibration.json, session.json, {', '.join(schemas)}", got=name
        )
    from gmwm.base.documents import DIALECT

    return {"$schema": DIALECT, "title": f"gmwm {name}", **schemas[name]}


def manual(context: Any) -> str:
    """Return the manual page as troff source: the description, and each command with its options and examples."""
    from gmwm import __version__

    program = context.command
    title, *paragraphs = program.help.split("\n\n")
    lines = [
        f'.TH GMWM 1 "" "gmwm {__version__}" "User Commands"', ".SH NAME", f"gmwm \\- {_escape(title)}",
        ".SH SYNOPSIS", ".B gmwm", r"\fICOMMAND\fR [\fIOPTIONS\fR]", ".SH DESCRIPTION",
        *_paragraphs(paragraphs), *_options(program, context), ".SH COMMANDS",
    ]  # fmt: skip
    for name in program.list_commands(context):
        lines += _command(program.get_command(context, name), context)
    return "\n".join(lines) + "\n"


def _command(command: Any, parent: Any) -> Iterator[str]:
    context = type(parent)(command, info_name=command.name, parent=parent)
    usage = " ".join(command.collect_usage_pieces(context))
    yield f".SS {_escape(f'gmwm {command.name} {usage}')}"
    yield from _paragraphs((command.help or "").split("\n\n"))
    yield from _options(command, context)
    heading, *examples = (command.epilog or "").split("\n\n")
    if examples:
        yield from (".PP", _escape(heading), ".nf", *(f"  {_escape(example)}" for example in examples), ".fi")


def _options(command: Any, context: Any) -> Iterator[str]:
    for parameter in command.get_params(context):
        names, text = parameter.get_help_record(context) or ("", "")
        if names:
            yield from (".TP", rf"\fB{_escape(names)}\fR", _escape(one_line(text)))


def _paragraphs(texts: list[str]) -> Iterator[str]:
    for text in texts:
        yield from (".PP", _escape(one_line(text)))


def _escape(text: str) -> str:
    """Escape what troff would interpret: backslashes, hyphens, and a dot or an apostrophe at the start of a line.

    >>> print(_escape(".imu with --json"))
    \\&.imu with \\-\\-json
    """
    escaped = text.replace("\\", r"\e").replace("-", r"\-")
    return rf"\&{escaped}" if escaped.startswith((".", "'")) else escaped
