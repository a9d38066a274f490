"""A calibration in words: for each sensor a table in the units of datasheets, then what to know or do about it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from gmwm._tables import headed
from gmwm._text import counted, rounded
from gmwm.calibration.misfit import about_rejected
from gmwm.calibration.tables import SENSORS, WIDTH, bulleted, in_order, key, number, wrapped
from gmwm.cautions import ALONE, LONGEST, OR_ROBUST
from gmwm.covariance.design import Design
from gmwm.filters import find_filter
from gmwm.inference.goodness import usable_in, usable_levels
from gmwm.inference.planning import SEEN, length_text
from gmwm.outliers import HUGE
from gmwm.signals import by_sensor

if TYPE_CHECKING:
    from gmwm.calibration.result import AxisCalibration, Calibration
    from gmwm.variance import WaveletVariance

SIZE = 0.05
"""Of the goodness-of-fit tests of all axes together."""
SCALES = 6
"""Levels that a test can use, below which a recording is too short for numbers to be used."""
WANTED = 0.2
"""Relative standard error for which lengths are given where a parameter is poorly known."""

_FIRST = "[1]"
_RAMP = "R"
"""Symbol of the rate ramp in a datasheet."""


def summary(calibration: Calibration) -> str:
    """The whole text, at most 80 columns wide."""
    parts = [_head(calibration)]
    for sensor, axes in by_sensor(calibration.axes).items():
        parts.append([SENSORS.get(sensor, sensor or "Axes"), *_table(axes)])
    parts.append(_legend(calibration))
    said = advice(calibration)
    if said:
        parts.append(["What to know before using them:", *(line for text in said for line in bulleted(text))])
    return "\n\n".join("\n".join(lines) for lines in parts if lines)


# --- the head and the tables ------------------------------------------------------------------------


def _head(calibration: Calibration) -> list[str]:
    shapes = list(_alike(calibration.axes))
    samples = _range([str(n) for n, _ in sorted(shapes)])
    rate = _range([f"{rate:g}" for rate in sorted(rate for _, rate in shapes)])
    duration = _range([length_text(seconds) for seconds in sorted(n / rate for n, rate in shapes)])
    lines = [f"Calibration{' of ' + calibration.source if calibration.source else ''}"]
    lines.append(f"{samples} samples at {rate} Hz, {duration}; best model within {calibration.settings.within}")
    return [line for text in lines for line in wrapped(text)]


def _alike(axes: Mapping[str, AxisCalibration]) -> dict[tuple[int, float], list[str]]:
    """The axes of each length (samples) and rate (Hz): those of one recording are all alike."""
    shapes: dict[tuple[int, float], list[str]] = {}
    for axis, found in axes.items():
        wv = found.fit.wavelet_variance
        shapes.setdefault((wv.samples, wv.rate), []).append(axis)
    return shapes


def _range(ascending: Sequence[str]) -> str:
    """The first and the last, or the one that they are."""
    first, last = ascending[0], ascending[-1]
    return first if first == last else f"{first} to {last}"


def _table(axes: Mapping[str, AxisCalibration]) -> list[str]:
    """A column for each axis, a row for each number that one of them has; as many side by side as there is room for."""
    lines: list[str] = []
    for count in (3, 2, 1):
        lines = _blocks(axes, count)
        if max(map(len, lines)) <= WIDTH:
            break
    return lines


def _blocks(axes: Mapping[str, AxisCalibration], count: int) -> list[str]:
    """Tables of `count` axes each, one under the other."""
    names = list(axes)
    lines: list[str] = []
    for start in range(0, len(names), count):
        chosen = {axis: axes[axis] for axis in names[start : start + count]}
        lines += [*([""] if lines else []), *headed(rows_of(chosen))]
    return lines


def rows_of(axes: Mapping[str, AxisCalibration]) -> list[list[str]]:
    """The table of some axes: model, fit and outliers, then a row for each number in the units of datasheets."""
    found = list(axes.values())
    rows = [
        ["", *axes],
        ["model", *(one.fit.model.structure.replace(" ", "") for one in found)],
        ["as good", *(_others(one) for one in found)],
        ["p of the fit", *("no test" if one.test is None else one.test.pvalue_in_words for one in found)],
        ["outliers", *(_outliers(one) for one in found)],
    ]
    # The only Gauss-Markov term of one axis stands beside the first of several of another.
    several = {symbol for one in found for symbol in one.datasheet if symbol.endswith(_FIRST)}
    columns = [
        {f"{symbol}{_FIRST}" if f"{symbol}{_FIRST}" in several else symbol: entry for symbol, entry in sheet.items()}
        for sheet in (one.datasheet for one in found)
    ]
    for symbol in in_order([list(column) for column in columns]):
        entries = [column.get(symbol) for column in columns]
        unit = next(entry.in_units("datasheet")[3] for entry in entries if entry is not None)
        rows.append([f"{symbol} ({unit})", *("" if entry is None else number(entry) for entry in entries)])
    return rows


def _others(found: AxisCalibration) -> str:
    others = len(found.ranking.equivalent) - 1
    return "no other" if others < 1 else counted(others, "other")


def _outliers(found: AxisCalibration) -> str:
    if found.verdict is None:
        return "not looked for"
    if not np.any(found.verdict.tested):
        return "not tested"
    if not found.verdict.contaminated:
        return "none"
    return "yes: left out" if found.fit.wavelet_variance.robust else "yes: kept"


def _legend(calibration: Calibration) -> list[str]:
    named = key(entry for found in calibration.axes.values() for entry in found.datasheet.entries)
    level = calibration.settings.confidence
    return wrapped(
        f"{named}. ±: half the {100 * level:g} % interval; ≤: upper limit at {50 + 50 * level:g} %. As good: models "
        "that the data cannot tell from the best; the simplest of them is taken. p: of a worse fit if the model is "
        "right."
    )


def cautions(warnings: Sequence[str], robust: Literal["auto"] | bool, line: str | None = None) -> tuple[str, ...]:
    """What an inspection warns of, for who has estimated already, within a model that may have a line."""
    done = {"auto": "; where outliers matter, the robust curve was taken", True: "; the robust curve was taken"}
    third = done.get(robust, ", or take the robust curve, which leaves them out")
    if line is not None and robust == "auto":
        third = f": no robust curve goes with {line} in `within`"
    return tuple(text.replace(OR_ROBUST, third).replace(LONGEST, ALONE) for text in warnings)


# --- what to know and do ----------------------------------------------------------------------------


def advice(calibration: Calibration) -> list[str]:
    """What to know or do before the numbers are used, a text each."""
    axes = calibration.axes
    said = [f"{axis} is not calibrated: {why}" for axis, why in calibration.failed.items()]
    said += [*_about_shortness(axes), *calibration.cautions]
    for about in (_about_outliers, _about_test, _about_drift, _about_errors):
        said += about(calibration)
    said += _together({axis: [*_untested(found), *found.notes] for axis, found in axes.items()})
    shapes = _alike(axes)
    for names in shapes.values():
        of_these = f"{', '.join(names)}: " if len(shapes) > 1 else ""
        said.append(of_these + _about_length(axes[names[0]]))
    return said


def _about_shortness(axes: Mapping[str, AxisCalibration]) -> list[str]:
    """Recordings of so few scales that their numbers are hardly any."""
    counts = {axis: int(np.count_nonzero(usable_levels(found.fit.wavelet_variance))) for axis, found in axes.items()}
    if not (few := {axis: count for axis, count in counts.items() if count < SCALES}):
        return []
    number = _range([str(count) for count in sorted(few.values())])
    return [
        f"{', '.join(few)}: so short a recording shows {number} scales well, and {SCALES} is the least from which "
        "anything can be told: this is a trial of the plumbing, not a calibration. Record for hours"
    ]


def _untested(found: AxisCalibration) -> list[str]:
    """Why outliers could not be looked for, where they could not."""
    if found.verdict is None or np.any(found.verdict.tested):
        return []
    return [f"outliers were not looked for: {replace(found.verdict, axis='').summary()}"]


def _about_outliers(calibration: Calibration) -> list[str]:
    struck = {axis: found for axis, found in calibration.axes.items() if found.verdict and found.verdict.contaminated}
    said = []
    if left := _those(struck, lambda found: found.fit.wavelet_variance.robust):
        said.append(
            f"outliers raise the classical curve of {_excesses(struck, left)}. The robust curve was fitted, which "
            "leaves them out; if your filter will meet them too, it needs more noise than this, or must reject them"
        )
    if kept := _those(struck, lambda found: not found.fit.wavelet_variance.robust):
        # What is left for "auto" to keep them: a line in `within`.
        way = (
            "no robust curve goes with a sinusoid in `within`, so cut the outliers out"
            if calibration.settings.robust == "auto"
            else "the robust curve leaves them out"
        )
        said.append(
            f"outliers raise the classical curve of {_excesses(struck, kept)}, and it was fitted with them; {way}"
        )
    if above := [f"{axis} at {scales}" for axis in left if (scales := _lighter(struck[axis]))]:
        said.append(
            f"the robust curve lies above the classical one: {', '.join(above)}. The steps of a coarse output or a "
            "periodic disturbance do that, and what was fitted is too large there; with the knocks cut out, the "
            "classical curve does better"
        )
    return said


def _lighter(found: AxisCalibration) -> str:
    """Scales where the robust curve is clearly the larger one."""
    verdict = found.verdict
    if verdict is None or not np.any(verdict.lighter):
        return ""
    return ", ".join(f"{tau:.3g} s" for tau in verdict.tau[verdict.lighter])


def _excesses(axes: Mapping[str, AxisCalibration], names: Sequence[str]) -> str:
    """By how much the classical curve of each axis lies above the robust one at most, and at what scale."""
    parts = []
    for axis in names:
        verdict = axes[axis].verdict
        assert verdict is not None
        worst = int(np.argmax(np.where(verdict.exceeding, verdict.excess, -np.inf)))
        excess = float(verdict.excess[worst])
        much = f"{100 * excess:.0f} %" if excess < HUGE else f"a factor of {rounded(1 + excess)}"
        parts.append(f"{axis} (by {much} at {verdict.tau[worst]:.3g} s)")
    return ", ".join(parts)


def rejected(calibration: Calibration) -> list[str]:
    """Axes whose recommended model a test of the fit rejects, of all axes together at 5 %."""
    tested = {axis: found for axis, found in calibration.axes.items() if found.test is not None}
    limit = SIZE / max(len(tested), 1)
    return _those(tested, lambda found: found.test is not None and found.test.pvalue < limit)


def _about_test(calibration: Calibration) -> list[str]:
    return about_rejected({axis: calibration.axes[axis] for axis in rejected(calibration)})


def _about_drift(calibration: Calibration) -> list[str]:
    drifts = []
    for axis, found in calibration.axes.items():
        entry = found.datasheet.get(_RAMP)
        if entry is not None and entry.value and not entry.upper_only:
            value, _, _, unit = entry.in_units("datasheet")
            drifts.append(f"{axis} by {rounded(value)} {unit}")
    if not drifts:
        return []
    return [
        f"the output drifts: {', '.join(drifts)}. A sensor that warms up, or a temperature that changes, does that: "
        "cut the beginning off, or let it warm up first; a drift of one recording is not that of the next"
    ]


def _about_errors(calibration: Calibration) -> list[str]:
    said = []
    for axis, found in calibration.axes.items():
        if not found.needed:
            continue
        lengths = list(found.needed.values())
        finite = [seconds for seconds in lengths if seconds is not None and math.isfinite(seconds)]
        way = f"; {100 * WANTED:g} % takes {length_text(min(finite))}" if finite else ""
        if finite and max(finite) > min(finite):
            way += f" to {length_text(max(finite))}"
        way += " at most" if finite else ""
        if any(seconds == math.inf for seconds in lengths):
            way += "; of some a longer record hardly tells more: hold them with fixed(…), or take a smaller model"
        said.append(f"{axis}: {', '.join(found.needed)} known to no better than {100 * SEEN:g} %{way}")
    return said


def _together(notes: Mapping[str, Sequence[str]]) -> list[str]:
    """Each note once, after all the axes that it is of."""
    axes: dict[str, list[str]] = {}
    for axis, said in notes.items():
        for note in said:
            axes.setdefault(note, []).append(axis)
    return [f"{', '.join(names)}: {note}" for note, names in axes.items()]


def _about_length(found: AxisCalibration) -> str:
    wv = found.fit.wavelet_variance
    usable = wv.tau[usable_levels(wv)]
    longest = usable[-1] if usable.size else wv.tau[0]
    duration, scale = length_text(wv.samples / wv.rate), length_text(float(longest))
    said = f"{duration} of recording show scales up to {scale} well; "
    said += "what changes more slowly is known from a few swings only"
    if wv.segments and (unbroken := _longest_unbroken(wv)) > longest:
        said += (
            f". Without its gaps it would show scales up to {length_text(unbroken)}: a fit by maximum likelihood sees "
            "across them"
        )
    return said


def _longest_unbroken(wv: WaveletVariance) -> float:
    """The longest scale (s) that as many samples would show well without a gap."""
    levels = np.arange(1, wv.samples.bit_length())
    whole = Design(levels, wv.samples, rate=wv.rate, filter=find_filter(wv.filter), transform=wv.transform)
    usable = levels[usable_in(whole)]
    return float(2.0 ** usable[-1] / wv.rate) if usable.size else 0.0


def _those(axes: Mapping[str, AxisCalibration], which: Callable[[AxisCalibration], bool]) -> list[str]:
    return [axis for axis, found in axes.items() if which(found)]
