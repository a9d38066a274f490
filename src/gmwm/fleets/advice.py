"""What to know of a fleet's numbers, and what to do about them, in sentences."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from gmwm._text import counted
from gmwm.fleets.outlier_units import FEWEST
from gmwm.signals import sensor_of

if TYPE_CHECKING:
    from gmwm.fleets.statistics_result import FleetNumber, FleetStatistics

LISTED = 10
"""So many failures, outliers and names are told one by one."""
LEAST = 3
"""Units from which on a spread is told."""
MUCH = 0.5
"""Share of error in the scatter from which on it is told."""


def advice(found: FleetStatistics) -> list[str]:
    """Each thing to know or to do, in the order in which they matter."""
    single = [row for row in found.rows if _is_axis(row, found.rows)]
    said = []
    if found.outliers:
        said.append(
            "see the recordings of units that are not like the others (knocks, temperature, was it at rest?), and "
            "record them anew before they are thrown away"
        )
    elif any(row.searched for row in single):
        said.append(
            "no unit is unlike the others; the chance of a false alarm in a healthy fleet is "
            f"some {100 * found.size:g} %"
        )
    if 1 < found.units <= LEAST:
        said.append(
            f"{found.units} units are few for a fleet: `gmwm agree OUT/units/*.json` compares them with one another, "
            "number by number"
        )
    if few := [row for row in single if 0 < row.units < LEAST]:
        units = " or ".join(map(str, sorted({row.units for row in few})))
        said.append(
            f"{_named(few, single)}: {units} {'unit' if units == '1' else 'units'}, too few for a spread and for a "
            f"further unit (–), which take {LEAST}, and for outliers, which take {FEWEST}"
        )
    if few := [row for row in single if not row.searched and row.units >= LEAST]:
        said.append(f"{_named(few, single)}: fewer than {FEWEST} units to compare, outliers are not looked for")
    if many := [row for row in single if row.outliers and row.outliers >= max(2, 0.1 * row.units)]:
        said.append(f"{_named(many, single)}: as many outliers as are looked for; are the units all of one type?")
    said += _of_limits(single)
    if blurred := [row for row in single if (row.error_share or 0) > MUCH]:
        said.append(
            f"{_named(blurred, single)}: more than half of the scatter of units is error of estimation; longer "
            "recordings tell them apart, or that they are alike"
        )
    if tied := [row for row in single if row.model is not None and row.left_out]:
        said += [
            f"{_named(rows, single)}: compared between the units of the model {model} only"
            for model, rows in _by_model(tied).items()
        ]
    if unknown := [row for row in single if row.model is None and row.left_out]:
        said.append(
            f"{_named(unknown, single)}: of some units it is held, without an interval, or not determined; these are "
            "not compared"
        )
    if any(one.differs for one in found.differences):
        said.append("where axes differ, take the numbers of each axis, not those of all")
    if any(row.predicted_high is not None for row in found.rows):
        said.append(
            "for a unit that is not calibrated, give a filter the upper end of “a further unit”: noise that is taken "
            "for too small makes it sure of what is not so"
        )
    return said


def _is_axis(row: FleetNumber, rows: Iterable[FleetNumber]) -> bool:
    return not any(sensor_of(other.axis) == row.axis for other in rows)


def _of_limits(rows: Sequence[FleetNumber]) -> Iterator[str]:
    shown = [row for row in rows if row.shown_by]
    for row in shown:
        yield (
            f"{row.axis} {row.symbol}: shown by {_some(row.shown_by)} only, while {counted(row.limited, 'unit')} "
            f"{'has' if row.limited == 1 else 'have'} none that is seen: look at {'it' if row.units == 1 else 'them'}"
        )
    bounded = [row for row in rows if row.limited and row.units and not row.signed and not row.shown_by]
    if bounded:
        yield (
            f"{_named(bounded, rows)}: some units have no more than an upper limit and are not compared; typical "
            "and apart are of those that show it"
        )
    if under := [row for row in rows if row.below]:
        named = "; ".join(f"{row.axis} {row.symbol}: {_some(row.below, 3)}" for row in under)
        yield f"upper limits below where a further unit of those that show the number is expected: {named}"


def _by_model(rows: Iterable[FleetNumber]) -> dict[str, list[FleetNumber]]:
    models: dict[str, list[FleetNumber]] = {}
    for row in rows:
        models.setdefault(row.model or "", []).append(row)
    return models


def _named(rows: Iterable[FleetNumber], every: Iterable[FleetNumber]) -> str:
    """As "Q, N of gyro, accel_x; K of gyro_y": a sensor stands for all of its axes that have the number."""
    axes: dict[str, list[str]] = {}
    whole: dict[str, list[str]] = {}
    for found, given in ((axes, rows), (whole, every)):
        for row in given:
            found.setdefault(row.symbol, []).append(row.axis)
    groups: dict[tuple[str, ...], list[str]] = {}
    for symbol, names in axes.items():
        left = [axis for axis in whole[symbol] if axis not in names]
        open_ = {sensor_of(axis) for axis in left} | {""}
        short = dict.fromkeys(axis if sensor_of(axis) in open_ else sensor_of(axis) for axis in names)
        groups.setdefault(tuple(short), []).append(symbol)
    return "; ".join(f"{', '.join(symbols)} of {', '.join(names)}" for names, symbols in groups.items())


def _some(names: Sequence[str], most: int = LISTED) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
