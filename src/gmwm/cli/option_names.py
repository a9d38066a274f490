"""Make error messages of the library name the shell options instead of the Python arguments."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TypeVar

from gmwm.base.errors import GmwmError, ModelError

T = TypeVar("T")


@contextmanager
def named_as_options(options: Mapping[str, str]) -> Iterator[None]:
    """Make errors in the block, and their advice, name the shell options of the mapping from argument to option.

    Only arguments whose option has another name need an entry.

    >>> from gmwm.base.template import Dialect
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


def checker(check: Callable[[T], object]) -> Callable[[T | None], T | None]:
    """Return a Typer callback that checks the value of an option with a function of the library."""

    def callback(given: T | None) -> T | None:
        if given is not None:
            check(given)
        return given

    return callback


@contextmanager
def prefix_errors(argument: str) -> Iterator[None]:
    """Put the name of an argument in front of the message of each ModelError that is raised in the block."""
    try:
        yield
    except ModelError as error:
        error.prefix = argument
        raise
