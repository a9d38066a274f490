"""Which column is which axis: by the user's word, by the format, or by the names in the header."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gmwm._text import counted, listed
from gmwm.errors import OptionError, ReadError
from gmwm.options import ROLES, Columns
from gmwm.readers.base import Layout
from gmwm.readers.column_names import clean, recognise
from gmwm.signals import AXES


@dataclass(frozen=True)
class Choice:
    """The columns that are read: their indices by role, and remarks."""

    columns: dict[str, int]
    notes: tuple[str, ...] = ()

    @property
    def axes(self) -> tuple[str, ...]:
        """The axes among the roles, gyroscopes first."""
        return tuple(axis for axis in AXES if axis in self.columns)


def choose(layout: Layout, columns: Columns | None, path: Path) -> Choice:
    """The columns to read.

    A mapping that names a column for at least one axis names them all; the time column is still found by
    its name unless the mapping has "time". A mapping to None leaves an axis out.

    Raises
    ------
    ReadError
        If no axis is found, or two columns could be the same one.
    OptionError
        If `columns` names a column that is not there.
    """
    if columns is not None and not isinstance(columns, Mapping):
        return _finished(Choice(_by_order(layout, columns, path)), layout, path)
    given = dict(columns or {})
    declared = {role: _index(layout, column, role, path) for role, column in given.items() if column is not None}
    exhaustive = any(role in AXES for role in declared)
    wanted = {"time", "temperature"} if exhaustive else set(ROLES)
    if not layout.named and not declared:
        raise ReadError(_nameless(layout, path))
    found, notes = _by_name(layout, wanted - set(given), set(declared.values()), path)
    return _finished(Choice(declared | found, notes), layout, path)


def described(layout: Layout) -> str:
    """The columns of a file for a message: names, or their number."""
    if layout.named:
        return ", ".join(channel.name or "(unnamed)" for channel in layout.channels)
    return f"{len(layout.channels)} columns without names"


def _finished(choice: Choice, layout: Layout, path: Path) -> Choice:
    taken = list(choice.columns.values())
    twice = next((k for k in taken if taken.count(k) > 1), None)
    if twice is not None:
        roles = " and ".join(role for role, k in choice.columns.items() if k == twice)
        raise OptionError(f"columns= gives one column ({layout.channels[twice].name or twice}) to {roles}")
    if not choice.axes:
        raise ReadError(
            f"{path} has no column that is known as an axis; found: {described(layout)}. Name the axes, such as "
            'columns={"gyro_x": "<column name or index>", …}'
        )
    others = [
        channel.name or str(k)
        for k, channel in enumerate(layout.channels)
        if k not in choice.columns.values() and (channel.name or layout.named is False)
    ]
    note = (f"columns left out: {listed(others)}",) if others else ()
    return Choice(choice.columns, (*choice.notes, *note))


def _by_order(layout: Layout, roles: Sequence[str | None], path: Path) -> dict[str, int]:
    """Roles given in the order of the columns, None or "" for a column to leave out."""
    if len(roles) != len(layout.channels):
        raise OptionError(
            f"columns= names {counted(len(roles), 'column')}, {path} has {len(layout.channels)} (first row: "
            f"{_shown(layout)}); give one name for each in their order, None to leave one out, or name them one by "
            'one, as columns={"gyro_x": 1, "gyro_y": 2}, by their names or numbers from 0'
        )
    return {role: k for k, role in enumerate(roles) if role}


def _index(layout: Layout, column: str | int, role: str, path: Path) -> int:
    """Index of a column given by name or index."""
    names = [channel.name for channel in layout.channels]
    if isinstance(column, int) and not isinstance(column, bool):
        if 0 <= column < len(names):
            return column
        raise OptionError(f"columns={{{role!r}: {column}}}: {path} has columns 0 to {len(names) - 1}")
    matches = [k for k, name in enumerate(names) if name == column]
    matches = matches or [k for k, name in enumerate(names) if name and clean(name) == clean(str(column))]
    if len(matches) == 1:
        return matches[0]
    asked = f"columns={{{role!r}: {column!r}}}"
    if matches:
        numbers = " or ".join(map(str, matches))
        raise OptionError(f"{asked} stands more than once in {path}; pass its number in place of the name: {numbers}")
    raise OptionError(f"{asked} is not in {path}; found: {described(layout)}")


def _by_name(layout: Layout, wanted: set[str], taken: set[int], path: Path) -> tuple[dict[str, int], tuple[str, ...]]:
    """Roles found by the format or by the names."""
    candidates: dict[str, list[int]] = {}
    for k, channel in enumerate(layout.channels):
        role = channel.axis or recognise(channel.name).axis
        if role in wanted and k not in taken:
            candidates.setdefault(role, []).append(k)
    notes = []
    for role, several in candidates.items():
        if len(several) == 1:
            continue
        names = [layout.channels[k].name for k in several]
        if role in AXES:
            which = " and ".join(f"{layout.channels[k].name!r} (number {k})" for k in several)
            typed = ", ".join(f'"{axis}": {found[0]}' for axis, found in candidates.items())
            raise ReadError(
                f"{path}: {which} could each be {role}; choose by the numbers of the columns, counted from 0, for "
                f"instance columns={{{typed}}}"
            )
        notes.append(f"{role}: taken from {names[0]!r}, not from {', '.join(map(repr, names[1:]))}")
    return {role: several[0] for role, several in candidates.items()}, tuple(notes)


def _shown(layout: Layout) -> str:
    return ", ".join(layout.first_row[:8]) + (", …" if len(layout.first_row) > 8 else "")


def _nameless(layout: Layout, path: Path) -> str:
    """The message for a file without names: its first row and what to type."""
    count = len(layout.channels)
    usual = {7: ("time", *AXES), 6: AXES, 4: ("time", *AXES[:3]), 3: AXES[:3], 2: ("time", "gyro_x"), 1: ("gyro_x",)}
    guess = usual.get(count, (*AXES, *["None"] * max(0, count - 6)))
    typed = ", ".join(role if role == "None" else f'"{role}"' for role in guess)
    return (
        f"{path} has {count} columns without names; the first row is: {_shown(layout)}. Say what they are, in "
        f"their order, for instance columns=[{typed}]"
    )
