"""Format numbers, durations, lists of names and tables as text."""

from __future__ import annotations

import re
import textwrap
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cache
from html import escape
from importlib import metadata
from typing import Any, TypeVar
from unicodedata import category

T = TypeVar("T")

TEXT_WIDTH = 80  # largest number of columns of a text on a terminal, its usual width


def wrap_text(text: str, begin: str = "") -> list[str]:
    """Break a text into lines of at most 80 columns. The first one has `begin` in front, the others blanks.

    >>> wrap_text("one " * 30, "- ")[1]
    '  one one one one one one one one one one one'
    """
    blanks = " " * len(begin)
    return textwrap.wrap(text, TEXT_WIDTH, initial_indent=begin, subsequent_indent=blanks, break_on_hyphens=False)


@cache
def version() -> str:
    """Return the version of the installed package. Each look-up parses its metadata, which takes 1 ms."""
    return metadata.version("gmwm")


def counted(number: int, noun: str) -> str:
    """Format a number with its noun, in the plural unless the number is 1.

    >>> counted(1, "knock"), counted(3, "sample")
    ('1 knock', '3 samples')
    """
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def with_article(noun: str) -> str:
    """Put the indefinite article before a noun: "an" before a vowel letter.

    >>> with_article("Imu"), with_article("SimulatedImu")
    ('an Imu', 'a SimulatedImu')
    """
    return f"{'an' if noun[:1].lower() in tuple('aeiou') else 'a'} {noun}"


def round_text(value: float, digits: int = 2) -> str:
    """Format a number with few significant digits, without an exponent below a million.

    >>> round_text(744.7), round_text(-0.01234), round_text(2.34e6), round_text(2.0)
    ('740', '-0.012', '2.3e+06', '2')
    """
    return f"{float(f'{value:.{digits}g}'):g}"


_HYPHEN_OF_NUMBER = re.compile(r"(?<![\w.=−-])(?<!fixed\()-(?=\.?\d|inf\b)")


def with_minus(text: str) -> str:
    """Write the signs of negative numbers as minus signs. Exponents, options and models stay as programs read them.

    >>> with_minus("-0.5 (-1e-05 … 20-25), --scale x=-2, AR1(phi=fixed(-0.3))")
    '−0.5 (−1e-05 … 20-25), --scale x=-2, AR1(phi=fixed(-0.3))'
    """
    return _HYPHEN_OF_NUMBER.sub("−", text)


def gap_text(share: float) -> str:
    """Format the gap of a certificate as a percentage, at least 0.001 %: smaller ones are rounding errors.

    >>> gap_text(9.7e-5), gap_text(0.0), gap_text(1e-12)
    ('0.0097 %', '0.001 %', '0.001 %')
    """
    return f"{100 * max(share, 1e-5):.2g} %"


def round_fixed(model: str) -> str:
    """Return the text of a model with its fixed values rounded to four digits. Files have all digits.

    >>> round_fixed("DR + MA(1, theta1=fixed(0.16732089037064277))")
    'DR + MA(1, theta1=fixed(0.1673))'
    """
    return re.sub(r"(?<=fixed\()[-+.e\d]+", lambda number: f"{float(number[0]):.4g}", model)


_DURATIONS = (("years", 365.25 * 86400.0, 730.5 * 86400.0), ("d", 86400.0, 172800.0), ("h", 3600.0, 7200.0),
              ("min", 60.0, 120.0), ("s", 1.0, 0.0))  # fmt: skip
"""Unit, its length (s), and the shortest duration (s) that is written in this unit."""


def duration_text(seconds: float, digits: int = 2) -> str:
    """Format a duration in seconds with a readable unit; whole units are not rounded further.

    >>> duration_text(0.05), duration_text(114.7), duration_text(11520.0, 3), duration_text(5e5), duration_text(1e9)
    ('0.05 s', '115 s', '3.2 h', '5.8 d', '32 years')
    """
    unit, size = next((unit, size) for unit, size, least in _DURATIONS if seconds >= least)
    integer_digits = len(f"{seconds / size:.0f}") if seconds < 1e3 * size else 0
    return f"{round_text(seconds / size, max(digits, integer_digits))} {unit}"


def moment(seconds: float) -> str:
    """Format a time in seconds to the millisecond, without an exponent, as options of commands read it.

    >>> moment(600.01), moment(43200.2504), moment(1718000000.0)
    ('600.01 s', '43200.25 s', '1718000000 s')
    """
    return f"{seconds:.3f}".rstrip("0").rstrip(".") + " s"


