"""Write the summary of a fleet: number of units, a table for each sensor, outliers, and remarks."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from gmwm.base.remarks import Dialect, Remark, texts
from gmwm.base.text import TEXT_WIDTH, counted, p_relation, table_with_rule, wrap_text
from gmwm.base.units import letter_of, sensor_of, usual_unit
from gmwm.calibration.tables import SENSORS
from gmwm.choosing.datasheets.effective import TITLES
from gmwm.choosing.datasheets.entry import significant
from gmwm.measuring.variance.allan_regression import LAWS

if TYPE_CHECKING:
    from gmwm.applications.fleets.result import Fleet
    from gmwm.applications.fleets.statistics_result import AxisDifference, FleetNumber, FleetStatistics, OutlierUnit

_NONE = "–"
MOST_UNITS_LISTED = 10  # largest number of failed units and of outliers that a summary lists


def summary(fleet: Fleet, dialect: Dialect = Dialect.PYTHON) -> str:
    """Write the number of units, failures, tables, outliers and remarks, with at most 80 characters per line."""
    good = len(fleet.units) - len(fleet.failed)
    runs = f" ({fleet.done} now, {fleet.kept} before)" if fleet.kept and fleet.done else ""
    failures = f", {len(fleet.failed)} failed" if fleet.failed else ""
    parts = [wrap_text(f"Fleet of {counted(len(fleet.units), 'unit')}: {good} calibrated{runs}{failures}")]
    failed = [f"{unit}: {why}" for unit, why in fleet.failed.items()]
    parts.append(_entries(f"Failed ({counted(len(failed), 'unit')}):", failed))
    parts.append(_entries(f"No recordings, left out ({counted(len(fleet.left_out), 'file')}):", fleet.left_out))
    parts += _parts(fleet.statistics, fleet.remarks, dialect)
    return "\n\n".join("\n".join(lines) for lines in parts if lines)


def _entries(title: str, entries: Sequence[str]) -> list[str]:
    """Return a title and the first entries; nothing without entries."""
    shown = [line for entry in entries[:MOST_UNITS_LISTED] for line in wrap_text(entry, "- ")]
    more = [f"- and {len(entries) - MOST_UNITS_LISTED} more"] if len(entries) > MOST_UNITS_LISTED else []
    return [title, *shown, *more] if entries else []


def statistics_text(found: FleetStatistics) -> str:
    """Write the tables, outliers and remarks of statistics, with at most 80 characters per line."""
    head = wrap_text(f"Fleet of {counted(found.units, 'calibrated unit')}")
    parts = [head, *_parts(found, found.remarks, Dialect.PYTHON)]
    return "\n\n".join("\n".join(lines) for lines in parts if lines)


def _parts(found: FleetStatistics, remarks: Sequence[Remark], dialect: Dialect) -> list[list[str]]:
    parts = [[SENSORS.get(sensor, sensor), *_table(rows)] for sensor, rows in _by_sensor(found.rows).items()]
    parts.append(wrap_text(_legend(found)) if found.rows else ["No numbers to compare"])
    if found.outliers:
        shown = [line for item in found.outliers[:MOST_UNITS_LISTED] for line in wrap_text(_outlier(item), "- ")]
        more = len(found.outliers) - MOST_UNITS_LISTED
        parts.append(["Outliers:", *shown, *([f"- and {more} more numbers"] if more > 0 else [])])
    if differ := [item for item in found.differences if item.differs]:
        parts.append(["Axes that differ:", *(line for item in differ for line in wrap_text(_difference(item), "- "))])
    if lines := texts(remarks, dialect):
        parts.append(["What to know about the fleet:", *(line for text in lines for line in wrap_text(text, "- "))])
    return parts


def _by_sensor(rows: Iterable[FleetNumber]) -> dict[str, list[FleetNumber]]:
    sensors: dict[str, list[FleetNumber]] = {}
    names = [row.axis for row in rows]
    for row in rows:
        sensor = sensor_of(row.axis)
        # "gyro" stands for gyro_x, gyro_y and gyro_z, and is itself the name of a sensor.
        is_sensor = any(sensor_of(name) == row.axis for name in names)
        sensors.setdefault(row.axis if is_sensor or not sensor else sensor, []).append(row)
    return sensors


def _table(rows: Sequence[FleetNumber]) -> list[str]:
    heads = ["", "units", "typical", "spread", "5 % … 95 %", "further unit"]
    cells, last = [heads], ""
    for row in rows:
        unit, factor = usual_unit(row.unit)
        if row.symbol != last:
            cells.append([f"{row.symbol} ({unit})", *[""] * (len(heads) - 1)])
            last = row.symbol
        is_sensor = any(sensor_of(other.axis) == row.axis for other in rows)
        letter = "all axes" if is_sensor else letter_of(row.axis)
        cells.append([
            f"  {letter}", _units(row), _value(row.typical, factor), _spread_text(row, factor),
            _span(row.quantile_05, row.quantile_95, factor), _span(row.predicted_low, row.predicted_high, factor),
        ])  # fmt: skip
    lines = table_with_rule(cells)
    if max(map(len, lines)) > TEXT_WIDTH:
        lines = table_with_rule([[*row[:4], row[5]] for row in cells])
    return lines


def _units(row: FleetNumber) -> str:
    return f"{row.units}, {row.limited} ≤" if row.limited and not row.signed else f"{row.units}"


def _value(value: float | None, factor: float) -> str:
    return _NONE if value is None else significant(factor * value, 3)


def _spread_text(row: FleetNumber, factor: float) -> str:
    """Format the spread between units, or its upper limit if it is not significantly different from zero."""
    if row.spread is None or row.spread_low is None or row.spread_high is None:
        return _NONE
    measured = row.spread_low > 0
    size = row.spread if measured else row.spread_high
    if row.signed:
        return f"{'±' if measured else '≤ ±'} {significant(factor * size, 2)}"
    grown = math.expm1(size)
    if grown < 1:
        return f"{'±' if measured else '≤'} {100 * grown:.2g} %"
    return f"{'×' if measured else '≤ ×'} {significant(1 + grown, 2)}"


def _span(low: float | None, high: float | None, factor: float) -> str:
    """Format the two ends of a range, with enough digits to show its width."""
    if low is None or high is None:
        return _NONE
    low, high = factor * low, factor * high
    size, width = max(abs(low), abs(high)), abs(high - low)
    digits = 2
    if width > 0:
        digits = min(5, max(2, 2 + math.floor(math.log10(size)) - math.floor(math.log10(width))))
    return f"{significant(low, digits)} … {significant(high, digits)}"


def _legend(found: FleetStatistics) -> str:
    symbols = dict.fromkeys(row.symbol for row in found.rows)
    titles = {symbol: law.name for symbol, law in LAWS.items()} | {
        symbol: title for symbol, (title, _) in TITLES.items()
    }
    named = "; ".join(f"{symbol} {title}" for symbol, title in titles.items() if symbol in symbols)
    return (
        f"{named + '. ' if named else ''}units: number of values, and of upper limits (≤), which are not compared. "
        "typical, spread and further unit are without outliers. spread: standard deviation between units, without "
        "estimation error. 5 % … 95 %: quantiles of the estimates. further unit: its number lies in this range with "
        f"a probability of {100 * found.confidence:g} %."
    )


def _outlier(outlier: OutlierUnit) -> str:
    unit, factor = usual_unit(outlier.si)
    relation = "; typical is"
    if outlier.times is not None:
        times = (
            f"{100 * outlier.times:.0f} % of" if 0.5 < outlier.times < 2 else f"{significant(outlier.times, 2)} times"
        )
        relation = f", {times} the typical"
    value, typical = significant(factor * outlier.value, 3), significant(factor * outlier.typical, 3)
    name = f"{outlier.unit}, {outlier.axis} {outlier.symbol}"
    return f"{name}: {value} {unit}{relation} {typical}; p {p_relation(outlier.pvalue)}"


def _difference(difference: AxisDifference) -> str:
    unit, factor = usual_unit(difference.unit)
    # For a parameter with a sign, the text states the difference from the mean instead of the ratio.
    if any(value <= 0 for value in difference.relative.values()):
        apart = ", ".join(f"{axis} {significant(factor * off, 2)} {unit}" for axis, off in difference.relative.items())
    else:
        apart = ", ".join(f"{axis} {100 * (off - 1):+.2g} %" for axis, off in difference.relative.items())
    where = f"from the mean of the axes in {difference.units} units"
    return f"{difference.symbol}: {apart} {where}; p {p_relation(difference.adjusted)}"
