"""Find the column of each axis: by the `columns` option, by the format, or by the names in the header."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gmwm.base.errors import OptionError, ReadError
from gmwm.base.remarks import Remark
from gmwm.base.template import Fact, join_names
from gmwm.base.text import counted
from gmwm.base.units import AXES, POSITIONS, SI_UNIT, STANDARD_GRAVITY, axis_quantity
from gmwm.files.clock.text_stamps import is_date, is_stamp
from gmwm.files.columns.column_names import by_short_names, clean, mentioned_sensor, role_of
from gmwm.files.contract import Layout
from gmwm.recording.options import ROLES, Columns

_SENSORS = {"gyro": "gyroscopes", "accel": "accelerometers"}


@dataclass(frozen=True)
class ColumnChoice:
    """The columns to read, and their roles."""

    columns: dict[str, int]  # index of the column of each role: an axis, "time" or "temperature"
    # remarks on columns that are not read, and on a column that was chosen among several
    remarks: tuple[Remark, ...] = ()

    @property
    def axes(self) -> tuple[str, ...]:
        """The axes among the roles, gyroscopes first."""
        return tuple(axis for axis in (*AXES, *POSITIONS) if axis in self.columns)

    def only(self, axes: Sequence[str]) -> ColumnChoice:
        """Return the choice without the axes that are not in `axes`. The time and the temperature are kept."""
        columns = {role: k for role, k in self.columns.items() if role not in self.axes or role in axes}
        return ColumnChoice(columns, self.remarks)


def choose(layout: Layout, columns: Columns | None, path: Path) -> ColumnChoice:
    """Choose the columns to read. If `columns` names a column for at least one axis, only the named axes are read. The
    time column is still found by its name unless `columns` has "time". An axis whose column is None is left out."""
    if columns is not None and not isinstance(columns, Mapping):
        return _check_choice(ColumnChoice(_by_order(layout, columns, path)), layout, path, exhaustive=True)
    requested = dict(columns or {})
    declared = {role: _index(layout, column, role, path) for role, column in requested.items() if column is not None}
    exhaustive = not {*declared} <= {"time", "temperature"}
    roles = {"time", "temperature"} if exhaustive else set(ROLES)
    if not layout.named and not declared:
        raise ReadError(
            f"{path} has {len(layout.channels)} columns without names; the first row is {_first_cells(layout)}",
            code="columns-unnamed",
            advice="Name the columns in their order, for example {--columns=@example}.",
            example=_guess(layout),
        )
    named, remarks = _by_name(layout, roles - set(requested), set(declared.values()), path)
    chosen = ColumnChoice(declared | named, remarks)
    return _check_choice(chosen, layout, path, exhaustive=not {*requested} <= {"time", "temperature"})


def describe_columns(layout: Layout) -> str:
    """Describe the columns of a file for a message: their names, or their number."""
    if layout.named:
        return ", ".join(channel.name or "(unnamed)" for channel in layout.channels)
    return f"{len(layout.channels)} columns without names"


def _check_choice(choice: ColumnChoice, layout: Layout, path: Path, *, exhaustive: bool) -> ColumnChoice:
    """Check the choice, and add a remark on the columns that are not read."""
    indices = list(choice.columns.values())
    repeated = next((k for k in indices if indices.count(k) > 1), None)
    if repeated is not None:
        roles = " and ".join(role for role, k in choice.columns.items() if k == repeated)
        raise OptionError(
            f"column {layout.channels[repeated].name or repeated} of {path} is given to {roles}",
            argument="columns",
            advice="Name a different column for each with {--columns}.",
        )
    if not choice.axes:
        raise ReadError(
            f"{path} has no column whose name is known as an axis. Its columns: {describe_columns(layout)}",
            code="no-inertial-data",
            advice="Name the columns of the axes with {--columns}, for example {--columns=@example}.",
            example=_guess(layout),
        )
    others = {
        k: channel.name or str(k)
        for k, channel in enumerate(layout.channels)
        if k not in choice.columns.values() and channel.axis != "spare" and (channel.name or layout.named is False)
    }
    sensors = {} if exhaustive else _unread_sensors(others, choice, path)
    remarks = [Remark.of("sensor-columns-left-out", sensor, names=names) for sensor, names in sensors.items()]
    plain = tuple(name for name in others.values() if not any(name in names for names in sensors.values()))
    if plain:
        remarks.append(Remark.of("left-out", case="names", kind="columns", names=plain))
    return ColumnChoice(choice.columns, (*choice.remarks, *remarks))


def _unread_sensors(others: Mapping[int, str], choice: ColumnChoice, path: Path) -> dict[str, tuple[str, ...]]:
    """Return unread columns of sensors without three axes; raise an error if no column of one is read."""
    out: dict[str, tuple[str, ...]] = {}
    for sensor in SI_UNIT:
        axes = [axis for axis in choice.axes if axis_quantity(axis) == sensor]
        mentioned = {k: letter for k, name in others.items() for s, letter in (mentioned_sensor(name),) if s == sensor}
        if not mentioned or len(axes) == 3:
            continue
        names = tuple(others[k] for k in mentioned)
        if not axes and len(set(mentioned.values())) == len(mentioned) > 1:
            chosen = choice.columns | {f"{sensor}_{letter}": k for k, letter in mentioned.items()}
            raise ReadError(
                f"{path}: {join_names(names)} seem to be axes of the {_SENSORS[sensor]}, but their names are not known",
                code="columns-ambiguous",
                advice="Name the columns of all axes with {--columns=@example}, or leave these out with "
                "{--columns=@without}.",
                example=",".join(f"{role}:{k}" for role, k in sorted(chosen.items())),
                without=",".join(f"{role}:{k}" for role, k in sorted(choice.columns.items())),
            )
        out[sensor] = names
    return out


def _by_order(layout: Layout, roles: Sequence[str | None], path: Path) -> dict[str, int]:
    """Return the column indices of roles listed in the order of the columns; None or "" skips a column."""
    named = [k for k, channel in enumerate(layout.channels) if channel.name]
    if len(roles) == len(named):  # the column of row names has no name
        return {role: k for k, role in zip(named, roles, strict=True) if role}
    if len(roles) != len(layout.channels):
        raise OptionError(
            f"{counted(len(roles), 'column')} named, but {path} has {len(layout.channels)} columns (first row: "
            f"{_first_cells(layout)})",
            argument="columns",
            advice="Give one name for each column, or name single columns by name or number from 0, for example "
            "{--columns=gyro_x:1,gyro_y:2}.",
        )
    return {role: k for k, role in enumerate(roles) if role}


def _index(layout: Layout, column: str | int, role: str, path: Path) -> int:
    """Return the index of the column for a role, given by name or index."""
    names = [channel.name for channel in layout.channels]
    if isinstance(column, int) and not isinstance(column, bool):
        if 0 <= column < len(names):
            return column
        raise OptionError(
            f"{path} has no column number {column} for {role}; its columns are 0 to {len(names) - 1}",
            argument="columns",
        )
    matches = [k for k, name in enumerate(names) if name == column]
    matches = matches or [k for k, name in enumerate(names) if name and clean(name) == clean(str(column))]
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise OptionError(
            f"{path} has several columns {column!r}: numbers {join_names(list(map(str, matches)))}",
            argument="columns",
            advice="Pass a number instead of the name, for example {--columns=@example}.",
            example=f"{role}:{matches[0]}",
        )
    raise OptionError(
        f"{path} has no column {column!r} for {role}. Its columns: {describe_columns(layout)}", argument="columns"
    )


def _by_name(layout: Layout, wanted: set[str], used: set[int], path: Path) -> tuple[dict[str, int], tuple[Remark, ...]]:
    """Find the columns of the wanted roles by the format or by the names; columns in `used` are excluded."""
    candidates: dict[str, list[int]] = {}
    for k, channel in enumerate(layout.channels):
        role = role_of(channel)
        if role in wanted and k not in used:
            candidates.setdefault(role, []).append(k)
    for letter in "xyz":
        several = candidates.get(f"gyro_{letter}", [])
        in_g = [
            k for k in several if re.fullmatch(f"{letter}[ _]g|g[ _]{letter}", layout.channels[k].name.strip(), re.I)
        ]
        if in_g and len(in_g) < len(several) and f"accel_{letter}" in wanted - set(candidates):
            # Beside x_dps, the g of x_g is a unit.
            candidates |= {f"gyro_{letter}": [k for k in several if k not in in_g], f"accel_{letter}": in_g}
    for role, several in candidates.items():
        fixed = [k for k in several if layout.channels[k].axis == role]
        # Beside an acceleration, a linear acceleration is the one without gravity.
        whole = [k for k in several if not re.search("(?i)lin", layout.channels[k].name)]
        candidates[role] = fixed or whole or several
    if (stamp := _header_stamp(layout, candidates.get("time", []))) is not None:
        candidates["time"] = [stamp]
    remarks = []
    cells = layout.first_row if len(layout.first_row) == len(layout.channels) else ("0",) * len(layout.channels)
    names = ["" if k in used or not _has_value(cells[k]) else channel.name for k, channel in enumerate(layout.channels)]
    short = by_short_names(names, wanted - set(candidates))
    for group in (AXES[:3], AXES[3:], ("time",)):
        if roles := tuple(role for role in group if len(short.get(role, ())) == 1):
            taken = tuple(layout.channels[short[role][0]].name for role in roles)
            remarks.append(Remark.of("left-out", case="short", names=taken, roles=roles))
    candidates |= short
    for role, several in candidates.items():
        if len(several) == 1:
            continue
        names = [layout.channels[k].name for k in several]
        if role in AXES:
            which = join_names([f"{layout.channels[k].name!r} (number {k})" for k in several])
            raise ReadError(
                f"{path}: {which} could each be {role}",
                code="columns-ambiguous",
                advice="Choose by the numbers of the columns, counted from 0, for example {--columns=@example}.",
                example=",".join(f"{axis}:{places[0]}" for axis, places in candidates.items()),
            )
        others: Fact = tuple(names[1:])
        remarks.append(Remark.of("left-out", case="column", role=role, column=names[0], others=others))
    return {role: several[0] for role, several in candidates.items()}, tuple(remarks)


def _header_stamp(layout: Layout, times: Sequence[int]) -> int | None:
    """Return the ROS header stamp if other columns contain a time too, unless it is 0 (drivers that do not set it)."""
    for k in times:
        words = clean(layout.channels[k].name).casefold().replace("/", ".")
        if words.endswith("header.stamp") and len(times) > 1 and layout.first_row[k : k + 1] not in ((), ("0",)):
            return k
    return None


def _first_cells(layout: Layout) -> str:
    """Return the first cells of the first row, for a message."""
    return ", ".join(layout.first_row[:8]) + (", …" if len(layout.first_row) > 8 else "")


def _is_gravity(cells: Sequence[str]) -> bool:
    """Return whether the norm of three numbers is gravity in m/s², g or counts (2¹⁰ to 2¹⁴ per g), within 10 %."""
    try:
        norm = math.hypot(*map(float, cells))
    except ValueError:
        return False
    return any(abs(norm / gravity - 1) <= 0.1 for gravity in (STANDARD_GRAVITY, 1.0, *(2**k for k in range(10, 15))))


def _guess(layout: Layout) -> str:
    """Return an example of the option `columns`, from the number of columns that hold numbers, and from gravity."""
    count = len(layout.channels)
    cells = layout.first_row if len(layout.first_row) == count else ("0",) * count
    numbers = [k for k, cell in enumerate(cells) if layout.channels[k].name or not layout.named if _has_value(cell)]
    usual = {7: ("time", *AXES), 6: AXES, 4: ("time", *AXES[:3]), 3: AXES[:3], 2: ("time", "gyro_x"), 1: ("gyro_x",)}
    if any(map(is_date, cells)):
        usual |= {4: ("time", *POSITIONS[:3]), 2: ("time", "up")}
    guess = usual.get(len(numbers), AXES)
    if len(numbers) in (6, 7) and _is_gravity([cells[k] for k in numbers[-6:-3]]):
        guess = (*guess[:-6], *AXES[3:], *AXES[:3])
    if len(numbers) > 7:  # several sensors, or a sensor among other columns
        return ",".join(f"{role}:{k}" for role, k in zip(usual[7], numbers, strict=False))
    if count > 30 or len(numbers) not in usual:
        return ",".join(f"{axis}:{k}" for axis, k in zip(AXES[:3], numbers[1:] or range(3), strict=False))
    roles = dict(zip(numbers, guess, strict=True))
    named = [k for k in range(count) if layout.channels[k].name or not layout.named]
    return ",".join(roles.get(k, "") for k in named)


def _has_value(cell: str) -> bool:
    """Return whether a cell is a number, a date or a time stamp."""
    return (
        is_stamp(cell)
        or is_date(cell)
        or re.fullmatch(r"[-+]?[\d.,]+(?:[eE][-+]?\d+)?|nan", cell, re.IGNORECASE) is not None
    )


def parse_columns(text: str | None) -> dict[str, str | int | None] | list[str] | None:
    """Parse the text of the option `columns` to the mapping or list that `gmwm.read` takes.

    >>> parse_columns("time,gyro_x,,accel_z")
    ['time', 'gyro_x', '', 'accel_z']
    >>> parse_columns("gyro_x=wx,gyro_y=3,time=")
    {'gyro_x': 'wx', 'gyro_y': 3, 'time': None}
    """
    if text is None:
        return None
    parts = [part.strip() for part in text.split(",")]
    if "=" not in text:
        return parts
    columns: dict[str, str | int | None] = {}
    for part in parts:
        axis, mark, column = (piece.strip() for piece in part.partition("="))
        if not mark or not axis:
            expected = "a list of axes, or axis=COLUMN for each axis, such as gyro_x=wx,gyro_y=3"
            raise OptionError(argument="columns", expected=expected, got=part)
        columns[axis] = int(column) if column.isdecimal() else column or None
    return columns
