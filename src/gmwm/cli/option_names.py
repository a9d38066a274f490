"""Name the options of the shell in errors of the library."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TypeVar

from gmwm.errors import GmwmError, ModelError

T = TypeVar("T")


@contextmanager
def named_as_options(options: Mapping[str, str]) -> Iterator[None]:
    """Name the options of this mapping in errors and their advice, for arguments whose option has another name.

    >>> from gmwm._template import Dialect
    >>> from gmwm.errors import OptionError
    >>> try:
    ...     with named_as_options({"format": "--to"}):
    ...         raise OptionError(argument="format", expected="one of imu:IMAR", got="x")
    ... except OptionError as error:
    ...     print(error.text(Dialect.SHELL))
    --to must be one of imu:IMAR; got 'x'
    """
    try:
        yield
    except GmwmError as error:
        error.options = options
        raise


def checked(check: Callable[[T], object]) -> Callable[[T | None], T | None]:
    """Make a callback that checks the value of an option before the command runs, with a check of the library."""

    def callback(given: T | None) -> T | None:
        if given is not None:
            check(given)
        return given

    return callback


@contextmanager
def prefixed(argument: str) -> Iterator[None]:
    """Put the name of the argument that holds the model in front of the message of a ModelError."""
    try:
        yield
    except ModelError as error:
        error.prefix = argument
        raise
