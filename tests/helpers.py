"""Assertions on errors and remarks that do not depend on their wording, loops over cases, tables, and TOML."""

from __future__ import annotations

import functools
import inspect
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gmwm.base.errors import GmwmError, GmwmWarning
from gmwm.base.remarks import Remark
from gmwm.recording.signals import Imu

tomllib = import_module("tomllib" if sys.version_info >= (3, 11) else "tomli")


def device(name: str) -> Path:
    """A file that a real device or its logger wrote; the test is skipped where it is not at hand."""
    path = Path(__file__).parents[2] / "shared" / "data" / "device" / name
    if not path.exists():
        pytest.skip(f"{name} is not at hand")
    return path


def table(imu: Imu) -> NDArray[np.float64]:
    """The values of a recording, with a column for each axis."""
    return np.column_stack([imu[axis].values for axis in imu])


def each(names: str | tuple[str, ...], cases: Iterable[Any]) -> Callable[[Any], Any]:
    """Run a test in a loop over cases, as `parametrize` would run it as many tests.

    A failure names all its cases and shows the first. Thousands of small tests take longer to collect than to run.
    """
    keys = names if isinstance(names, tuple) else tuple(name.strip() for name in names.split(","))

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(test)
        def run(*fixtures: Any, **others: Any) -> None:
            errors = {}
            for case in cases:
                values = dict(zip(keys, case if len(keys) > 1 else (case,), strict=True))
                try:
                    test(*fixtures, **others, **values)
                except Exception as error:
                    errors[str(values)] = error
            if errors:
                raise AssertionError("in the cases " + ", ".join(errors)) from next(iter(errors.values()))

        signature = inspect.signature(test)
        parameters = [parameter for name, parameter in signature.parameters.items() if name not in keys]
        run.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        return run

    return decorate


def code_of(remark: Remark) -> str:
    """The code of a remark, and its case after a colon if the code has several."""
    return f"{remark.code}:{remark.facts['case']}" if "case" in remark.facts else remark.code


def codes(remarks: Iterable[Remark]) -> list[str]:
    """The codes of remarks with their cases, in their order."""
    return [code_of(remark) for remark in remarks]


def only(remarks: Iterable[Remark], code: str, subject: str | None = None) -> Remark:
    """The only remark of a code such as "gaps" or "lines:found", and of a subject if it is given."""
    every = list(remarks)
    found = [one for one in every if code_of(one) == code and subject in (None, one.subject)]
    assert len(found) == 1, f"{len(found)} remarks of {code} among {codes(every)}"
    return found[0]


@contextmanager
def raises(
    kind: type[GmwmError], *facts: object, argument: str | None = None, advises: Iterable[str] = (), **expected: Any
) -> Iterator[pytest.ExceptionInfo[GmwmError]]:
    """Expect an error of exactly this type, with facts in its message and options or values in its advice.

    Parameters
    ----------
    kind : type
    *facts : object
        Names and numbers that its message must state.
    argument : str, optional
        The argument that it must blame.
    advises : iterable of str
        What its advice must name, as Python users read it.
    **expected
        Other attributes or facts of the error, and their values.
    """
    with pytest.raises(kind) as caught:
        yield caught
    error = caught.value
    assert type(error) is kind
    message = error.text().removesuffix(advice_of(error))
    for fact in facts:
        assert str(fact) in message, f"{fact!r} is not in {message!r}"
    if argument is not None:
        assert error.argument == argument
    for text in advises:
        assert text in advice_of(error), f"{text!r} is not in {advice_of(error)!r}"
    for name, value in expected.items():
        found = getattr(error, name) if hasattr(error, name) else error.facts[name]
        assert found is value or found == value, f"{name} is {found!r}, expected {value!r}"


@contextmanager
def warns(code: str, subject: str | None = None, **facts: Any) -> Iterator[None]:
    """Expect warnings, one of them with the remark of a code, and with its subject and facts if they are given."""
    with pytest.warns(GmwmWarning) as caught:
        yield
    remarks = [warning.message.remark for warning in caught if isinstance(warning.message, GmwmWarning)]
    found = only(remarks, code, subject)
    assert found.facts == {**found.facts, **facts}


def advice_of(error: GmwmError) -> str:
    """The advice of an error as Python users read it."""
    return type(error)("", advice=error.advice, **error.facts).text().partition(". ")[2]
