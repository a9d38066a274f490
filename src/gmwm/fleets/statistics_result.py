"""What a fleet says: the numbers of its type, the axes that differ, and the units that are not like the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from gmwm._text import Summarised
from gmwm.fleets.summary_text import statistics_text

if TYPE_CHECKING:
    import polars

SIGNED = "R"
"""The ramp has a sign, and is compared as it is; all others by their logarithms."""


@dataclass(frozen=True, kw_only=True)
class FleetNumber:
    """One number of one axis, or of all axes of a sensor, over the units of a fleet.

    Values are in `unit`. Location, spread and prediction are without the outlier units; median and quantiles are of
    all estimates, as they are.

    Attributes
    ----------
    axis : str
        "gyro_x"; "gyro" for all its axes together, each as if it were of a unit of its own.
    symbol, unit : str
        Which number, as in a datasheet, and its SI unit.
    units : int
        Units that give a value with an interval and are compared.
    limited : int
        Units whose data only bound it: they are not among `units` (but for R, where they are known to lie about 0).
    left_out : int
        Units that give it, but have another model or unit, hold it, or do not determine it.
    model : str or None
        The model of the units, where only those of one model can be compared.
    median, quantile_05, quantile_95 : float or None
        Of the estimates, error and all.
    typical, typical_low, typical_high : float or None
        exp μ̂ (for R μ̂) and its confidence limits.
    spread, spread_low, spread_high : float or None
        τ̂ between units apart from estimation error, on the scale of the logarithm (0.1 is 10 %; for R in `unit`).
    error : float or None
        Median standard error of one unit on the same scale.
    error_share : float or None
        error² / (spread² + error²): what of the scatter that is seen is no difference of units.
    predicted_low, predicted_high : float or None
        Limits for the true number of a further unit.
    searched : bool
        Whether outliers were looked for: among 8 units or more of one axis.
    outliers : int
        How many were found.
    below : tuple of str
        Units whose upper limit is below `predicted_low`.
    shown_by : tuple of str
        The units that show it, where nearly all others only bound it.
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
        """Whether it is compared as it is, not by its logarithm."""
        return self.symbol == SIGNED


@dataclass(frozen=True, kw_only=True)
class OutlierUnit:
    """A unit that is not like the others.

    Attributes
    ----------
    unit, axis, symbol : str
        Which one, and in what.
    value, low, high, typical : float
        Its number with its interval, and that of the others, in `si`.
    si : str
        SI unit.
    times : float or None
        value / typical; None for R.
    distance : float
        How far it is from the others, in standard deviations of a unit as it is measured.
    pvalue : float
        Of such a unit in a healthy fleet, with all units, axes and numbers in mind.
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
    """Whether the axes of a sensor differ in one number, unit by unit.

    Attributes
    ----------
    sensor, symbol, unit : str
        Which one, and its SI unit.
    units : int
        Units in which all axes have it.
    relative : mapping of axis to float
        Its mean over the mean of all axes (geometric; for R the difference to it).
    pvalue, adjusted : float
        Of Hotelling's test, alone and with all such tests in mind (Holm).
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
    """What the units of a fleet say together.

    Attributes
    ----------
    rows : tuple of FleetNumber
        Sensor by sensor and number by number, all axes of the sensor first.
    outliers : tuple of OutlierUnit
        The least probable first.
    differences : tuple of AxisDifference
        Of each sensor with several axes and each number.
    confidence : float
        Of intervals and predictions.
    size : float
        Probability of any false alarm in a healthy fleet.
    units : int
        How many have been calibrated.
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
        """The number "gyro_x.N", or "gyro.N" of all axes."""
        axis, _, symbol = name.rpartition(".")
        if (axis, symbol) not in self._places:
            raise KeyError(f"{name}; there are {', '.join(f'{axis}.{symbol}' for axis, symbol in self._places)}")
        return self.rows[self._places[axis, symbol]]

    @property
    def table(self) -> polars.DataFrame:
        """The rows as a table, in SI."""
        import polars

        rows = [asdict(row) | {name: list(getattr(row, name)) for name in ("below", "shown_by")} for row in self.rows]
        return polars.DataFrame(rows, infer_schema_length=None)

    def summary(self) -> str:
        """All of it in words, in the units of datasheets, at most 80 columns wide."""
        return statistics_text(self)

    def to_dict(self) -> dict[str, Any]:
        """All of it as plain numbers, lists and texts, ready for JSON."""
        named = ("rows", "outliers", "differences")
        return {"units": self.units, "confidence": self.confidence, "size": self.size} | {
            name: [asdict(item) for item in getattr(self, name)] for name in named
        }

    def __repr__(self) -> str:
        return f"FleetStatistics({self.units} units, {len(self.rows)} numbers, {len(self.outliers)} outliers)"
