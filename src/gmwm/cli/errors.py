"""How a command ends: in one readable line, with an exit code, never with a traceback of a planned error."""

from __future__ import annotations

import contextlib
import os
import re
import sys
import threading
from collections.abc import Sequence
from typing import Any, NoReturn

import typer
from typer.core import TyperGroup

from gmwm._template import Dialect
from gmwm.cli.output import one_line
from gmwm.errors import GmwmError

# What Typer says of a value that is no number, and the same in plain words.
_VALUE = r"invalid value for '(?:\S+ / )?([^']+)': [Ii]nput should be "
_RAW = tuple(
    (re.compile(_VALUE + raw), plain)
    for raw, plain in (
        ("a valid number.*", r"\1 takes a number, without a unit"),
        ("a valid integer.*", r"\1 takes a whole number"),
        ("greater than or equal to (.+)", r"\1 must be \2 or more"),
    )
)

OK, USER_ERROR, INTERRUPTED = 0, 2, 130

# Click is a part of Typer in new versions and a package beside it in old ones; the parent is found in both.
_UsageError: type[Any] = typer.BadParameter.__mro__[1]


class OneLineErrors(TyperGroup):
    """A group of commands whose errors take one line on stderr.

    Exit codes: 0 ok, 2 what the user can mend, 130 after Ctrl-C. An error of our own making is a traceback.
    """

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        windows_expand_args: bool = True,
        **extra: Any,
    ) -> NoReturn:
        """Run the command that the arguments name, and leave by SystemExit in any case but a bug."""
        try:
            code = super().main(args, prog_name, complete_var, False, windows_expand_args, **extra)
            sys.stdout.flush()
        except (BrokenPipeError, SystemExit):
            # Whoever read us has seen enough: end quietly, and let the last flush of the interpreter find a sink.
            # (Typer and Rich raise SystemExit at a broken pipe, and at nothing else outside standalone mode.)
            _silence()
            code = OK
        except _UsageError as error:
            code = _told(_usage(error))
        except GmwmError as error:
            code = _told(error.text(Dialect.SHELL))
        except MemoryError:
            code = _told("there is not enough memory for a recording of this length")
        except OSError as error:
            code = _told(f"{error.filename or 'file'}: {error.strerror or error}")
        except (typer.Abort, KeyboardInterrupt):
            code = INTERRUPTED
        if code == INTERRUPTED:
            print("interrupted", file=sys.stderr)
            _leave_threads_behind()
        sys.exit(code if isinstance(code, int) else OK)


def _leave_threads_behind() -> None:
    """End at once where threads still work: the interpreter would wait for them, for minutes at worst.

    What is written is written by the main thread, which has let go of it by now.
    """
    if any("ThreadPool" in thread.name for thread in threading.enumerate()):
        _flush()
        os._exit(INTERRUPTED)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()


def _told(message: str) -> int:
    print(f"error: {one_line(message)}", file=sys.stderr)
    return USER_ERROR


def _usage(error: Any) -> str:
    message = error.format_message().rstrip(".")
    message = message[:1].lower() + message[1:]
    for raw, plain in _RAW:
        message = raw.sub(plain, message)
    return f"{message}; see {error.ctx.command_path} --help" if error.ctx is not None else message


def _silence() -> None:
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, sys.stdout.fileno())
    os.close(sink)
