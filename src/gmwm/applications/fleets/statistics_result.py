"""Statistics of a fleet, the search for outliers among its units, and its remarks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from gmwm.applications.fleets.summary_text import statistics_text
from gmwm.base.arrays import Integers, Matrix, Vector
from gmwm.base.documents import plain, plain_fields
from gmwm.base.lazy import polars, scipy
from gmwm.base.remarks import Remark, sorted_remarks
from gmwm.base.results import Difference, DifferenceTests
from gmwm.base.statistics import effects
from gmwm.base.units import sensor_of

LEAST_UNITS_FOR_OUTLIERS = 8
"""Least units for a search for outliers; tests/fleets/test_statistics.py checks the false alarms."""
SHARE, MOST = 0.1, 100
"""Largest share and number of units that are tested as outliers. More would be another type of unit."""


@dataclass(frozen=True, eq=False)
class Deviants:
    """For each of m samples, the k units with the largest distances from the remaining units."""

    places: Integers  # (m, k) indices of the units, in the order of removal; −1 if fewer units were tested
    distance: Matrix  # (m, k) t statistic of each unit relative to the remaining units
    pvalue: Matrix  # (m, k) p-value of each unit, for a sample without outliers


def looked_for(count: Vector) -> Integers:
    """Return how many of `count` units are tested as outliers: a tenth and at least one, but none of a small fleet."""
    return np.where(count < LEAST_UNITS_FOR_OUTLIERS, 0, np.clip(np.floor(SHARE * count), 1, MOST)).astype(np.int64)


def deviants(x: Matrix, s2: Matrix) -> Deviants:
    """Remove the farthest unit repeatedly, and test each removed unit against the remaining ones.

    For unit i with the estimate x_i (or NaN) and the standard error s_i, the test statistic is

        t_i = (x_i − μ̂_{−i}) / v_i,   v_i² = τ̂²_{−i} + s_i² + Var μ̂_{−i},   ν_i = 2 v_i⁴ / Var v_i²,

    with mean and variance between the remaining units, about t with ν_i ≤ n − 2 (Satterthwaite). p-values are
    multiplied by n, for the farthest, then replaced by the smallest of later removals: all up to the last significant
    one are outliers. With s_i = 0 it is Rosner's generalised ESD procedure (1983, Technometrics 25, 165-172)."""
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
        # For a large standard error, Satterthwaite's formula gives more than n − 2, although τ̂² comes from few units.
        freedom = np.minimum(2 * size2**2 / scatter, count - 2)
        chance = 2 * scipy.special.stdtr(freedom, -np.abs(distance[rows, k]))
        pvalue[rows, k] = np.minimum(1.0, count * chance)
        places[rows, k] = far
    return Deviants(places, distance, np.minimum.accumulate(pvalue[:, ::-1], axis=1)[:, ::-1])


LEAST_UNITS = 3
"""Least units for a spread and a prediction. With two, the 95 % interval of a spread is 0.45 to 32 times as large."""


def of_units(table: polars.DataFrame, units: int, failed: int) -> Iterator[Remark]:
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
    units = list(dict.fromkeys(outlier.unit for outlier in found.outliers))
    for unit in units:
        yield Remark.of("units-outlying", unit, case="units", count=len(units))
    if not units and any(row.searched for row in single):
        yield Remark.of("check-passed", case="fleet", size=found.size)
    # If a tenth of the units are outliers, the search ended at its limit (outlier_units.SHARE).
    many = [row for row in single if row.outliers and row.outliers >= max(2, 0.1 * row.units)]
    yield from _each("units-outlying", many, single, case="many")
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


SIGNED = "R"  # Symbol of the rate ramp. It has a sign, so its values are compared, not their logarithms.


@dataclass(frozen=True, kw_only=True)
class FleetNumber:
    """Statistics of one noise parameter of an axis, or of all axes of a sensor, over the units of a fleet.

    Values are in `unit`. The typical value, the spread and the prediction are computed without the outliers. The median
    and the quantiles include all estimates.

    Attributes
    ----------
    axis : str
        Name of the axis, such as "gyro_x", or of the sensor, such as "gyro", for all its axes together.
    symbol, unit : str
        Symbol of the parameter in a datasheet, and its SI unit.
    units : int
        Number of units that are compared: those that have a value with a confidence interval.
    limited : int
        Number of units with only an upper limit. They do not count in `units`, except for R, where they have the value
        zero ± limit.
    left_out : int
        Number of units that are not compared, because they have another model or unit, a fixed value or no confidence
        interval.
    model : str or None
        Noise model of the compared units, if the parameter is compared only between units with the same model;
        otherwise None.
    median, quantile_05, quantile_95 : float or None
        Median, 5 % quantile and 95 % quantile of the estimates.
    typical, typical_low, typical_high : float or None
        Typical value, exp μ̂ (for R, μ̂), and its confidence limits.
    spread, spread_low, spread_high : float or None
        Standard deviation τ̂ between units, without estimation errors, and its confidence limits. It is the standard
        deviation of the logarithm, so 0.1 is 10 % (for R, it is in `unit`).
    error : float or None
        Median of the standard errors of single units, on the same scale as `spread`.
    error_share : float or None
        error² / (spread² + error²), the share of estimation error in the variance of the estimates.
    predicted_low, predicted_high : float or None
        Prediction limits for the true value of a further unit.
    searched : bool
        Whether outliers were searched. The search needs at least 8 units and is made for single axes only.
    outliers : int
        Number of outliers.
    below : tuple of str
        Units whose upper limit is below `predicted_low`.
    shown_by : tuple of str
        The units with a value, if most other units have only an upper limit.
    """

    axis: str
    symbol: str
    unit: str
    units: int
    limited: int
    left_out: int
    model: str | None
    median: float | None
    quantile_05: float | None
    quantile_95: float | None
    typical: float | None
    typical_low: float | None
    typical_high: float | None
    spread: float | None
    spread_low: float | None
    spread_high: float | None
    error: float | None
    error_share: float | None
    predicted_low: float | None
    predicted_high: float | None
    searched: bool = False
    outliers: int = 0
    below: tuple[str, ...] = ()
    shown_by: tuple[str, ...] = ()

    @property
    def signed(self) -> bool:
        """Whether the parameter can be negative, so that its values are compared instead of their logarithms."""
        return self.symbol == SIGNED


