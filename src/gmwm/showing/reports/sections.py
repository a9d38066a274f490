"""Sections that applications and other packages add to a report, found in one registry."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pkgutil import resolve_name
from typing import TYPE_CHECKING

from gmwm.base.extras import admit_guests

if TYPE_CHECKING:
    from gmwm.calibration.result import Calibration

GROUP = "gmwm.reports"
"""Group of the entry points of sections. The name of an entry point is the name of the section."""
ENTRY_POINTS = {"budget": "gmwm.applications.navigation.table:budget_section"}
"""Entry points of the package itself. They are loaded like those of other packages."""


@dataclass(frozen=True, kw_only=True)
class Section:
    """A section of a report.

    Attributes
    ----------
    title : str
        Heading.
    text : str
        A paragraph. Text between backticks is shown as code.
    rows : sequence of sequences of str
        Table with its heading in the first row; empty for none.
    remarks : sequence of str
        Paragraphs below the table, as HTML in which names from files are escaped.
    """

    title: str
    text: str = ""
    rows: Sequence[Sequence[str]] = ()
    remarks: Sequence[str] = ()


@cache
def _registry() -> dict[str, Callable[[Calibration], Section | None]]:
    registry = {name: resolve_name(place) for name, place in ENTRY_POINTS.items()}
    admit_guests(GROUP, registry.setdefault)
    return registry


def sections(calibration: Calibration) -> dict[str, Section]:
    """Return the sections of a report by name. A function that returns None adds no section."""
    contents = {name: function(calibration) for name, function in _registry().items()}
    return {name: section for name, section in contents.items() if section is not None}
