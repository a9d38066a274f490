"""The remarks on a recording, as far as they concern its calibration."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from gmwm._text import rounded
from gmwm.calibration.averaging import WALK
from gmwm.inspection.findings import in_datasheet_units, removed
from gmwm.remarks import Remark

if TYPE_CHECKING:
    from gmwm.calibration.result import AxisCalibration

_LINE = "linear-trend"
_RAMP = "R"
"""Symbol of the rate ramp in a datasheet."""


def as_concerns(remarks: Sequence[Remark], axes: Mapping[str, AxisCalibration]) -> Iterator[Remark]:
    """Name the numbers of the datasheets in remarks on trends and coarse outputs.

    A remark on a linear trend is left out for an axis whose model has a drift, which describes it.

    Parameters
    ----------
    remarks : sequence of Remark
        The remarks of the inspection.
    axes : mapping of axis to AxisCalibration
        The calibrated axes.
    """
    for remark in remarks:
        found = axes.get(remark.subject)
        if remark.code == "conditions-removed" and found is not None and found.regression is not None:
            yield removed(remark.subject, found.regression, _left_in(found))
            continue
        affected = remark.facts.get("numbers")
        if found is None or not isinstance(affected, tuple):
            yield remark
            continue
        sheet = found.datasheet
        ramp = sheet.get(_RAMP)
        if remark.code == _LINE and ramp is not None and ramp.value and not ramp.upper_only:
            continue
        numbers = tuple(symbol for symbol in sheet if symbol.partition("[")[0] in affected)
        facts = {**remark.facts, "numbers": numbers or ("the terms at long scales",)}
        yield Remark.of(remark.code, remark.subject, **facts)


def _left_in(found: AxisCalibration) -> str:
    """What K would be if the effect of the conditions were left in; "" if it would not be larger."""
    entry, value = found.datasheet.get(WALK), found.left_in
    if not value:
        return ""
    if entry is not None and entry.value and not entry.upper_only:
        ratio = value / entry.value
        return f"K would be {rounded(ratio)} times as large" if ratio > 1 else ""
    shown = in_datasheet_units(value, -0.5, found.fit.wavelet_variance.unit)
    return f"K would be {rounded(shown.value)} {shown.unit}"