def length_text(seconds: float) -> str:
    """Format a length in seconds exactly, as options of commands read it.

    >>> length_text(1170.0), length_text(4500.5), length_text(0.0), length_text(7200.0)
    ('19min30s', '1h15min0.5s', '0s', '2h')
    """
    hours, minutes = divmod(seconds // 60, 60.0)
    parts = [f"{value:.10g}{unit}" for value, unit in ((hours, "h"), (minutes, "min"), (seconds % 60, "s")) if value]
    return "".join(parts) or "0s"


def list_text(names: Sequence[str], most: int = 6) -> str:
    """Format a list of names. Of a long list, only the first names and the number of the others appear.

    >>> list_text("abcdefgh"), list_text(["time", "pressure"])
    ('a, b, c, d, e, f and 2 others', 'time, pressure')
    """
    others = len(names) - most
    return ", ".join(names) if others < 2 else f"{', '.join(names[:most])} and {others} others"


def shorten(text: str, most: int = 1000) -> str:
    """Shorten text that has more than `most` characters, by cutting out its middle.

    >>> shorten("abcdefghij", 5)
    'ab … ij'
    """
    return text if len(text) <= most else f"{text[: most // 2]} … {text[-(most // 2) :]}"


def printable(text: str) -> str:
    r"""Return text with escapes for control characters and marks, which could change the terminal, and for bytes of
    file names that are not UTF-8.

    >>> printable("gyro\x1b[2J\udcff\u202e\n")
    'gyro\\x1b[2J\\xff\\u202e\n'
    """
    if text.isprintable():
        return text
    return "".join(map(_printable, text))


def _printable(character: str) -> str:
    code = ord(character)
    if 0xDC80 <= code <= 0xDCFF:  # see `os.fsdecode`
        return f"\\x{code - 0xDC00:02x}"
    if character in "\n\t" or character.isprintable():
        return character
    if code < 0x20 or 0x7F <= code < 0xA0:
        return f"\\x{code:02x}"
    # Marks that change the direction of text, separators of lines, and halves of characters, which no file can hold.
    return ascii(character)[1:-1] if category(character) in ("Cf", "Zl", "Zp", "Cs") else character


def html_table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table as HTML. All texts are escaped."""
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    body = "".join(f"<tr>{''.join(f'<td>{escape(text)}</td>' for text in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


class Summarised(ABC):
    """Base of results whose notebook representation is their `summary()`."""

    @abstractmethod
    def summary(self) -> str:
        """Return the result as text."""

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.summary())}</pre>"


def p_text(p: float) -> str:
    """Format a p-value with three decimals, or as "< 0.001".

    >>> p_text(0.04251), p_text(2e-9)
    ('0.043', '< 0.001')
    """
    return f"{p:.3f}" if p >= 0.001 else "< 0.001"


def p_relation(p: float) -> str:
    """Format a p-value like `p_text`, with "=" or "<" in front.

    >>> p_relation(0.04251), p_relation(2e-9)
    ('= 0.043', '< 0.001')
    """
    return p_text(p) if p < 0.001 else f"= {p_text(p)}"


def is_own(kind: type) -> bool:
    """Return whether a class belongs to gmwm."""
    return kind.__module__.partition(".")[0] == __name__.partition(".")[0]


def defined_anew(kind: type, older: type) -> bool:
    """Return whether a class is a new version of a user's class, for example after a notebook cell was run again."""
    return not is_own(older) and (kind.__module__, kind.__qualname__) == (older.__module__, older.__qualname__)


class Named(dict[str, T]):
    """A dict whose KeyError lists the names, each a `noun` such as "parameter", or says `why` a name is missing.

    >>> Named({"WN.sigma2": 1.0}, "parameter")["foo"]
    Traceback (most recent call last):
    ...
    KeyError: "there is no parameter 'foo', only WN.sigma2"
    """

    def __init__(
        self, values: Mapping[str, T] | Iterable[tuple[str, T]], noun: str, why: Mapping[str, str] | None = None
    ) -> None:
        super().__init__(values)
        self._noun, self._why = noun, dict(why or {})

    def __missing__(self, name: object) -> T:
        if isinstance(name, str) and name in self._why:
            raise KeyError(self._why[name])
        raise KeyError(f"there is no {self._noun} {name!r}, only {', '.join(self) or 'none'}")

    def __reduce__(self) -> tuple[Any, ...]:
        return Named, (dict(self), self._noun, self._why)


def align(rows: Sequence[Sequence[str]], right: Collection[int] = (), indent: str = "  ") -> list[str]:
    """Format the rows of a table, two blanks between columns; those in `right` are aligned to the right.

    >>> for line in align([["parameter", "value"], ["N", "0.21"]], right={1}):
    ...     print(repr(line))
    '  parameter  value'
    '  N           0.21'
    """
    if not rows:
        return []
    rows = [[with_minus(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = zip(row, widths, strict=True)
        texts = [text.rjust(width) if k in right else text.ljust(width) for k, (text, width) in enumerate(cells)]
        lines.append(indent + "  ".join(texts).rstrip())
    return lines


def table_with_rule(rows: Sequence[Sequence[str]]) -> list[str]:
    """Format a table of numbers with a rule below its first row. The first column is aligned to the left.

    >>> print("\\n".join(table_with_rule([["axis", "N"], ["gyro_x", "0.21"]])))
      axis       N
      ────────────
      gyro_x  0.21
    """
    head, *lines = align(rows, right=range(1, len(rows[0])))
    return [head, "  " + "─" * (max(map(len, (head, *lines))) - 2), *lines]
