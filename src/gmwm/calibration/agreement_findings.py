"""Remarks on an agreement between calibrations."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from gmwm.base.remarks import Remark, sorted_remarks
from gmwm.base.text import rounded
from gmwm.calibration.tables import number
from gmwm.measuring.variance.allan_regression import LAWS

if TYPE_CHECKING:
    from gmwm.calibration.agreement_result import Agreement, SharedNumber

_RAMP = "R"


def verdict_of(found: Agreement) -> Remark:
    """Return the verdict, a remark that states how many numbers were compared and how many of them differ."""
    differing = len(found.disagreeing)
    state = "none" if not found.compared else "all" if not differing else "one" if differing == 1 else "some"
    return Remark.of(
        "agreement", recordings=len(found.labels), compared=len(found.compared), differing=differing, size=found.size,
        state=state,
    )  # fmt: skip


def remarks_of(found: Agreement) -> list[Remark]:
    """Return all remarks on an agreement, the most severe first."""
    return sorted_remarks(_remarks(found))


def _remarks(found: Agreement) -> Iterator[Remark]:
    for row in found.disagreeing:
        yield _difference(row)
    for axis, labels in found.rejected.items():
        everywhere = len(labels) == sum(model is not None for model in found.models[axis])
        yield Remark.of("axis-rejected", axis, recordings=("all recordings",) if everywhere else labels)
    for row in found.disagreeing:
        if row.symbol == _RAMP:
            yield Remark.of("ramps-differ", _name(row))
    for axis, models in found.models.items():
        if len({model for model in models if model is not None}) > 1:
            yield Remark.of("models-differ", axis, numbers=tuple(LAWS))
    for row in found.rows:
        if row.reason == "kinds":
            yield Remark.of("bias-instability-kinds", _name(row))
        if row.reason == "one recording":
            yield Remark.of("single-recording", _name(row))
    for key in found.unmatched:
        yield Remark.of("reference-unused", key)


def _name(row: SharedNumber) -> str:
    return f"{row.symbol} of {row.axis}"


def _difference(row: SharedNumber) -> Remark:
    """Return the remark on a number that differs between recordings, with its values and p-value."""
    entries = [entry for entry in row.entries if entry is not None]
    unit = entries[0].in_units("datasheet")[3]
    return Remark.of(
        "numbers-differ", _name(row), values=tuple(number(entry) for entry in entries), unit=unit,
        p=row.adjusted if row.adjusted is not None else 1.0, sizes="no" if row.apart is None else "yes",
        apart="" if row.apart is None else apart_text(row.apart),
    )  # fmt: skip


def apart_text(share: float) -> str:
    """Format how far the largest value is from the smallest, given their ratio minus 1.

    >>> apart_text(0.12), apart_text(2.0)
    ('12 % between the largest and the smallest', 'a factor of 3 between the largest and the smallest')
    """
    size = f"{rounded(100 * share)} %" if share < 1 else f"a factor of {rounded(1 + share)}"
    return f"{size} between the largest and the smallest"
