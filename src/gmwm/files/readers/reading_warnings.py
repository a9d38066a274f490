"""Select the remarks that `read` and `stream` also issue as Python warnings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from gmwm.base import reporting
from gmwm.base.errors import GmwmWarning, InferredUnitWarning, TimeBaseWarning
from gmwm.base.remarks import Remark

STAMPS = ("stamps-irregular", "samples-lost")
"""Codes of remarks that need all rows, and are known only at the end of a live stream."""

_CATEGORIES: Mapping[str, type[GmwmWarning]] = {
    "unit-inferred": InferredUnitWarning,
    "unit-doubtful": GmwmWarning,
    "rate-contradicted": TimeBaseWarning,
    "rate-ambiguous": TimeBaseWarning,
    "axis-dead": GmwmWarning,
    "sensor-columns-left-out": GmwmWarning,
    "stamps-irregular": TimeBaseWarning,
    "samples-lost": GmwmWarning,
}
"""Category of the Python warning, for each remark that is also a warning."""


def of_file(remarks: Iterable[Remark], path: object) -> tuple[Remark, ...]:
    """Set the file as the subject of remarks that are also warnings and do not concern an axis."""
    return tuple(
        remark.about(str(path)) if remark.code in _CATEGORIES and not remark.subject else remark for remark in remarks
    )


def warn(remarks: Iterable[Remark], stacklevel: int) -> None:
    """Issue the remarks that are also warnings. `stacklevel` is that of `warnings.warn` in the caller."""
    for remark in remarks:
        category = _CATEGORIES.get(remark.code)
        if category is not None:
            reporting.warn(category(remark), stacklevel=stacklevel + 1)
