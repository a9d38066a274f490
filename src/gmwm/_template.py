"""Templates of messages: one text that renders for Python, for the shell and for HTML."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from html import escape
from string import Formatter

from gmwm._text import counted, duration_text, listed, moment, rounded


class Dialect(Enum):
    """Who reads a message: a Python user, a user of the command line, or a reader of an HTML page."""

    PYTHON = "python"
    SHELL = "shell"
    HTML = "html"


@dataclass(frozen=True)
class Quantity:
    """A number with its unit.

    Attributes
    ----------
    value : float
    unit : str
        "s" for a length of time; "" for a plain number.
    """

    value: float
    unit: str = ""


Fact = Quantity | float | int | str | bool | None | tuple["Fact", ...]
"""What a message may be filled with: numbers with units, counts, names, and sequences of these."""

_SHELL_OPTIONS: Mapping[str, str] = {"rng": "--seed", "within": "--within", "axes": "--axis"}
"""Options of the shell whose name is not that of the Python argument."""
_MAPPINGS = ("units", "scale", "columns")
"""Arguments that are mappings in Python and `name=value` pairs in the shell."""
_LISTS = ("columns", "increments")
"""Arguments that are lists in Python and names between commas in the shell."""
_PYTHON_COMMANDS: Mapping[str, str] = {
    "gmwm info": "gmwm.inspect(recording)",
    "gmwm agree": "gmwm.agree(calibrations)",
    "gmwm fit --likelihood": "gmwm.fit_ml(model, signal)",
    "gmwm calibrate": "gmwm.calibrate(recording)",
    "gmwm compare": "gmwm.compare(curves)",
}
"""What a Python user calls instead of a command."""


def render(template: str, facts: Mapping[str, Fact] | None = None, dialect: Dialect = Dialect.PYTHON) -> str:
    """Fill a template with facts, for one kind of reader.

    A field `{name}` is a fact, with an optional format: `{count:#knock}` a count with its noun, `{time:moment}` a time
    to the millisecond, `{time:span}` a length of time in a readable unit, `{share:percent}`, or a number format such as
    `.3g`. A field `{--skip}` or `{--gaps=longest}` is an option: `skip=` and `gaps='longest'` in Python, `--skip` and
    `--gaps longest` in the shell; the value of `{--start=@first}` is a fact. `{--columns=time:none}` leaves a column
    out:
    `columns={'time': None}` in Python, `--columns time=` in the shell. `{gmwm info}` is a command, or the Python
    call that does the same. Text between backticks is code.

    Parameters
    ----------
    template : str
    facts : mapping of name to fact, optional
    dialect : Dialect

    Returns
    -------
    str
        Plain text; escaped HTML with `<code>` if the dialect is HTML.

    Examples
    --------
    >>> template = "{count:#knock} at {first:moment}: cut them out with {--skip}."
    >>> facts = {"count": 2, "first": Quantity(612.5, "s")}
    >>> render(template, facts)
    '2 knocks at 612.5 s: cut them out with skip=.'
    >>> render(template, facts, Dialect.SHELL)
    '2 knocks at 612.5 s: cut them out with --skip.'
    >>> render("{--units=gyro:deg/s} or {--gaps=longest}"), render("{--units=gyro:deg/s}", dialect=Dialect.SHELL)
    ("units={'gyro': 'deg/s'} or gaps='longest'", '--units gyro=deg/s')
    >>> render("{--columns=gyro_x:4,time:none} or {--columns=time,gyro_x}")
    "columns={'gyro_x': 4, 'time': None} or columns=['time', 'gyro_x']"
    """
    known = facts or {}
    html = dialect is Dialect.HTML
    parts: list[str] = []
    for literal, name, spec, _ in Formatter().parse(template):
        parts.append(escape(literal, quote=False) if html else literal)
        if name is None:
            continue
        if name.startswith("--"):
            text = _option(name[2:] + (f":{spec}" if spec else ""), known, dialect)
            parts.append(f"<code>{escape(text, quote=False)}</code>" if html else text)
        elif name.startswith("gmwm "):
            text = _PYTHON_COMMANDS[name] if dialect is Dialect.PYTHON else name
            parts.append(f"<code>{escape(text, quote=False)}</code>" if html else f"`{text}`")
        else:
            text = fact_text(known[name], spec or "")
            parts.append(escape(text, quote=False) if html else text)
    text = "".join(parts)
    return _code_spans(text) if html else text


def fact_text(fact: Fact, spec: str = "") -> str:
    """Write a fact as text, in a format as `render` describes it.

    >>> fact_text(Quantity(0.25, "deg/√h")), fact_text(("gyro_x", "gyro_y")), fact_text(0.123, "percent")
    ('0.25 deg/√h', 'gyro_x and gyro_y', '12 %')
    """
    if isinstance(fact, tuple):
        return joined([fact_text(item, spec) for item in fact])
    if isinstance(fact, str):
        return fact
    if fact is None:
        return "none"
    value, unit = (fact.value, fact.unit) if isinstance(fact, Quantity) else (fact, "")
    if spec.startswith("#"):
        return counted(int(value), spec[1:])
    if spec == "moment":
        return moment(value)
    if spec == "span":
        return duration_text(value)
    if spec == "percent":
        return f"{rounded(100 * value)} %"
    if isinstance(value, bool | int):
        number = str(value)
    else:
        number = format(value, spec) if spec else rounded(value, 3) if math.isfinite(value) else str(value)
    return f"{number}{unit}" if unit == "°" else f"{number} {unit}".rstrip()


def joined(names: Sequence[str], most: int = 6) -> str:
    """Names in a sentence: "a, b and c"; of many names the first ones and the number of others.

    >>> joined(["a"]), joined(["a", "b"]), joined(["a", "b", "c"]), joined(list("abcdefgh"))
    ('a', 'a and b', 'a, b and c', 'a, b, c, d, e, f and 2 others')
    """
    if len(names) > most + 1:
        return listed(names, most)
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}" if names else ""


def shell_option(argument: str) -> str:
    """The shell's option for an argument of a Python function.

    >>> shell_option("gaps"), shell_option("rng"), shell_option("min_length")
    ('--gaps', '--seed', '--min-length')
    """
    return _SHELL_OPTIONS.get(argument, f"--{argument.replace('_', '-')}")


def _option(text: str, facts: Mapping[str, Fact], dialect: Dialect) -> str:
    """An option with its value, as Python or the shell writes it."""
    name, given, value = text.partition("=")
    fact = facts[value[1:]] if value.startswith("@") else None
    python = dialect is Dialect.PYTHON
    if not given:
        return f"{name}=" if python else shell_option(name)
    if isinstance(fact, Quantity | float | int):
        number = fact.value if isinstance(fact, Quantity) else fact
        return f"{name}={number:g}" if python else f"{shell_option(name)} {number:g}"
    literal = fact if isinstance(fact, str) else value
    if not python:
        pairs_of_shell = literal.replace(":none", "=").replace(":", "=") if name in _MAPPINGS else literal
        return f"{shell_option(name)} {shlex.quote(pairs_of_shell)}"
    if name in _MAPPINGS and ":" in literal:
        pairs = (pair.partition(":") for pair in literal.split(","))
        return f"{name}={ {key: _python_value(other) for key, _, other in pairs} }"
    if name in _LISTS:
        return f"{name}={[_python_value(item) for item in literal.split(',')]}"
    return f"{name}={_PYTHON_VALUES.get(literal, repr(literal))}"


def _python_value(text: str) -> str | int | None:
    """A name, an index, or None where nothing stands, as Python users write it in a mapping or a list."""
    return int(text) if text.isdecimal() else None if text in ("", "none") else text


_PYTHON_VALUES: Mapping[str, str] = {"yes": "True", "no": "False"}


def _code_spans(text: str) -> str:
    """Every second part between backticks as code."""
    parts = text.split("`")
    if len(parts) % 2 == 0:
        return text
    return "".join(f"<code>{part}</code>" if k % 2 else part for k, part in enumerate(parts))
