"""Recognise numbers in text, and whether a comma is a decimal sign or separates thousands."""

from __future__ import annotations

import re
from collections.abc import Sequence

from gmwm.base.errors import ReadError
from gmwm.files.clock.text_stamps import is_stamp

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE)
_POINT_GROUPS = re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+(,\d*)?")
_COMMA_GROUPS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?")
WITHOUT_GROUPS = (rb"(?<=\d),(?=\d{3}(?!\d))", b"")
"""Replacement that removes the commas between thousands."""


def is_number(cell: str, decimal_comma: bool = False) -> bool:
    """Return whether a cell is a number, NaN or infinity."""
    return _NUMBER.fullmatch(cell.replace(",", ".", 1) if decimal_comma else cell) is not None


def is_grouped(cell: str) -> bool:
    """Return whether a cell may be a number whose points separate thousands, as programs with a decimal comma write it.

    >>> [cell for cell in ("5.000", "1.234.567,8", "0.500", "9.81", "5,000") if is_grouped(cell)]
    ['5.000', '1.234.567,8']
    """
    return _POINT_GROUPS.fullmatch(cell) is not None


def require_clear_commas(rows: Sequence[Sequence[str]], names: Sequence[str], where: str) -> None:
    """Raise an error if the commas of a column may separate thousands: exactly three digits follow each of them, and
    the file has decimal points too, or no comma that must be a decimal sign."""
    columns = list(zip(*rows, strict=True))
    commas = [[cell for cell in column if "," in cell and not is_stamp(cell)] for column in columns]
    grouped = [bool(cells) and all(map(_COMMA_GROUPS.fullmatch, cells)) for cells in commas]
    points = any("." in cell and is_number(cell) for column in columns for cell in column)
    proven = any(cells and not group for cells, group in zip(commas, grouped, strict=True))
    if not any(grouped) or (proven and not points):
        return
    k = grouped.index(True)
    cell, reason = commas[k][0], "decimal points" if points else "no other decimal sign"
    raise ReadError(
        f"{where}: {cell!r} in column {names[k] if names else k!r} may be {cell.replace(',', '')} or "
        f"{cell.replace(',', '.', 1)}, because three digits follow each comma, and the file has {reason}",
        code="decimal-comma",
        advice="State what the comma is: {--format=text:thousands} or {--format=text:decimal-comma}.",
    )
