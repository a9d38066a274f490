"""How a command ends: in one readable line, with an exit code, never with a traceback of a planned error."""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import sys
import threading
from collections.abc import Sequence
from typing import Any, NoReturn

import typer
from typer.core import TyperGroup

from gmwm.errors import GmwmError

# What is said to a caller of the library, and the same to a shell.
_PHRASES = (
    ("imu.longest()", "--gaps longest"),
    ("gaps='longest'", "--gaps longest"),
    ("robust=True", "--robust"),
    ("None to leave one out", "nothing between two commas to leave one out"),
)
_KEYWORD = re.compile(r"\b(rate|units|columns|gaps|format|topic|start|stop|skip)=(\{[^{}]*\}|\[[^][]*\])?(?=(\S)?)")

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
            code = _told(str(error))
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


def one_line(text: str) -> str:
    """`text` without line breaks.

    >>> one_line("a first\\n   and a second")
    'a first and a second'
    """
    return " ".join(text.split())


def as_options(text: str) -> str:
    """A message with the arguments of `gmwm.read` that it names as the options a shell takes.

    >>> as_options("pass rate=, or say it with units={'accel': 'g'} or columns=['time', None, 'gyro_x']")
    'pass --rate, or say it with --units accel=g or --columns time,,gyro_x'
    >>> as_options("imu.longest() takes the longest")
    '--gaps longest takes the longest'
    """

    def option(match: re.Match[str]) -> str:
        name, literal, follows = match.groups()
        if literal is None:
            return f"--{name} " if follows and (follows.isalnum() or follows in "\"'") else f"--{name}"
        value = re.sub(r"\bNone\b", "", literal[1:-1].replace('"', "").replace("'", ""))
        value = re.sub(r"\s*,\s*", ",", re.sub(r"\s*:\s*", "=", value)).strip()
        return f"--{name} {shlex.quote(value)}"

    for python, shell in _PHRASES:
        text = text.replace(python, shell)
    return _KEYWORD.sub(option, text)


def _told(message: str) -> int:
    print(f"error: {as_options(one_line(message))}", file=sys.stderr)
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
