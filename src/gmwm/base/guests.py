"""Load what other installed packages add to gmwm through entry points."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib.metadata import entry_points
from typing import Any

from gmwm.base.errors import GmwmWarning
from gmwm.base.remarks import Remark
from gmwm.base.reporting import warn


@cache
def admit_guests(group: str, admit: Callable[[str, Any], object]) -> None:
    """Pass the name and the object of each entry point of a group, such as "gmwm.readers", to a registry, once. The
    search of all installed packages takes 10 ms and more, so registries call this late: when a name or a file is
    unknown, or when entries are listed. `admit` may raise any error, for example if the name is taken."""
    for point in entry_points(group=group):
        try:
            admit(point.name, point.load())
        except Exception as error:  # code of other packages can raise any error
            package = point.dist.name if point.dist is not None else point.value
            reason = f"{type(error).__name__}: {error}"
            remark = Remark.of("guest-unusable", name=point.name, group=group, package=package, reason=reason)
            warn(GmwmWarning(remark), stacklevel=2)