@dataclass(frozen=True, kw_only=True)
class OutlierUnit:
    """A value of a unit that differs from the values of the other units by more than chance explains.

    Attributes
    ----------
    unit, axis, symbol : str
        Name of the unit and of the axis, and symbol of the parameter.
    value, low, high, typical : float
        The value with its confidence limits, and the typical value of the other units, in `si`.
    si : str
        SI unit of the values.
    times : float or None
        Ratio value / typical; None for R.
    distance : float
        Distance from the other units, divided by its standard deviation (spread between units and estimation errors).
    pvalue : float
        Probability of such a distance for any unit, axis and parameter of a healthy fleet.
    """

    unit: str
    axis: str
    symbol: str
    value: float
    low: float
    high: float
    typical: float
    si: str
    times: float | None
    distance: float
    pvalue: float


@dataclass(frozen=True, kw_only=True)
class AxisDifference:
    """Result of the test whether the axes of a sensor differ in one noise parameter, from differences within units.

    Attributes
    ----------
    sensor, symbol, unit : str
        Name of the sensor, symbol of the parameter and its SI unit.
    units : int
        Number of units in which all axes have a value.
    relative : mapping of axis to float
        Ratio of the geometric mean of each axis to the geometric mean of all axes. For R, the difference of the means.
    pvalue, adjusted : float
        p-value of Hotelling's test, and the p-value adjusted for the number of tests by Holm's method.
    differs : bool
        Whether `adjusted` is at most the significance level.
    """

    sensor: str
    symbol: str
    unit: str
    units: int
    relative: Mapping[str, float]
    pvalue: float
    adjusted: float
    differs: bool


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FleetStatistics(DifferenceTests):
    """Statistics of the noise parameters of a fleet of units.

    Attributes
    ----------
    rows : tuple of FleetNumber
        Statistics of each parameter, sorted by sensor and parameter. The row for all axes comes before the rows for
        single axes.
    outliers : tuple of OutlierUnit
        Outlying values, sorted by p-value.
    differences : tuple of AxisDifference
        Tests of the differences between axes, for each parameter of each sensor with several axes.
    confidence : float
        Confidence level of intervals and predictions.
    size : float
        Probability of any outlier in a healthy fleet.
    units : int
        Number of calibrated units.
    """

    rows: tuple[FleetNumber, ...]
    outliers: tuple[OutlierUnit, ...]
    differences: tuple[AxisDifference, ...]
    confidence: float
    size: float
    units: int
    _places: dict[tuple[str, str], int] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self._places.update({(row.axis, row.symbol): k for k, row in enumerate(self.rows)})

    def __getitem__(self, name: str) -> FleetNumber:
        """Return the statistics of a parameter, such as "gyro_x.N", or "gyro.N" for all axes."""
        axis, _, symbol = name.rpartition(".")
        if (axis, symbol) not in self._places:
            raise KeyError(f"{name}; there are {', '.join(f'{axis}.{symbol}' for axis, symbol in self._places)}")
        return self.rows[self._places[axis, symbol]]

    @property
    def tests(self) -> tuple[Difference, ...]:
        """The outliers over the typical values, and the axes of each sensor over the mean of its axes."""
        units = [
            Difference(name=f"{unit.axis} {unit.symbol}, {unit.unit}", ratio=unit.times, lower=unit.low / unit.typical,
                       upper=unit.high / unit.typical, pvalue=unit.pvalue, differs=True)
            for unit in self.outliers if unit.times is not None
        ]  # fmt: skip
        axes = [
            Difference(name=f"{axis} {test.symbol}", ratio=ratio, pvalue=test.adjusted, differs=test.differs)
            for test in self.differences if test.symbol != SIGNED for axis, ratio in test.relative.items()
        ]  # fmt: skip
        return (*units, *axes)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks on the statistics, the most severe first."""
        return tuple(sorted_remarks(_remarks(self)))

    @property
    def table(self) -> polars.DataFrame:
        """The rows as a Polars data frame in SI units."""
        rows = [asdict(row) | {name: list(getattr(row, name)) for name in ("below", "shown_by")} for row in self.rows]
        return polars.DataFrame(rows, infer_schema_length=None)

    def summary(self) -> str:
        """Write the tables, outliers and remarks in datasheet units, with at most 80 characters per line."""
        return statistics_text(self)

    def to_dict(self) -> dict[str, Any]:
        """Return the statistics as numbers, lists and strings for JSON."""
        parts = {name: [asdict(item) for item in getattr(self, name)] for name in ("rows", "outliers", "differences")}
        return plain_fields(self, "units confidence size") | parts | {"remarks": plain(self.remarks)}

    def __repr__(self) -> str:
        return f"FleetStatistics({self.units} units, {len(self.rows)} numbers, {len(self.outliers)} outliers)"
