"""A fleet in words: its units, a table for each sensor, units that are not like the others, and what to do about it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

from gmwm._tables import headed
from gmwm._text import counted
from gmwm.calibration.tables import SENSORS, WIDTH, bulleted, wrapped
from gmwm.datasheets.entry import significant
from gmwm.fleets.advice import LISTED, advice
from gmwm.signals import letter_of, sensor_of
from gmwm.units import datasheet_units
from gmwm.variance.slope_line import LAWS

if TYPE_CHECKING:
    from gmwm.fleets.statistics_result import AxisDifference, FleetNumber, FleetStatistics, OutlierUnit

_NONE = "–"
_REJECTED = 0.05


class FleetLike(Protocol):
    """What a fleet tells of itself."""

    @property
    def units(self) -> Sequence[str]:
        """All units."""
        ...

    @property
    def failed(self) -> Mapping[str, str]:
        """Units that could not be calibrated, and why."""
        ...

    @property
    def kept(self) -> int:
        """Units of earlier runs."""
        ...

    @property
    def done(self) -> int:
        """Units of this run."""
        ...

    @property
    def table(self) -> Any:
        """A row for each unit and axis."""
        ...

    @property
    def statistics(self) -> FleetStatistics:
        """What the units say together."""
        ...


def summary(fleet: FleetLike) -> str:
    """The whole text, at most 80 columns wide."""
    parts = [wrapped(_head(fleet))]
    if fleet.failed:
        parts.append([f"Failed ({counted(len(fleet.failed), 'unit')}):", *_failures(fleet.failed)])
    parts += _parts(fleet.statistics, [*_of_fits(fleet.table)])
    return "\n\n".join("\n".join(lines) for lines in parts if lines)


def statistics_text(found: FleetStatistics) -> str:
    """What the statistics say by themselves."""
    parts = [wrapped(f"Fleet of {counted(found.units, 'calibrated unit')}"), *_parts(found, [])]
    return "\n\n".join("\n".join(lines) for lines in parts if lines)


def _head(fleet: FleetLike) -> str:
    good = len(fleet.units) - len(fleet.failed)
    how = f" ({fleet.done} now, {fleet.kept} before)" if fleet.kept and fleet.done else ""
    failed = f", {len(fleet.failed)} failed" if fleet.failed else ""
    return f"Fleet of {counted(len(fleet.units), 'unit')}: {good} calibrated{how}{failed}"


def _failures(failed: Mapping[str, str]) -> Iterator[str]:
    for unit, reason in list(failed.items())[:LISTED]:
        # Many errors begin with the name of the file.
        yield from bulleted(reason if reason.startswith(unit) else f"{unit}: {reason}")
    if len(failed) > LISTED:
        yield f"- and {len(failed) - LISTED} more"


def _of_fits(table: Any) -> Iterator[str]:
    """How many fits a test rejects, and how many recordings have outliers; with all axes in mind."""
    if "p_value" in table.columns:
        tested = table["p_value"].drop_nulls()
        if count := int((tested < _REJECTED / max(len(tested), 1)).sum()):
            yield (
                f"a test of the fit rejects the model of {count} of {len(tested)} axes: their "
                "intervals are too narrow, and units seem to differ by more than they do"
            )
    if "contaminated" in table.columns:
        looked = table["contaminated"].drop_nulls()
        if count := int(looked.sum()):
            yield f"{count} of {len(looked)} axes have outliers in their samples, as from knocks: see those recordings"


def _parts(found: FleetStatistics, also: Sequence[str]) -> list[list[str]]:
    parts = [[SENSORS.get(sensor, sensor), *_table(rows)] for sensor, rows in _by_sensor(found.rows).items()]
    if not found.rows:
        return [*parts, wrapped("No unit gives a number that could be compared.")]
    parts.append(wrapped(_legend(found)))
    if found.outliers:
        shown = [line for one in found.outliers[:LISTED] for line in bulleted(_outlier(one))]
        more = len(found.outliers) - LISTED
        units = len({one.unit for one in found.outliers})
        head = f"{counted(units, 'unit')} {'is' if units == 1 else 'are'} not like the others:"
        parts.append([head, *shown, *([f"- and {more} more numbers of these or further units"] if more > 0 else [])])
    if differ := [one for one in found.differences if one.differs]:
        parts.append(["Axes that differ:", *(line for one in differ for line in bulleted(_difference(one)))])
    if said := [*advice(found), *also]:
        parts.append(["What to know and to do:", *(line for text in said for line in bulleted(text))])
    return parts


def _by_sensor(rows: Iterable[FleetNumber]) -> dict[str, list[FleetNumber]]:
    sensors: dict[str, list[FleetNumber]] = {}
    names = [row.axis for row in rows]
    for row in rows:
        sensor = sensor_of(row.axis)
        # Of "gyro", which stands for gyro_x, gyro_y and gyro_z, there is no sensor but itself.
        whole = any(sensor_of(name) == row.axis for name in names)
        sensors.setdefault(row.axis if whole or not sensor else sensor, []).append(row)
    return sensors


# --- the tables -------------------------------------------------------------------------------------


def _table(rows: Sequence[FleetNumber]) -> list[str]:
    heads = ["", "units", "typical", "apart", "5 % … 95 %", "a further unit"]
    cells, last = [heads], ""
    for row in rows:
        unit, factor = shown_unit(row.unit)
        if row.symbol != last:
            cells.append([f"{row.symbol} ({unit})", *[""] * (len(heads) - 1)])
            last = row.symbol
        whole = any(sensor_of(other.axis) == row.axis for other in rows)
        letter = "all axes" if whole else letter_of(row.axis)
        cells.append([
            f"  {letter}", _units(row), _value(row.typical, factor), _apart(row, factor),
            _span(row.quantile_05, row.quantile_95, factor), _span(row.predicted_low, row.predicted_high, factor),
        ])  # fmt: skip
    lines = headed(cells)
    if max(map(len, lines)) > WIDTH:
        lines = headed([[*row[:4], row[5]] for row in cells])
    return lines


def _units(row: FleetNumber) -> str:
    return f"{row.units}, {row.limited} ≤" if row.limited and not row.signed else f"{row.units}"


def _value(value: float | None, factor: float) -> str:
    return _NONE if value is None else significant(factor * value, 3)


def _apart(row: FleetNumber, factor: float) -> str:
    """The spread between units, or its limit where it is not seen."""
    if row.spread is None or row.spread_low is None or row.spread_high is None:
        return _NONE
    seen = row.spread_low > 0
    size = row.spread if seen else row.spread_high
    if row.signed:
        return f"{'±' if seen else '≤ ±'} {significant(factor * size, 2)}"
    grown = math.expm1(size)
    if grown < 1:
        return f"{'±' if seen else '≤'} {100 * grown:.2g} %"
    return f"{'×' if seen else '≤ ×'} {significant(1 + grown, 2)}"


def _span(low: float | None, high: float | None, factor: float) -> str:
    """Both ends, with as many digits as it takes to tell how far they are apart."""
    if low is None or high is None:
        return _NONE
    low, high = factor * low, factor * high
    size, width = max(abs(low), abs(high)), abs(high - low)
    digits = 2
    if width > 0:
        digits = min(5, max(2, 2 + math.floor(math.log10(size)) - math.floor(math.log10(width))))
    return f"{significant(low, digits)} … {significant(high, digits)}"


def shown_unit(si: str) -> tuple[str, float]:
    """The usual unit of datasheets, and the factor to it from SI; SI where there is none.

    >>> shown_unit("rad/s/√Hz")[0], shown_unit("s")
    ('deg/√h', ('s', 1.0))
    """
    return next(iter(datasheet_units(si).items()), (si, 1.0))


def _legend(found: FleetStatistics) -> str:
    symbols = dict.fromkeys(row.symbol for row in found.rows)
    named = "; ".join(f"{symbol} {law.name}" for symbol, law in LAWS.items() if symbol in symbols)
    return (
        f"{named + '. ' if named else ''}≤ beside units: only bounded, not compared. Typical, apart, a further unit: "
        "without outlier units. Apart: one standard deviation between units, error of estimation taken off. 5 % … 95 "
        f"%: of the estimates as they are. A further unit: it lies there with {100 * found.confidence:g} %."
    )


# --- sentences --------------------------------------------------------------------------------------


def _outlier(one: OutlierUnit) -> str:
    unit, factor = shown_unit(one.si)
    how = f", {_times(one.times)} the typical" if one.times is not None else "; typical is"
    chance = "p < 0.001" if one.pvalue < 0.001 else f"p = {one.pvalue:.3f}"
    value, typical = significant(factor * one.value, 3), significant(factor * one.typical, 3)
    return f"{one.unit}, {one.axis} {one.symbol}: {value} {unit}{how} {typical}; {chance}"


def _times(ratio: float) -> str:
    return f"{significant(ratio, 2)} times" if not 0.5 < ratio < 2 else f"{100 * ratio:.0f} % of"


def _difference(one: AxisDifference) -> str:
    chance = "p < 0.001" if one.adjusted < 0.001 else f"p = {one.adjusted:.3f}"
    unit, factor = shown_unit(one.unit)
    # Of a number with a sign there is no share of the mean, only a difference to it.
    if any(value <= 0 for value in one.relative.values()):
        apart = ", ".join(f"{axis} {significant(factor * off, 2)} {unit}" for axis, off in one.relative.items())
    else:
        apart = ", ".join(f"{axis} {100 * (off - 1):+.2g} %" for axis, off in one.relative.items())
    return f"{one.symbol}: {apart} off the mean of the axes in {one.units} units; {chance}"
