"""Compare the units of a fleet to find outliers, and create the remarks on a fleet and its statistics."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.axis_names import sensor_of
from gmwm.base.random_effects import effects
from gmwm.base.remarks import Remark, sorted_remarks

if TYPE_CHECKING:
    from polars import DataFrame

    from gmwm.applications.fleets.statistics_result import FleetNumber, FleetStatistics

LEAST_UNITS_FOR_OUTLIERS = 8
"""Least units for a search for outliers; tests/fleets/test_statistics.py checks the false alarms."""
SHARE, MOST = 0.1, 100
"""Largest share and number of units that are tested as outliers. More would be another type of unit."""


@dataclass(frozen=True, eq=False)
class Deviants:
    """For each of m samples, the k units with the largest distances from the remaining units."""

    places: NDArray[np.int64]  # (m, k) indices of the units, in the order of removal; −1 if fewer units were tested
    distance: Matrix  # (m, k) t statistic of each unit relative to the remaining units
    pvalue: Matrix  # (m, k) p-value of each unit, for a sample without outliers


def looked_for(count: Vector) -> NDArray[np.int64]:
    """Return how many of `count` units are tested as outliers: a tenth and at least one, but none of a small fleet.

    >>> looked_for(np.array([7, 8, 20, 5000])).tolist()
    [0, 1, 2, 100]
    """
    return np.where(count < LEAST_UNITS_FOR_OUTLIERS, 0, np.clip(np.floor(SHARE * count), 1, MOST)).astype(np.int64)


def deviants(x: Matrix, s2: Matrix) -> Deviants:
    """Remove the farthest unit repeatedly, and test each removed unit against the remaining ones.

    For unit i with the estimate x_i and the standard error s_i (NaN in x is a missing estimate), the test statistic is

        t_i = (x_i − μ̂_{−i}) / v_i,   v_i² = τ̂²_{−i} + s_i² + Var μ̂_{−i},   ν_i = 2 v_i⁴ / Var v_i².

    Here μ̂_{−i} and τ̂²_{−i} are the mean and variance between the remaining units. The statistic has about a t
    distribution with ν_i degrees of freedom (Satterthwaite), at most n − 2. The unit is the farthest of n, so its
    p-value is multiplied by n. It is then replaced by the smallest p-value of this unit and the units removed later:
    all units up to the last significant one are outliers. If all s_i are zero, this is Rosner's generalised ESD
    procedure (1983, Technometrics 25, 165-172) with ν_i = n − 2."""
    from scipy.special import stdtr

    remaining = np.array(x, dtype=np.float64)
    tested = looked_for(np.isfinite(remaining).sum(axis=-1))
    shape = (remaining.shape[0], int(tested.max(initial=0)))
    places, distance, pvalue = np.full(shape, -1), np.full(shape, np.nan), np.ones(shape)
    everything = effects(remaining, s2)
    mean, spread2, error = everything.mean, everything.spread2, everything.error
    for k in range(shape[1]):
        rows = np.flatnonzero(tested > k)
        here, here2 = remaining[rows], s2[rows]
        # To find the farthest unit, the distance from the mean of all units (including this one) is sufficient.
        size2 = spread2[rows, None] + here2 - error[rows, None] ** 2
        scaled = np.abs(here - mean[rows, None]) / np.sqrt(np.maximum(size2, np.finfo(float).tiny))
        far = np.nanargmax(scaled, axis=1)
        each = np.arange(rows.size)
        value, error2, count = here[each, far], here2[each, far], np.isfinite(here).sum(axis=-1)
        here[each, far] = np.nan
        remaining[rows, far] = np.nan
        others = effects(here, here2, start=spread2[rows])
        mean[rows], spread2[rows], error[rows] = others.mean, others.spread2, others.error
        size2 = others.spread2 + error2 + others.error**2
        distance[rows, k] = (value - others.mean) / np.sqrt(size2)
        scatter = others.spread2_variance * (1 + others.error2_slope) ** 2
        # For a unit with a large standard error, Satterthwaite's formula gives more than n − 2, although τ̂² comes from
        # few units.
        freedom = np.minimum(2 * size2**2 / scatter, count - 2)
        chance = 2 * stdtr(freedom, -np.abs(distance[rows, k]))
        pvalue[rows, k] = np.minimum(1.0, count * chance)
        places[rows, k] = far
    return Deviants(places, distance, np.minimum.accumulate(pvalue[:, ::-1], axis=1)[:, ::-1])


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
