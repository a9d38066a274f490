"""Warnings on reading: the remarks that every caller of `read` must see."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping

from gmwm.errors import GmwmWarning, InferredUnitWarning, TimeBaseWarning
from gmwm.remarks import Remark

STAMPS = ("stamps-backward", "stamps-repeated", "stamps-jitter", "samples-lost")
"""Codes of remarks on all rows, which are known at the end of a live stream."""

_CATEGORIES: Mapping[str, type[GmwmWarning]] = {
    "unit-inferred": InferredUnitWarning,
    "unit-doubtful": GmwmWarning,
    "rate-contradicted": TimeBaseWarning,
    "losses-regular": TimeBaseWarning,
    "axis-dead": GmwmWarning,
    **dict.fromkeys(STAMPS, TimeBaseWarning),
    "samples-lost": GmwmWarning,
}
"""The category of the warning for each remark that is also a warning."""


def of_file(remarks: Iterable[Remark], path: object) -> tuple[Remark, ...]:
    """The remarks, with the file as the subject of those that are also warnings and are not about an axis."""
    return tuple(
        remark.about(str(path)) if remark.code in _CATEGORIES and not remark.subject else remark for remark in remarks
    )


def warn(remarks: Iterable[Remark], stacklevel: int) -> None:
    """Warn of the remarks that are also warnings; `stacklevel` as in a `warnings.warn` of the caller."""
    for remark in remarks:
        category = _CATEGORIES.get(remark.code)
        if category is not None:
            warnings.warn(category(remark), stacklevel=stacklevel + 1)
