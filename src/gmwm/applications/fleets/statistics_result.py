"""Statistics of a fleet: values over the units, outliers, and differences between axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from gmwm.applications.fleets.findings import remarks_of
from gmwm.applications.fleets.summary_text import statistics_text
from gmwm.base.differences import Difference, DifferenceTests
from gmwm.base.documents import plain, plain_fields
from gmwm.base.remarks import Remark

if TYPE_CHECKING:
    import polars

SIGNED = "R"
"""Symbol of the rate ramp. It has a sign, so its values are compared, not their logarithms."""


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
        return tuple(remarks_of(self))

    @property
    def table(self) -> polars.DataFrame:
        """The rows as a Polars data frame in SI units."""
        import polars

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
