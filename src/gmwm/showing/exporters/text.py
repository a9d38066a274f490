"""Format text and numbers for exported files, in ASCII and without characters that could end a comment."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence

from gmwm.base.remarks import Remark, Severity, with_groups
from gmwm.base.text import list_text
from gmwm.calibration import Calibration
from gmwm.calibration.recording_findings import pairs_facts
from gmwm.calibration.summary_text import extent_text
from gmwm.fitting.estimation.result import GIVEN
from gmwm.measuring.inspection.findings import covariates_text, effect_text
from gmwm.showing.exporters.reduction import Number

_WIDTH = 116
REST = "All models, intervals and remarks: report.html of the calibration, or `calibration.report()`."
"""Last comment line of a file."""
_ASCII = {
    "²": "^2", "³": "^3", "·": " ", "≤": "<=", "±": "+-", "β": "beta", "σ": "sigma", "°": "deg",
    "µ": "u", "…": "...", "τ": "tau", "“": '"', "”": '"', "’": "'", "×": "x", "−": "-",
}  # fmt: skip


def recording(calibration: Calibration) -> str:
    """Return a sentence on the recording: source, length, rate, checksum, and subtracted effects."""
    if is_given(calibration):
        return f"Source: {calibration.source}. These numbers were given, and not measured by gmwm."
    source = f"{calibration.source_name}, " if calibration.source else ""
    digests = checksums(calibration)
    # Sensors with different clocks can have different rates and lengths.
    extents: dict[float, str] = {}
    for fit in sorted(calibration.values(), key=lambda fit: fit.wavelet_variance.filled):
        extents.setdefault(fit.wavelet_variance.rate, fit.wavelet_variance.extent)
    apart = len({(fit.wavelet_variance.samples, fit.wavelet_variance.rate) for fit in calibration.values()})
    extent = " and ".join(extents.values()) if apart == len(extents) else extent_text(calibration)
    return (
        f"Recording: {source}{extent}{f', SHA-256 {list_text(digests)}' if digests else ''}.{_conditions(calibration)}"
    )


def checksums(calibration: Calibration) -> list[str]:
    """Return the SHA-256 of each file of a calibration that has one."""
    single = calibration.recording
    recordings = [single] if single else calibration.recordings.values()
    return list(dict.fromkeys(item.sha256 for item in recordings if item.sha256))


def is_given(calibration: Calibration) -> bool:
    """Return whether the noise parameters were given instead of measured."""
    return all(fit.weighting == GIVEN for fit in calibration.values())


def _conditions(calibration: Calibration) -> str:
    """Return a sentence on the effects that were subtracted from the axes, or "" if there are none."""
    parts = [
        f"{covariates_text(one)} from {axis}{f' in {name}' if name else ''}, {effect_text(one)}"
        for axis, found in calibration.axes.items() for name, one in found.regressions.items()
    ]  # fmt: skip
    return f" Effects removed before the noise was measured: {'; '.join(parts)}." if parts else ""


def cautions(calibration: Calibration) -> list[Remark]:
    """Return the remarks that every file contains: on values that may be wrong by a large factor, on doubtful units,
    and on noise that axes share, because no file has cross-covariances between axes."""
    found = [
        remark
        for remark in calibration.remarks
        if remark.severity <= Severity.WRONG or remark.code == "unit-contradicted"
    ]
    pairs = [remark.facts["pairs"] for remark in calibration.remarks if "pairs" in remark.facts]
    shared = tuple(dict.fromkeys(str(pair) for some in pairs if isinstance(some, tuple) for pair in some))
    return [Remark.of("noise-shared", case="file", **pairs_facts(shared)), *found] if shared else found


def paragraphs(remarks: Iterable[Remark]) -> list[str]:
    """Return remarks as paragraphs. First come the remarks that affect the values, marked as cautions."""
    texts = [(group[0].severity <= Severity.BIASED, text) for group, text in with_groups(remarks)]
    return [f"CAUTION: {text}" for severe, text in texts if severe] + [text for severe, text in texts if not severe]


def laid_out(head: Sequence[str], body: Sequence[str], notes: Sequence[str], mark: str) -> str:
    """Return a file: the verdict in the first three lines, the numbers, and at most 15 lines of notes as comments."""
    return "\n".join([*commented(shortened(head), mark), "", *body, "", *commented_notes(notes, mark)]) + "\n"


def shortened(head: Sequence[str]) -> list[str]:
    """Return the title and the verdict of a file, which together have at most three lines."""
    title, *rest = head
    return [title, *(textwrap.shorten(plain(text), 2 * _WIDTH - 20, placeholder=" ...") for text in rest)]


def commented_notes(notes: Sequence[str], mark: str) -> list[str]:
    """Return paragraphs as at most 15 comment lines, the last of which says where the rest is."""
    lines: list[str] = []
    for note in notes:
        more = commented([note], mark)
        if len(lines) + len(more) < 15:
            lines += more
    return [*lines, *commented([REST], mark)]


def plain(text: str) -> str:
    """Return text as one line of ASCII that cannot end a comment. This is needed for names from other sources.

    >>> plain("a√Hz * / -- b\\nc")
    'asqrt(Hz) * / -- b c'
    """
    text = re.sub(r"√(\d+\.\d+|\w+)", r"sqrt(\1)", text).replace("√", "sqrt")
    for sign, written in _ASCII.items():
        text = text.replace(sign, written)
    if not text.isprintable():
        text = "".join(c if c.isprintable() else " " for c in text)
    text = text.encode("ascii", "replace").decode("ascii")
    # A backslash at the end of a line would continue a C++ comment on the next line.
    return " ".join(text.replace("\\", "/").replace("*/", "* /").split())


def unended(line: str) -> str:
    """Return a line of plain text that cannot end an XML comment.

    >>> unended("a --> b")
    'a - -> b'
    """
    while "--" in line:
        line = line.replace("--", "- -")
    return line


def commented(texts: Sequence[str], mark: str) -> list[str]:
    """Return paragraphs as comment lines."""
    return [
        line
        for text in texts
        for line in textwrap.wrap(
            plain(text), _WIDTH, initial_indent=f"{mark} ", subsequent_indent=f"{mark}   ", break_on_hyphens=False
        )
    ]


def written(number: Number | float) -> str:
    """Format a number with seven digits, in a form that all programs can read.

    >>> written(1.0), written(1.25e-7)
    ('1.000000e+00', '1.250000e-07')
    """
    return f"{number.value if isinstance(number, Number) else number:.6e}"


def written_rate(rate: float) -> str:
    """Format a rate (Hz) with six digits, because a rate measured from time stamps is not more precise.

    >>> written_rate(200.0), written_rate(200.00116000672804)
    ('200.0', '200.001')
    """
    return repr(float(f"{rate:.6g}"))


def row_mark(numbers: Sequence[Number]) -> str:
    """Return the comment after a row of three values that states which of them are upper limits.

    >>> row_mark([Number(1.0, False), Number(2.0, True), Number(3.0, True)])
    '  upper limit: y, z'
    """
    limits = [letter for letter, number in zip("xyz", numbers, strict=True) if number.upper]
    return f"  upper limit: {', '.join(limits)}" if limits else ""


def limit_mark(number: Number) -> str:
    """Return the comment after a value if it is an upper limit, otherwise ""."""
    return "  upper limit" if number.upper else ""
