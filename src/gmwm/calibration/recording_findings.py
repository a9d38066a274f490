"""Remarks on a recording that affect its calibration."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from fnmatch import fnmatchcase
from typing import Any

from gmwm.base.remarks import Quantity, Remark
from gmwm.base.text import round_text
from gmwm.calibration.averaging import WALK
from gmwm.calibration.number_verdicts import is_small
from gmwm.calibration.result import AxisCalibration
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.inspection import Inspection
from gmwm.measuring.inspection.findings import in_datasheet_units, of_units, removal_remark

_LINE = "linear-trend"
_RAMP = "R"  # symbol of the rate ramp in a datasheet


def recording_remarks(inspection: Inspection, axes: Mapping[str, AxisCalibration]) -> Iterator[Remark]:
    """Yield the remarks of an inspection that matter, with affected numbers. Trends and swings that the model
    describes, and knocks, which were replaced, are left out."""
    for remark in inspection.remarks:
        if remark.code == "knocks":
            continue
        # A remark on a file, or on one of the files of a pattern, counts for all axes.
        if remark.subject == inspection.source or fnmatchcase(remark.subject, inspection.source):
            remark = remark.about("")
        axis_calibration = axes.get(remark.subject)
        if axis_calibration is not None and _is_modelled(remark, axis_calibration.fit):
            continue
        if (
            remark.code == "conditions"
            and remark.facts["case"] == "removed"
            and axis_calibration is not None
            and axis_calibration.regression is not None
        ):
            yield removal_remark(remark.subject, axis_calibration.regression, _left_in(axis_calibration))
            continue
        if remark.facts.get("case") == "density" and axis_calibration is not None:
            yield from of_units({remark.subject: axis_calibration.datasheet["N"].value})
            continue
        affected = remark.facts.get("numbers")
        if axis_calibration is None or not isinstance(affected, tuple) or not affected:
            yield remark
            continue
        sheet = axis_calibration.datasheet
        if remark.code == "warm-up" and _hides_white_noise(inspection, remark.subject, sheet["N"].value):
            yield Remark.of("too-short", remark.subject, case="warm-up", numbers=("N", "B", "K"))
        ramp = sheet.get(_RAMP)
        if remark.code == _LINE and ramp is not None and ramp.value and not ramp.upper_only:
            affected = ("K",)  # a filter has no drift, so that its K contains the line (docs/concepts/two-numbers.md)
        numbers = tuple(symbol for symbol in sheet if symbol.partition("[")[0] in affected)
        raised = tuple(symbol for symbol in numbers if not is_small(remark, sheet[symbol]))
        if numbers and not raised:
            code = "trend" if remark.code == _LINE else remark.code
            yield Remark.of(code, remark.subject, **{**remark.facts, "case": "small", "numbers": ()})
            continue
        facts = {**remark.facts, "numbers": raised or ("the terms at long scales",)}
        yield Remark.of(remark.code, remark.subject, **facts)


def _hides_white_noise(inspection: Inspection, axis: str, white: float) -> bool:
    """Return whether a warm-up adds more than 5 % to the Allan variance N²/T of white noise at T = 1 s, over which a
    filter predicts: half of its mean square slope."""
    for trend in inspection.trends:
        if trend.axis == axis and trend.tau is not None:
            ratio = inspection.duration / trend.tau
            square = (trend.size / trend.tau) ** 2 * -math.expm1(-2 * ratio) / (2 * ratio)
            return square / 2 > 0.05 * white**2
    return False


def pairs_facts(pairs: tuple[str, ...]) -> dict[str, Any]:
    """Return the facts of pairs of axes in the order of their correlations; a sentence names at most `NAMED`."""
    # A sentence names three pairs of axes at most, because six axes have 15 pairs.
    return {
        "pairs": pairs, "count": len(pairs), "strongest": pairs[:3], "many": "yes" if len(pairs) > 3 else "no",
    }  # fmt: skip


def _is_modelled(remark: Remark, fit: Fit) -> bool:
    """Return whether a remark is on a swing of the mean that is a line of the model, so that K does not contain it."""
    period, rate = remark.facts.get("period"), fit.wavelet_variance.rate
    if remark.facts.get("case") != "swing" or not isinstance(period, Quantity):
        return False
    lines = [line[1] for process in fit.model.processes if (line := process.line(rate)) is not None]
    return any(math.isclose(abs(cycles) * rate * period.value, 1, rel_tol=1e-6) for cycles in lines)


def _left_in(found: AxisCalibration) -> str:
    """Return a text with K that would result if the effect of the conditions were not removed; "" if not larger."""
    entry, value = found.datasheet.get(WALK), found.left_in
    if not value:
        return ""
    if entry is not None and entry.value and not entry.upper_only:
        ratio = value / entry.value
        return f"K would be {round_text(ratio)} times as large" if ratio > 1 else ""
    shown = in_datasheet_units(value, -0.5, found.fit.wavelet_variance.unit)
    return f"K would be {round_text(shown.value)} {shown.unit}"
