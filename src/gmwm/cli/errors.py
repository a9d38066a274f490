"""Print the errors of commands in one line on stderr, and set the exit code."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Sequence
from typing import Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup

from gmwm.base.errors import GmwmError, OptionError
from gmwm.base.helpers import end_helpers
from gmwm.base.template import Dialect
from gmwm.cli.output import one_line

_EXPECTED = {
    "float_parsing": "a number, without a unit", "int_parsing": "a whole number", "int_from_float": "a whole number",
    "float": "a number, without a unit", "integer": "a whole number",
}  # fmt: skip
"""Description of the expected value of an option. The key is the error type of Pydantic in new versions of Typer, and
the name of the Click type in old versions."""

OK, USER_ERROR, INTERRUPTED = 0, 2, 130


class Terminated(BaseException):
    """Exception that is raised if the process receives SIGTERM or SIGHUP; its argument is the number of the signal."""


# New versions of Typer contain a copy of Click, old versions import Click. This expression gets its class UsageError in
# both cases.
_UsageError: type[Any] = typer.BadParameter.__mro__[1]


class OneLineErrors(TyperGroup):
    """A group of commands that prints each error in one line on stderr. Exit codes: 0 success, 2 an error that the user
    can correct, 130 Ctrl-C, 143 SIGTERM, 129 SIGHUP. A bug in gmwm shows a traceback."""

    def main(
        self, args: Sequence[str] | None = None, prog_name: str | None = None, complete_var: str | None = None,
        standalone_mode: bool = True, windows_expand_args: bool = False, **extra: Any,
    ) -> NoReturn:  # fmt: skip
        """Run the command that the arguments name, and exit with its code. Errors that are bugs in gmwm propagate.
        Windows shells leave patterns as they are, and so does this, because gmwm takes `hour_*.csv` for one
        recording."""
        try:
            _require_address_space()
            code = super().main(args, prog_name, complete_var, False, windows_expand_args, **extra)
            sys.stdout.flush()
            if code == INTERRUPTED:
                raise KeyboardInterrupt  # Typer returns this code after Ctrl-C
        except (BrokenPipeError, SystemExit):
            # The reader of a pipe, such as `head`, has closed it, so end without an error. The interpreter flushes
            # stdout at exit, so stdout needs a new target. Typer and Rich raise SystemExit only in this case, because
            # standalone mode is off.
            _discard_stdout()
            code = OK
        except _UsageError as error:
            code = _print_error(_usage_text(error))
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
    """Exit at once if worker threads are running, because the interpreter would wait for them, possibly for minutes. No
    file is left incomplete: only the main thread writes files, and it has stopped."""
    if any("ThreadPool" in thread.name for thread in threading.enumerate()):
        _flush()
        os._exit(code)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()


def _print_error(message: str) -> int:
    with contextlib.suppress(OSError):  # stderr may be closed or full
        print(f"error: {one_line(message)}", file=sys.stderr)
    return USER_ERROR


def _usage_text(error: Any) -> str:
    """Return the text of Typer's error about the arguments of a command, with a hint to the help of the command."""
    text = _value_text(error) or error.format_message()
    return text if error.ctx is None else f"{text} (see {error.ctx.command_path} --help)"


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


def _discard_stdout() -> None:
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, sys.stdout.fileno())
    os.close(sink)
