"""Create the remarks on a fleet and its statistics."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from gmwm.applications.fleets.outlier_units import LEAST_UNITS_FOR_OUTLIERS
from gmwm.base.axis_names import sensor_of
from gmwm.base.remarks import Remark, sorted_remarks

if TYPE_CHECKING:
    from polars import DataFrame

    from gmwm.applications.fleets.statistics_result import FleetNumber, FleetStatistics

LEAST_UNITS = 3
"""Least units for a spread and a prediction. With two, the 95 % interval of a spread is 0.45 to 32 times as large."""


def remarks_of(found: FleetStatistics) -> list[Remark]:
    """Return all remarks on the statistics of a fleet, the most severe first."""
    return sorted_remarks(_remarks(found))


def of_units(table: DataFrame, units: int, failed: int) -> Iterator[Remark]:
    """Yield remarks on failed units, rejected models and outlying samples, from the table of a fleet."""
    if failed:
        yield Remark.of("not-calibrated", case="fleet", failed=failed, units=units)
    if "p_value" in table.columns:
        tested = table["p_value"].drop_nulls()
        if rejected := int((tested < 0.05 / max(len(tested), 1)).sum()):  # significance level of all tests together
            yield Remark.of("model-rejected", case="fleet", rejected=rejected, tested=len(tested))
    if "contaminated" in table.columns:
        tested = table["contaminated"].drop_nulls()
        if contaminated := int(tested.sum()):
            yield Remark.of("outliers-found", case="fleet", contaminated=contaminated, tested=len(tested))


def _remarks(found: FleetStatistics) -> Iterator[Remark]:
    sensors = {sensor_of(row.axis) for row in found.rows}
    single = [row for row in found.rows if row.axis not in sensors]
    yield from _of_outliers(found, single)
    if 1 < found.units <= LEAST_UNITS:
        yield Remark.of("few-units", case="fleet", units=found.units)
    for count in range(1, LEAST_UNITS):
        few = [row for row in single if row.units == count]
        yield from _each(
            "few-units", few, single, case="number", units=count, least=LEAST_UNITS, fewest=LEAST_UNITS_FOR_OUTLIERS
        )
    few = [row for row in single if not row.searched and row.units >= LEAST_UNITS]
    yield from _each("not-compared", few, single, case="few", fewest=LEAST_UNITS_FOR_OUTLIERS)
    yield from _of_limits(single)
    uncertain = [row for row in single if (row.error_share or 0) > 0.5]
    yield from _each("poorly-known", uncertain, single, case="spread")
    partial = [row for row in single if row.model is not None and row.left_out]
    for model in dict.fromkeys(row.model or "" for row in partial):
        alike = [row for row in partial if row.model == model]
        yield from _each("not-compared", alike, single, case="model", model=model)
    unknown = [row for row in single if row.model is None and row.left_out]
    yield from _each("not-compared", unknown, single, case="interval")
    for difference in found.differences:
        if difference.differs:
            yield Remark.of("axes-differ", f"{difference.symbol} of {difference.sensor}")
    if any(row.predicted_high is not None for row in found.rows):
        yield Remark.of("uncalibrated-unit")


def _of_outliers(found: FleetStatistics, single: Sequence[FleetNumber]) -> Iterator[Remark]:
    units = list(dict.fromkeys(outlier.unit for outlier in found.outliers))
    for unit in units:
        yield Remark.of("units-outlying", unit, case="units", count=len(units))
    if not units and any(row.searched for row in single):
        yield Remark.of("check-passed", case="fleet", size=found.size)
    # If a tenth of the units are outliers, the search ended at its limit (outlier_units.SHARE).
    many = [row for row in single if row.outliers and row.outliers >= max(2, 0.1 * row.units)]
    yield from _each("units-outlying", many, single, case="many")


def _of_limits(rows: Sequence[FleetNumber]) -> Iterator[Remark]:
    for row in rows:
        if row.shown_by:
            yield Remark.of("shown-by-few", _name(row), case="few", shown=row.shown_by, limited=row.limited)
    limited = [row for row in rows if row.limited and row.units and not row.signed and not row.shown_by]
    yield from _each("not-compared", limited, rows, case="limits")
    for row in rows:
        if row.below:
            yield Remark.of("shown-by-few", _name(row), case="below", units=row.below)


def _each(code: str, rows: Iterable[FleetNumber], every: Iterable[FleetNumber], **facts: str | int) -> Iterator[Remark]:
    """Yield one remark for each group of parameters that concern the same axes."""
    for subject in _groups(rows, every):
        yield Remark.of(code, subject, **facts)


def _name(row: FleetNumber) -> str:
    return f"{row.symbol} of {row.axis}"


def _groups(rows: Iterable[FleetNumber], every: Iterable[FleetNumber]) -> list[str]:
    """Return names of groups of parameters, such as "Q, N of gyro" (all its axes) and "K of gyro_y"."""
    axes: dict[str, list[str]] = {}
    complete: dict[str, list[str]] = {}
    for groups_of, numbers in ((axes, rows), (complete, every)):
        for row in numbers:
            groups_of.setdefault(row.symbol, []).append(row.axis)
    groups: dict[tuple[str, ...], list[str]] = {}
    for symbol, names in axes.items():
        missing = [axis for axis in complete[symbol] if axis not in names]
        incomplete = {sensor_of(axis) for axis in missing} | {""}
        short = dict.fromkeys(axis if sensor_of(axis) in incomplete else sensor_of(axis) for axis in names)
        groups.setdefault(tuple(short), []).append(symbol)
    return [f"{', '.join(symbols)} of {', '.join(names)}" for names, symbols in groups.items()]
