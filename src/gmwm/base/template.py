"""Templates of messages, rendered for Python, for the shell or for HTML."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from html import escape
from string import Formatter
from typing import Any

from gmwm.base.text import (
    counted,
    duration_text,
    length_text,
    list_text,
    moment,
    p_relation,
    round_fixed,
    round_text,
    with_minus,
)


class Dialect(Enum):
    """The reader of a message: a Python user, a user of the command line, or a reader of an HTML page."""

    PYTHON = "python"
    SHELL = "shell"
    HTML = "html"


@dataclass(frozen=True)
class Quantity:
    """A number with its unit, for example "s"; "" for a plain number."""

    value: float
    unit: str = ""


Fact = Quantity | float | int | str | bool | None | tuple["Fact", ...]
"""A value in a message: a number with its unit, a count, a name, or a sequence of these."""

_SHELL_OPTIONS: Mapping[str, str] = {"rng": "--seed", "axes": "--axis"}
"""Options of the shell whose name differs from the Python argument."""
_MAPPINGS = ("units", "scale", "columns")  # arguments that are mappings in Python and `name=value` pairs in the shell
_LISTS = ("columns", "increments")  # arguments that are lists in Python and names separated by commas in the shell
_PYTHON_COMMANDS: Mapping[str, str] = {
    "gmwm info": "gmwm.inspect(recording)",
    "gmwm agree": "gmwm.agree(calibrations)",
    "gmwm fit": "gmwm.fit(model, curve)",
    "gmwm fit --likelihood": "gmwm.fit_ml(model, signal)",
    "gmwm fit --bootstrap-draws 500": "fit.confidence_intervals(method='bootstrap')",
    "gmwm calibrate": "gmwm.calibrate(recording)",
    "gmwm calibrate --chunked no": "gmwm.calibrate(gmwm.read(path))",
    "gmwm compare": "gmwm.compare(curves)",
    "gmwm cross": "gmwm.cross(recording)",
    "gmwm joint": "gmwm.fit_joint(model, recording)",
    "gmwm psd": "gmwm.psd(recording)",
}
"""The Python call that is equivalent to a command."""


def render(
    template: str,
    facts: Mapping[str, Fact] | None = None,
    dialect: Dialect = Dialect.PYTHON,
    options: Mapping[str, str] | None = None,
) -> str:
    """Fill a template with facts, for users of Python, the shell or HTML, which is escaped.

    - `{name}` is a fact, with a number format or: `{count:#knock}` with noun, `{levels:@level}` list after noun,
      `{time:moment}` to the millisecond, `{time:span}` in a readable unit, `{share:percent}`, `p {p:p}`.
    - `{--skip}`, `{--gaps=longest}` are options: `skip=`, `gaps='longest'` in Python, `--gaps longest` in the shell.
      `{--start=@first}` has the fact `first`, and `{--columns=time:none}` leaves a column out. `options` renames them.
    - `{gmwm info}` is a shell command, or the equivalent call in Python. Text between backticks is code.

    >>> template = "{count:#knock} at {first:moment}: leave them out with {--skip}."
    >>> facts = {"count": 2, "first": Quantity(612.5, "s")}
    >>> render(template, facts)
    '2 knocks at 612.5 s: leave them out with skip=.'
    >>> render(template, facts, Dialect.SHELL)
    '2 knocks at 612.5 s: leave them out with --skip.'
    >>> render("{--units=gyro:deg/s} or {--gaps=longest}"), render("{--units=gyro:deg/s}", dialect=Dialect.SHELL)
    ("units={'gyro': 'deg/s'} or gaps='longest'", '--units gyro=deg/s')
    >>> render("{--columns=gyro_x:4,time:none} or {--columns=time,gyro_x}")
    "columns={'gyro_x': 4, 'time': None} or columns=['time', 'gyro_x']"
    """
    values = facts or {}
    html = dialect is Dialect.HTML
    parts: list[str] = []
    for literal, name, spec, _ in Formatter().parse(template):
        parts.append(escape(literal, quote=False) if html else literal)
        if name is None:
            continue
        if name.startswith("--"):
            text = _option(name[2:] + (f":{spec}" if spec else ""), values, dialect, options or {})
            parts.append(f"<code>{escape(text, quote=False)}</code>" if html else text)
        elif name.startswith("gmwm "):
            text = _PYTHON_COMMANDS[name] if dialect is Dialect.PYTHON else name
            parts.append(f"<code>{escape(text, quote=False)}</code>" if html else f"`{text}`")
        else:
            text = fact_text(values[name], spec or "")
            parts.append(escape(text, quote=False) if html else text)
    text = "".join(parts)
    return _code_spans(text) if html else text


def fact_text(fact: Fact, spec: str = "") -> str:
    """Format a fact as text; `render` describes the formats.

    >>> fact_text(Quantity(0.25, "deg/√h")), fact_text(("gyro_x", "gyro_y")), fact_text((0.123, 2e-9), "percent")
    ('0.25 deg/√h', 'gyro_x and gyro_y', '12 % and below 0.01 %')
    >>> fact_text((3, 4), "@level")
    'levels 3 and 4'
    """
    if spec.startswith("@"):
        items = fact if isinstance(fact, tuple) else (fact,)
        return f"{spec[1:]}{'s' if len(items) > 1 else ''} {fact_text(items)}"
    if isinstance(fact, tuple):
        return join_names([fact_text(item, spec) for item in fact])
    if isinstance(fact, str):
        return round_fixed(fact)
    if fact is None:
        return "none"
    value, unit = (fact.value, fact.unit) if isinstance(fact, Quantity) else (fact, "")
    if spec.startswith("#"):
        return counted(int(value), spec[1:])
    if spec == "moment":
        return moment(value)
    if spec == "span":
        return duration_text(value)
    if spec == "p":
        return p_relation(value)
    if spec == "percent":
        return "below 0.01 %" if 0 < value < 1e-4 else with_minus(f"{round_text(100 * value)} %")
    if isinstance(value, bool | int):
        number = str(value)
    elif math.isfinite(value) and (not spec or re.fullmatch(r"\.[1-6]g", spec)):
        number = round_text(value, int(spec[1]) if spec else 3)
    else:
        number = format(value, spec)
    return with_minus(f"{number}{unit}" if unit == "°" else f"{number} {unit}".rstrip())


def join_names(names: Sequence[str], most: int = 6) -> str:
    """Join names as in "a, b and c", or some and the number of the others.

    >>> join_names(["a"]), join_names(["a", "b"]), join_names(["a", "b", "c"]), join_names(list("abcdefgh"))
    ('a', 'a and b', 'a, b and c', 'a, b, c, d, e, f and 2 others')
    """
    if len(names) > most + 1:
        return list_text(names, most)
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}" if names else ""


def shell_option(argument: str) -> str:
    """Return the option of the shell that corresponds to an argument of a Python function.

    >>> shell_option("gaps"), shell_option("rng"), shell_option("min_length")
    ('--gaps', '--seed', '--min-length')
    """
    return _SHELL_OPTIONS.get(argument, f"--{argument.replace('_', '-')}")


def shell_word(text: str) -> str:
    """Return text as a word for every shell, in double quotes, or single ones (sh) if special within these.

    >>> print(shell_word("GM + WN"), shell_word("static.csv"), shell_word('$x "y"'))
    "GM + WN" static.csv '$x "y"'
    """
    quoted = shlex.quote(text)
    return f'"{text}"' if quoted == f"'{text}'" and not re.search(r'["$`\\!]', text) else quoted


def _option(text: str, facts: Mapping[str, Fact], dialect: Dialect, options: Mapping[str, str]) -> str:
    """Format an option with its value for Python or the shell."""
    name, equals, value = text.partition("=")
    shell = options.get(name) or shell_option(name)
    fact = facts[value[1:]] if value.startswith("@") else None
    python = dialect is Dialect.PYTHON
    if not equals:
        return f"{name}=" if python else shell
    if isinstance(fact, Quantity | float | int):
        number = fact.value if isinstance(fact, Quantity) else fact
        return f"{name}={number:g}" if python else f"{shell} {number:g}"
    if isinstance(fact, tuple):  # time ranges (s)
        spans: Any = fact
        if python:
            return f"{name}=[{', '.join(f'({begin:g}, {end:g})' for begin, end in spans)}]"
        return f"{shell} {','.join(f'{length_text(begin)}-{length_text(end)}' for begin, end in spans)}"
    literal = fact if isinstance(fact, str) else value
    if not python:
        pairs_of_shell = literal.replace(":none", "=").replace(":", "=") if name in _MAPPINGS else literal
        return f"{shell} {shell_word(pairs_of_shell)}"
    if name in _MAPPINGS and ":" in literal:
        pairs = (pair.partition(":") for pair in literal.split(","))
        return f"{name}={ {key: _python_value(other) for key, _, other in pairs} }"
    if name in _LISTS:
        return f"{name}={[_python_value(item) for item in literal.split(',')]}"
    return f"{name}={_PYTHON_VALUES.get(literal, repr(literal))}"


def _python_value(text: str) -> str | int | None:
    """Return a name, an index or None as a Python literal."""
    return int(text) if text.isdecimal() else None if text in ("", "none") else text


_PYTHON_VALUES: Mapping[str, str] = {"yes": "True", "no": "False"}


def _code_spans(text: str) -> str:
    """Mark the text between backticks as code."""
    parts = text.split("`")
    if len(parts) % 2 == 0:
        return text
    return "".join(f"<code>{part}</code>" if k % 2 else part for k, part in enumerate(parts))
