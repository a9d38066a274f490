"""Errors and warnings: what happened, which argument, what was expected and given, what to do; for Python or shell."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import TYPE_CHECKING, Any, Literal

from gmwm.base.template import Dialect, Fact, render, shell_option
from gmwm.base.text import printable, shorten

if TYPE_CHECKING:
    from typing_extensions import Self

    from gmwm.base.remarks import Remark

ReadCode = Literal[
    "changed", "changes-only", "checksum-wrong", "chunk-damaged", "column-not-numbers", "columns-ambiguous",
    "columns-unnamed", "cut-off", "damaged", "dates-unreadable", "dates-without-times", "decimal-comma", "empty",
    "encrypted", "files-missing", "header-damaged", "header-mismatch", "incomplete", "index-damaged",
    "integers-too-large", "is-directory", "line-too-long", "message-damaged", "message-encoding",
    "no-array", "no-index", "no-inertial-data", "no-numbers", "no-recording", "no-time", "not-a-file",
    "not-continued", "not-found", "not-readable", "not-text", "python-objects", "rate-changes",
    "rate-contradiction", "record-damaged", "row-invalid", "row-length", "sensor-ambiguous", "several-recordings",
    "time-empty", "time-implausible", "time-order", "time-span", "too-large", "too-many", "type-invalid",
    "type-recursive", "type-undefined", "unit-contradiction", "unit-implausible", "unit-needs-three-axes",
    "unit-unknown", "unit-unnamed", "unknown-format", "unsupported", "wrong-format",
]  # fmt: skip
"""Codes of the reasons why a file cannot be read. They do not change if the wording of a message changes."""

_NOT_GIVEN: Any = object()


class GmwmError(Exception):
    """Base of all errors that gmwm raises on purpose. The command line prints them in one line and exits with the code
    2.

    Attributes
    ----------
    message : str
        What happened, as literal text. If it is "", the text is made from the other attributes.
    argument : str or None
        The argument that caused the error.
    expected : str or None
        Description of the values that are allowed.
    got : object
        The value that was given.
    advice : str
        Template of the advice, see `gmwm.base.template.render`; options are written as `{--rate}`.
    facts : mapping of name to fact
        Values for the fields of the advice.
    options : mapping of argument to option
        Options of the shell that differ from the name of the argument, for the command that raised the error.
    prefix : str
        Name of the argument whose value contains the error, for example `within` if one of its processes is wrong.
    subject : str
        The axis, unit or file that the message is about; see `about`.
    code : ReadCode or None
        Code of the reason why a file cannot be read, for programs. Errors of the readers have a code.

    Examples
    --------
    >>> error = OptionError(argument="rate", expected="a positive number (Hz)", got=-3)
    >>> str(error), error.text(Dialect.SHELL)
    ('rate must be a positive number (Hz); got -3', '--rate must be a positive number (Hz); got -3')
    >>> ReadError("static.csv has no time stamps", advice="Pass the sampling rate with {--rate}.").text(Dialect.SHELL)
    'static.csv has no time stamps. Pass the sampling rate with --rate.'
    """

    def __init__(
        self, message: str = "", *, argument: str | None = None, expected: str | None = None, got: object = _NOT_GIVEN,
        advice: str = "", code: ReadCode | None = None, **facts: Fact,
    ) -> None:  # fmt: skip
        super().__init__(message)
        self.code = code
        self.message, self.argument, self.expected = message, argument, expected
        self.given, self.got = got is not _NOT_GIVEN, None if got is _NOT_GIVEN else got
        self.advice, self.facts = advice, facts
        self.options: Mapping[str, str] = {}
        self.prefix = ""
        self.subject = ""

    @property
    def reason(self) -> str:
        """What happened, without the subject and the advice, for a remark that gives the error as its reason."""
        return self._what(Dialect.PYTHON)

    def about(self, subject: str) -> Self:
        """Return the same error with the axis, unit or file that it is about, unless it names one already.

        >>> str(DataError("the signal is constant").about("gyro_x"))
        'gyro_x: the signal is constant'
        """
        if subject not in (self.subject, self.argument):
            self.subject = self.subject or subject
        return self

    def text(self, dialect: Dialect = Dialect.PYTHON) -> str:
        """Return the error as text, for users of Python, the shell or HTML."""
        message = self._what(dialect)
        if self.prefix:
            message = f"{self._argument_name(self.prefix, dialect)}: {message}"
        if self.subject:
            message = f"{self.subject}: {message}"
        message = shorten(printable(message))
        advice = shorten(printable(render(self.advice, self.facts, dialect, self.options)))
        return f"{message}. {advice}" if advice else message

    def with_advice_of(self, cause: GmwmError) -> Self:
        """Return the same error with the advice of its cause, if the cause has one."""
        if cause.advice:
            self.advice, self.facts, self.options = cause.advice, cause.facts, cause.options
        return self

    def at(self, place: str) -> Self:
        """Return a copy of the error with a place before its message, such as a file or a part of a file.

        >>> str(ReadError("not a number", advice="Repair the row.").at("row 3"))
        'row 3: not a number. Repair the row.'
        """
        error = copy(self)
        error.subject = f"{place}: {self.subject}" if self.subject else place
        return error

    def _what(self, dialect: Dialect) -> str:
        """Return what happened, without subject and advice."""
        if self.message:
            return self.message
        message = f"{self._argument_name(self.argument or 'the value', dialect)} must be {self.expected}"
        shown = repr(self.got) if self.given else ""
        shown = shown if len(shown) <= 200 else f"{shown[:200]}…"
        return f"{message}; got {shown}" if self.given else message

    def _argument_name(self, argument: str, dialect: Dialect) -> str:
        """Return the argument, or its option in the shell."""
        if dialect is Dialect.PYTHON or not (self.argument or self.prefix):
            return argument
        return self.options.get(argument) or shell_option(argument)

    def __str__(self) -> str:
        return self.text()

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, (type(self), self.__dict__ | {"args": self.args})


def _again(kind: type[GmwmError], state: Mapping[str, Any]) -> GmwmError:
    """Restore a pickled error."""
    error = kind.__new__(kind)
    error.args = state["args"]
    error.__dict__.update({name: value for name, value in state.items() if name != "args"})
    return error


class DataError(GmwmError, ValueError):
    """The numbers cannot be used, for example because they are NaN or constant, have gaps, or have the wrong shape."""


class ReadError(GmwmError, ValueError):
    """The file cannot be read as an inertial recording, for example because it is truncated or its format is
    unknown."""


class UnitError(ReadError):
    """A unit is unknown or missing, or contradicts the data."""


class ModelError(GmwmError, ValueError):
    """The model cannot be built or estimated, for example because it has a wrong parameter or too many parameters."""


class OptionError(GmwmError, ValueError):
    """The value of an argument is not allowed."""


class MissingTheoryError(ModelError):
    """A process does not define a theoretical quantity that is needed. For example, a drift has no spectral density."""


class MissingDependencyError(GmwmError, ImportError):
    """An optional library is not installed. The message names the extra that installs it."""


class GmwmWarning(UserWarning):
    """Base of all warnings. The result can be used, but the remark should be read first.

    Attributes
    ----------
    remark : Remark
        The remark with its code and facts.
    """

    def __init__(self, remark: Remark) -> None:
        super().__init__(remark)
        self.remark = remark

    def __str__(self) -> str:
        return self.remark.text()


class InferredUnitWarning(GmwmWarning):
    """A unit was inferred from the data. If the unit is wrong, every result is wrong by the ratio of the two units."""


class TimeBaseWarning(GmwmWarning):
    """The time stamps are irregular, because of jitter, duplicates or backward steps."""


class FitWarning(GmwmWarning):
    """A remark about a fitted model; see `fit.remarks`."""
