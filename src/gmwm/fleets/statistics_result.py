"""The result of the statistics of a fleet: its numbers, the outliers, and the differences between axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from gmwm._text import Summarised
from gmwm.fleets.findings import remarks_of
from gmwm.fleets.summary_text import statistics_text
from gmwm.remarks import Remark

if TYPE_CHECKING:
    import polars

SIGNED = "R"
"""Symbol of the rate ramp, which has a sign and is compared directly; all other numbers are compared as logarithms."""


@dataclass(frozen=True, kw_only=True)
class FleetNumber:
    """The statistics of one number of an axis, or of all axes of a sensor, over the units of a fleet.

    Values are in `unit`. The typical value, the spread and the prediction leave out the outliers. The median and the
    quantiles include all estimates.

    Attributes
    ----------
    axis : str
        "gyro_x", or "gyro" for all axes of the sensor together.
    symbol, unit : str
        Symbol of the number in a datasheet, and its SI unit.
    units : int
        Number of units that are compared, because they have a value with a confidence interval.
    limited : int
        Number of units with only an upper limit. They are not among `units`, except for R, where they are zero ± limit.
    left_out : int
        Number of units with another model or unit, a fixed value or no confidence interval.
    model : str or None
        The model of the units, if the number is compared only within one model.
    median, quantile_05, quantile_95 : float or None
        Median and quantiles of the estimates.
    typical, typical_low, typical_high : float or None
        exp μ̂ (μ̂ for R) and its confidence limits.
    spread, spread_low, spread_high : float or None
        Standard deviation τ̂ between the units without estimation error, and its confidence limits, of the logarithm
        (0.1 is 10 %; for R in `unit`).
    error : float or None
        Median standard error of one unit, on the same scale.
    error_share : float or None
        error² / (spread² + error²), the share of estimation error in the variance of the estimates.
    predicted_low, predicted_high : float or None
        Prediction limits for the true number of a further unit.
    searched : bool
        Whether outliers were searched for, which needs at least 8 units of one axis.
    outliers : int
        Number of outliers.
    below : tuple of str
        Units whose upper limit is below `predicted_low`.
    shown_by : tuple of str
        The units with a value, if nearly all others have only an upper limit.
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
        """Whether the number can be negative, so that its value is compared and not its logarithm."""
        return self.symbol == SIGNED


@dataclass(frozen=True, kw_only=True)
class OutlierUnit:
    """A number of a unit that differs from the numbers of the other units by more than chance.

    Attributes
    ----------
    unit, axis, symbol : str
        The unit, the axis and the number.
    value, low, high, typical : float
        The number with its confidence interval, and the typical value of the others, in `si`.
    si : str
        SI unit.
    times : float or None
        value / typical; None for R.
    distance : float
        Distance from the others, in standard deviations between units with estimation error.
    pvalue : float
        Probability of such a distance in a healthy fleet, among all units, axes and numbers.
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
    """Test whether the axes of a sensor differ in one number, with differences within each unit.

    Attributes
    ----------
    sensor, symbol, unit : str
        The sensor, the number and its SI unit.
    units : int
        Number of units in which all axes have the number.
    relative : mapping of axis to float
        Ratio of the mean of the axis to the mean of all axes (geometric means; for R the difference).
    pvalue, adjusted : float
        p-value of Hotelling's test, and adjusted for the number of tests (Holm).
    differs : bool
        Whether `adjusted` is at most the size of the test.
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
class FleetStatistics(Summarised):
    """The statistics of a fleet of units.

    Attributes
    ----------
    rows : tuple of FleetNumber
        The statistics by sensor and number; the row of all axes comes before the rows of single axes.
    outliers : tuple of OutlierUnit
        The smallest p-value first.
    differences : tuple of AxisDifference
        The differences for each sensor with several axes and each number.
    confidence : float
        Level of confidence intervals and predictions.
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
        """Return the number "gyro_x.N", or "gyro.N" for all axes."""
        axis, _, symbol = name.rpartition(".")
        if (axis, symbol) not in self._places:
            raise KeyError(f"{name}; there are {', '.join(f'{axis}.{symbol}' for axis, symbol in self._places)}")
        return self.rows[self._places[axis, symbol]]

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks on the statistics, the most severe first."""
        return tuple(remarks_of(self))

    @property
    def table(self) -> polars.DataFrame:
        """Return the rows as a table in SI units."""
        import polars

        rows = [asdict(row) | {name: list(getattr(row, name)) for name in ("below", "shown_by")} for row in self.rows]
        return polars.DataFrame(rows, infer_schema_length=None)

    def summary(self) -> str:
        """Write tables, outliers and remarks in datasheet units, at most 80 columns wide."""
        return statistics_text(self)

    def to_dict(self) -> dict[str, Any]:
        """Return the statistics as numbers, lists and strings, ready for JSON."""
        named = ("rows", "outliers", "differences")
        return {
            "units": self.units,
            "confidence": self.confidence,
            "size": self.size,
            **{name: [asdict(item) for item in getattr(self, name)] for name in named},
            "remarks": [remark.to_dict() for remark in self.remarks],
        }

    def __repr__(self) -> str:
        return f"FleetStatistics({self.units} units, {len(self.rows)} numbers, {len(self.outliers)} outliers)"
