"""The option of the shell for each argument of the library, and errors of the library in terms of these options."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TypeVar

from gmwm.errors import GmwmError, ModelError, OptionError

T = TypeVar("T")
_OTHERS = {"axes": "--axis"}
"""Arguments whose option has another name."""


def option_of(argument: str) -> str:
    """The option for an argument of the library.

    >>> option_of("chunked"), option_of("axes")
    ('--chunked', '--axis')
    """
    return _OTHERS.get(argument, f"--{argument.replace('_', '-')}")


@contextmanager
def named_as_options(options: Mapping[str, str]) -> Iterator[None]:
    """Errors of the block about an argument, by the name of its option.

    >>> with named_as_options({"format": "--to"}):
    ...     raise OptionError("format must be one of imu:IMAR; pass format= with one of them")
    Traceback (most recent call last):
    gmwm.errors.OptionError: --to must be one of imu:IMAR; pass --to with one of them
    """
    try:
        yield
    except OptionError as error:
        text = str(error)
        for argument, option in options.items():
            text = re.sub(rf"^{argument}(?= )|(?<=pass ){argument}=", option, text)
        raise type(error)(text) from error.__cause__


def checked(argument: str, check: Callable[[T], object]) -> Callable[[T | None], T | None]:
    """A callback of an option: its value is checked before the command runs, by the rule of the library."""

    def callback(given: T | None) -> T | None:
        if given is not None:
            with named_as_options({argument: option_of(argument)}):
                check(given)
        return given

    return callback


@contextmanager
def prefixed(argument: str) -> Iterator[None]:
    """Errors of a model that was typed, with the option before them."""
    try:
        yield
    except ModelError as error:
        raise _with_prefix(error, option_of(argument)) from None


def _with_prefix(error: GmwmError, option: str) -> GmwmError:
    return type(error)(f"{option}: {error}")
