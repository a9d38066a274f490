"""Texts and numbers as all formats can hold them: ASCII, no line that a comment could end in."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

from gmwm.exporters.reduction import Number
from gmwm.remarks import Remark, Severity, texts

if TYPE_CHECKING:
    from gmwm.calibration import Calibration

_WIDTH = 100
_DOUBTFUL_UNITS = ("gravity-off", "unit-overruled")
_ASCII = {
    "²": "^2", "³": "^3", "·": " ", "≤": "<=", "±": "+-", "β": "beta", "σ": "sigma", "°": "deg",
    "µ": "u", "…": "...", "τ": "tau", "“": '"', "”": '"', "’": "'", "×": "x", "−": "-",
}  # fmt: skip


def recording(calibration: Calibration) -> list[str]:
    """What was calibrated, in words, and what makes its numbers doubtful."""
    source = f"{calibration.source}, " if calibration.source else ""
    digest = calibration.recording.sha256 if calibration.recording is not None else None
    extent = next(iter(calibration.values())).wavelet_variance.extent
    said = [f"Recording: {source}{extent}{f', SHA-256 {digest}' if digest else ''}."]
    return [*said, *(f"CAUTION: {text}" for text in texts(cautions(calibration)))]


def cautions(calibration: Calibration) -> list[Remark]:
    """What makes the numbers doubtful: remarks that say that they may be wrong, and doubts about units."""
    return [
        remark for remark in calibration.remarks if remark.severity <= Severity.WRONG or remark.code in _DOUBTFUL_UNITS
    ]


def plain(text: str) -> str:
    """A text in ASCII on one line, which no comment can end in: for names and files that come from elsewhere.

    >>> plain("a√Hz * / -- b\\nc")
    'asqrt(Hz) * / -- b c'
    """
    text = re.sub(r"√(\w+)", r"sqrt(\1)", text).replace("√", "sqrt")
    for sign, written in _ASCII.items():
        text = text.replace(sign, written)
    text = "".join(c if c.isprintable() else " " for c in text).encode("ascii", "replace").decode("ascii")
    # A backslash at the end of a line would carry a comment of C++ over to the next.
    return " ".join(text.replace("\\", "/").replace("*/", "* /").split())


def unended(line: str) -> str:
    """A line of plain text that cannot end a comment of XML.

    >>> unended("a --> b")
    'a - -> b'
    """
    while "--" in line:
        line = line.replace("--", "- -")
    return line


def commented(paragraphs: Sequence[str], mark: str) -> list[str]:
    """Paragraphs as lines of comment."""
    return [
        line
        for text in paragraphs
        for line in textwrap.wrap(
            plain(text), _WIDTH, initial_indent=f"{mark} ", subsequent_indent=f"{mark}   ", break_on_hyphens=False
        )
    ]


def written(number: Number | float) -> str:
    """A number as all the formats here read it, with seven digits.

    >>> written(1.0), written(1.25e-7)
    ('1.000000e+00', '1.250000e-07')
    """
    return f"{number.value if isinstance(number, Number) else number:.6e}"


def written_rate(rate: float) -> str:
    """A rate (Hz) with six digits: those of one that was counted from time stamps are not known to more.

    >>> written_rate(200.0), written_rate(200.00116000672804)
    ('200.0', '200.001')
    """
    return repr(float(f"{rate:.6g}"))


def limit_mark(number: Number) -> str:
    """What stands behind a number that is an upper limit."""
    return "  upper limit" if number.upper else ""
