"""Compute the statistics of a fleet from its table: values over the units, outliers, and differences between axes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.applications.fleets.statistics_result import (
    LEAST_UNITS,
    LEAST_UNITS_FOR_OUTLIERS,
    SIGNED,
    AxisDifference,
    FleetNumber,
    FleetStatistics,
    OutlierUnit,
    deviants,
    looked_for,
)
from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import DataError
from gmwm.base.lazy import polars, scipy
from gmwm.base.statistics import effects, holm, prediction_limits, spread_limits
from gmwm.base.units import sensor_of
from gmwm.calibration.tables import in_order
from gmwm.measuring.variance.allan_regression import LAWS
from gmwm.recording.options import as_confidence, as_size

_NEEDED = ("unit", "axis", "status", "model")


@dataclass(frozen=True, eq=False)
class ParameterSample:
    """One parameter of one axis over all n units."""

    axis: str
    symbol: str
    unit: str
    model: str | None  # noise model of the compared units; None if units with different models are compared
    # x, s2 (n,): log estimates (for R, estimates), NaN if not compared, and their squared standard errors.
    x: Vector
    s2: Vector
    # value, low, high (n,): estimates and confidence limits
    value: Vector
    low: Vector
    high: Vector
    limited: NDArray[np.bool_]  # (n,) units with only an upper limit
    left_out: int  # number of units with the parameter that are not compared and have no upper limit

    def back(self, x: float) -> float | None:
        """Convert a logarithm to the value of the parameter (for R, return it unchanged). NaN becomes None."""
        return (x if self.symbol == SIGNED else float(np.exp(x))) if np.isfinite(x) else None


class FleetSamples:
    """The table of a fleet as arrays with a row for each axis and a column for each unit."""

    def __init__(self, table: polars.DataFrame, confidence: float) -> None:
        if missing := [name for name in _NEEDED if name not in table.columns]:
            raise DataError(argument="table", expected=f"a table with the columns {', '.join(_NEEDED)}", got=missing)
        done = table.filter((polars.col("status") == "calibrated") & polars.col("axis").is_not_null())
        twice = done.filter(polars.struct("unit", "axis").is_duplicated())
        if twice.height:
            unit, axis = twice.row(0, named=True)["unit"], twice.row(0, named=True)["axis"]
            expected = "a table with one row for each axis of a unit"
            raise DataError(argument="table", expected=expected, got=f"several rows for {axis} of {unit}")
        self.done, self.z = done, NormalDist().inv_cdf((1 + confidence) / 2)
        self.confidence = confidence
        self.units: list[str] = done["unit"].unique(maintain_order=True).to_list()
        self.axes: list[str] = done["axis"].unique(maintain_order=True).to_list()
        at_unit, at_axis = ({name: k for k, name in enumerate(names)} for names in (self.units, self.axes))
        self._place = (
            np.array([at_axis[name] for name in done["axis"]], dtype=int),
            np.array([at_unit[name] for name in done["unit"]], dtype=int),
        )
        self.models = self._texts("model")
        stems = [name.removesuffix("_unit") for name in done.columns if name.endswith("_unit")]
        self.symbols = in_order([[stem for stem in stems if stem in done.columns]])

    def _numbers(self, name: str) -> Matrix:
        rows = np.full((len(self.axes), len(self.units)), np.nan)
        rows[self._place] = self.done[name].cast(float, strict=False).fill_null(np.nan).to_numpy()
        return rows

    def _texts(self, name: str) -> NDArray[Any]:
        rows = np.full((len(self.axes), len(self.units)), None, dtype=object)
        rows[self._place] = self.done[name].to_list()
        return rows

    def samples(self) -> list[ParameterSample]:
        """Return a sample for each parameter of each axis that at least one unit has."""
        by_axis: dict[str, list[ParameterSample]] = {axis: [] for axis in self.axes}
        for symbol in self.symbols:
            value, low, high = (self._numbers(symbol + end) for end in ("", "_low", "_high"))
            unit = self._texts(f"{symbol}_unit")
            for k, axis in enumerate(self.axes):
                if any(name is not None for name in unit[k]):
                    ends = (value[k], low[k], high[k])
                    by_axis[axis].append(self._sample(axis, symbol, unit[k], models=self.models[k], ends=ends))
        return [sample for samples in by_axis.values() for sample in samples]

    def _sample(
        self, axis: str, symbol: str, units: NDArray[Any], *, models: NDArray[Any], ends: tuple[Vector, Vector, Vector]
    ) -> ParameterSample:
        value, low, high = ends
        present = np.array([name is not None for name in units])
        unit = _commonest(units[present])
        alike = present & (units == unit)
        model = None if symbol in LAWS else _commonest(models[alike])
        alike &= True if model is None else models == model
        limited = alike & np.isnan(value) & np.isfinite(high) & (high > 0)
        usable = alike & np.isfinite(value) & np.isfinite(low) & np.isfinite(high) & (high > low)
        x, s = np.full(value.shape, np.nan), np.ones(value.shape)
        if symbol == SIGNED:
            value, low = np.where(limited, 0.0, value), np.where(limited, -high, low)
            usable |= limited
            x[usable], s[usable] = value[usable], (high - low)[usable] / (2 * self.z)
        else:
            usable &= np.where(usable, low, 0.0) > 0
            x[usable] = np.log(value[usable])
            s[usable] = np.log(high[usable] / low[usable]) / (2 * self.z)
        left_out = int(np.sum(present & ~usable & ~limited))
        return ParameterSample(
            axis=axis, symbol=symbol, unit=unit, model=model, x=x, s2=s * s, value=value, low=low, high=high,
            limited=limited, left_out=left_out,
        )  # fmt: skip


def _commonest(names: NDArray[Any]) -> str:
    """Return the most frequent name, or the first of several equally frequent names."""
    return str(Counter(names.tolist()).most_common(1)[0][0])


def differences(
    numbers: Sequence[tuple[str, str, str, str | None]], x: Matrix, size: float
) -> tuple[AxisDifference, ...]:
    """Test for each noise parameter, a row of `x` (m, n), whether the axes of a sensor differ.

        T² = n d̄ᵀ S⁻¹ d̄,   (n − p) T² / (p (n − 1)) ~ F(p, n − p).

    d (p,) are differences of successive axes in each of n units, with mean d̄ and covariance S. A factor of the unit
    cancels, and axes may differ in precision (Hotelling 1931, Annals of Mathematical Statistics 2, 360-378)."""
    groups: dict[tuple[str, str], list[int]] = {}
    for k, (axis, symbol, _, _) in enumerate(numbers):
        if sensor := sensor_of(axis):
            groups.setdefault((sensor, symbol), []).append(k)
    tests = []
    for (sensor, symbol), places in groups.items():
        complete = x[places][:, np.all(np.isfinite(x[places]), axis=0)]
        # Leaves 4 denominator degrees of freedom for three axes.
        if len(places) < 2 or complete.shape[1] < 6 or len({numbers[k][2:] for k in places}) > 1:
            continue
        pvalue = hotelling(np.diff(complete, axis=0))
        if pvalue is None:
            continue
        off = np.mean(complete - complete.mean(axis=0), axis=1)
        signed = symbol == SIGNED
        relative = {numbers[k][0]: float(d if signed else np.exp(d)) for k, d in zip(places, off, strict=True)}
        tests.append(AxisDifference(
            sensor=sensor, symbol=symbol, unit=numbers[places[0]][2], units=complete.shape[1], relative=relative,
            pvalue=pvalue, adjusted=1.0, differs=False,
        ))  # fmt: skip
    adjusted = holm([test.pvalue for test in tests]).tolist()
    return tuple(replace(test, adjusted=p, differs=p <= size) for test, p in zip(tests, adjusted, strict=True))


def hotelling(d: Matrix) -> float | None:
    """Return the p-value of Hotelling's test that the mean of d (p, n) over n units is zero; None if it is singular."""
    p, n = d.shape
    mean = d.mean(axis=1)
    # The differences are scaled to unit variance, so that the rank does not depend on the unit.
    size = d.std(axis=1, ddof=1)
    if n <= p or not np.all(size > 0):
        return None
    scatter = np.atleast_2d(np.corrcoef(d))
    if np.linalg.matrix_rank(scatter, hermitian=True) < p:
        return None
    t2 = n * float(mean / size @ np.linalg.solve(scatter, mean / size))
    return float(scipy.special.fdtrc(p, n - p, (n - p) * t2 / (p * (n - 1))))


def fleet_statistics(table: polars.DataFrame, *, confidence: float = 0.95, size: float = 0.05) -> FleetStatistics:
    """Compute typical values and spreads of the noise parameters of a fleet, and find outliers and axes that differ.

    For each parameter, x_i is the logarithm of the estimate for unit i (or the estimate itself for R, which has a
    sign). The estimates differ between units, and they have estimation errors:

        x_i ~ N(μ, τ² + s_i²),   s_i from the width of the confidence interval of unit i.

    The variance τ² between units is estimated by the method of Paule and Mandel, with confidence limits by the
    Q-profile method. The mean μ has the confidence interval μ̂ ± t_{n−1}/√Σ_i w_i with the weights w_i = 1/(τ̂² +
    s_i²). The prediction for a further unit uses the confidence distribution of τ². Outliers are found by Rosner's
    procedure, extended to unequal s_i, for each parameter and axis with at least 8 units. All p-values are adjusted by
    Holm's method, so the probability of any false alarm in a healthy fleet is `size`. The outliers are left out of the
    typical value, the spread and the prediction. Hotelling's test of differences within units shows whether the axes
    differ.

    Units with only an upper limit are counted but not compared. For R, an upper limit means that the value is near
    zero, so it is compared as 0 with the standard error that belongs to the limit. Parameters other than Q, N, B, K and
    R depend on the noise model and are compared only between the units with the most frequent model.

    Parameters
    ----------
    table : polars DataFrame
        A table with a row for each unit and axis, such as `Fleet.table`. It has the columns unit, axis, status and
        model, and for each parameter, such as N, the columns N, N_low, N_high (in SI units) and N_unit.
    confidence : float
        Confidence level of the intervals in the table and in the result.
    size : float
        Probability of any false alarm in a fleet of healthy units.

    Raises
    ------
    OptionError
        If `confidence` is not from 0.5 to below 1, or `size` is not between 0 and 1.
    DataError
        If a column is missing, or an axis of a unit has two rows.

    References
    ----------
    Paule and Mandel (1982), J. Res. NBS 87, 377-385. Viechtbauer (2007), Statistics in Medicine 26, 37-52. Nagashima,
    Noma and Furukawa (2019), Statistical Methods in Medical Research 28, 1689-1702. Rosner (1983), Technometrics 25,
    165-172. Holm (1979), Scandinavian Journal of Statistics 6, 65-70. Hotelling (1931), Annals of Mathematical
    Statistics 2, 360-378.

    Examples
    --------
    >>> import numpy as np, polars
    >>> N = 1e-4 * np.exp(0.1 * np.random.default_rng(2).normal(size=20))
    >>> N[7] *= 4
    >>> rows = {"unit": [f"{k}.csv" for k in range(20)], "axis": "gyro_x", "status": "calibrated", "model": "WN"}
    >>> rows |= {"N": N, "N_low": 0.98 * N, "N_high": 1.02 * N, "N_unit": "rad/s/√Hz"}
    >>> found = fleet_statistics(polars.DataFrame(rows))
    >>> [(outlier.unit, round(outlier.times)) for outlier in found.outliers]
    [('7.csv', 4)]
    >>> row = found["gyro_x.N"]
    >>> row.predicted_low < row.typical < row.predicted_high, row.spread_low < 0.1 < row.spread_high
    (True, True)
    """
    confidence = as_confidence(confidence)
    size = as_size(size)
    read = FleetSamples(table, confidence)
    samples = read.samples()
    units = len(read.units)
    if not samples:
        return FleetStatistics(rows=(), outliers=(), differences=(), confidence=confidence, size=size, units=units)
    x, s2 = np.array([sample.x for sample in samples]), np.array([sample.s2 for sample in samples])
    inliers = x.copy()
    outliers, searched = _outliers(read, samples, x=x, s2=s2, kept=inliers, size=size)
    rows = _rows(read, samples, x=x, kept=inliers, s2=s2, searched=searched)
    together = _together(read, samples, x=x, kept=inliers, s2=s2)
    axes = [(sample.axis, sample.symbol, sample.unit, sample.model) for sample in samples]
    tests = differences(axes, inliers, size)
    order = {row.symbol: k for k, row in enumerate(rows)}
    sensors = list(dict.fromkeys(sensor_of(sample.axis) or sample.axis for sample in samples))
    symbols = list(dict.fromkeys(in_order([list(order)])))
    every = sorted(
        [*together, *rows],
        key=lambda row: (sensors.index(row.axis if row.axis in sensors else sensor_of(row.axis)),
                         symbols.index(row.symbol), row.axis not in sensors),
    )  # fmt: skip
    return FleetStatistics(
        rows=tuple(every), outliers=outliers, differences=tests, confidence=float(confidence), size=float(size),
        units=units,
    )  # fmt: skip


def _outliers(
    read: FleetSamples, samples: Sequence[ParameterSample], x: Matrix, s2: Matrix, kept: Matrix, size: float
) -> tuple[tuple[OutlierUnit, ...], NDArray[np.bool_]]:
    """Return the outliers, set to NaN in `kept`, and the mask of the samples in which outliers were searched."""
    searched = looked_for(np.isfinite(x).sum(axis=1)) > 0
    if not np.any(searched):
        return (), searched
    candidates = deviants(x, s2)
    rows, least = np.flatnonzero(searched), 0.0
    chosen: list[tuple[int, int, float, float]] = []
    for rank, row in enumerate(rows[np.argsort(candidates.pvalue[rows, 0], kind="stable")]):
        adjusted = np.maximum(least, np.minimum(1.0, (rows.size - rank) * candidates.pvalue[row]))
        least = float(adjusted[0])
        for place, distance, p in zip(candidates.places[row], candidates.distance[row], adjusted, strict=True):
            if place >= 0 and p <= size:
                chosen.append((int(row), int(place), float(distance), float(p)))
                kept[row, place] = np.nan
    centre = effects(kept, s2).mean
    outliers = []
    for row, place, distance, p in chosen:
        sample = samples[row]
        value, low, high = (float(of[place]) for of in (sample.value, sample.low, sample.high))
        typical = sample.back(float(centre[row])) or 0.0
        times = None if sample.symbol == SIGNED else value / typical
        outliers.append(OutlierUnit(
            unit=read.units[place], axis=sample.axis, symbol=sample.symbol, value=value, low=low, high=high,
            typical=typical, si=sample.unit, times=times, distance=distance, pvalue=p,
        ))  # fmt: skip
    return tuple(sorted(outliers, key=lambda outlier: (outlier.pvalue, -abs(outlier.distance)))), searched


def _rows(
    read: FleetSamples, samples: Sequence[ParameterSample], x: Matrix, kept: Matrix, s2: Matrix,
    searched: NDArray[np.bool_],
) -> list[FleetNumber]:  # fmt: skip
    """Return the statistics of each parameter of each axis."""
    rows = _describe(read, samples, x=x, kept=kept, s2=s2)
    numbers = []
    for k, (sample, row) in enumerate(zip(samples, rows, strict=True)):
        below: tuple[str, ...] = ()
        if row.predicted_low is not None and sample.symbol != SIGNED:
            under = sample.limited & (np.where(sample.limited, sample.high, np.inf) < row.predicted_low)
            below = tuple(read.units[place] for place in np.flatnonzero(under))
        few = (
            0 < row.units < LEAST_UNITS_FOR_OUTLIERS and row.limited >= 3 * row.units and sample.symbol != SIGNED
        )  # a convention
        shown = tuple(read.units[place] for place in np.flatnonzero(np.isfinite(x[k]))) if few else ()
        gone = int(np.sum(np.isfinite(x[k]) & ~np.isfinite(kept[k])))
        numbers.append(replace(row, searched=bool(searched[k]), outliers=gone, below=below, shown_by=shown))
    return numbers


def _together(
    read: FleetSamples, samples: Sequence[ParameterSample], x: Matrix, kept: Matrix, s2: Matrix
) -> list[FleetNumber]:
    """Return the statistics of each parameter over all axes of a sensor that have the same unit and noise model."""
    groups: dict[tuple[str, str], list[int]] = {}
    for k, sample in enumerate(samples):
        if sensor := sensor_of(sample.axis):
            groups.setdefault((sensor, sample.symbol), []).append(k)
    numbers = []
    for (sensor, symbol), places in groups.items():
        of = [samples[k] for k in places]
        if len(of) < 2 or len({(sample.unit, sample.model) for sample in of}) > 1:
            continue
        first = replace(
            of[0], axis=sensor, symbol=symbol, limited=np.concatenate([sample.limited for sample in of]),
            left_out=sum(sample.left_out for sample in of),
        )  # fmt: skip
        flat = (np.concatenate(part[places])[None] for part in (x, kept, s2))
        (row,) = _describe(read, [first], *flat, axes=len(places))
        numbers.append(replace(row, outliers=int(np.sum(np.isfinite(x[places]) & ~np.isfinite(kept[places])))))
    return numbers


def _describe(
    read: FleetSamples, samples: Sequence[ParameterSample], x: Matrix, kept: Matrix, s2: Matrix, *, axes: int = 1
) -> list[FleetNumber]:
    """Compute typical value, spread and prediction for samples (m, n), each of one or more (dependent) axes."""
    at = effects(kept, s2)
    freedom, error = at.count - 1, at.error
    if axes > 1:
        finite = np.isfinite(kept).reshape(len(samples), axes, -1)
        freedom = finite.any(axis=1).sum(axis=1, dtype=np.float64) - 1
        error = np.maximum(error, _clustered_error(kept, s2, axes))
    with np.errstate(invalid="ignore", divide="ignore"):
        widened = np.where(at.count > 0, (error / at.error) ** 2, 1.0)
    limits = spread_limits(kept, s2, read.confidence, freedom)
    ahead = prediction_limits(kept, s2, confidence=read.confidence, freedom=freedom, widened=widened)
    reach = scipy.special.stdtrit(np.maximum(freedom, 1.0), (1 + read.confidence) / 2) * error
    numbers = []
    for k, sample in enumerate(samples):
        all_, enough = x[k][np.isfinite(x[k])], freedom[k] >= LEAST_UNITS - 1
        quantiles = np.quantile(all_, (0.05, 0.5, 0.95)) if all_.size else np.full(3, np.nan)
        back = [sample.back(float(q)) for q in quantiles]
        s = float(np.sqrt(np.median(s2[k][np.isfinite(x[k])]))) if all_.size else None
        tau = float(np.sqrt(at.spread2[k])) if enough else None
        ends = [float(at.mean[k] - reach[k]), float(at.mean[k] + reach[k]), float(ahead[0][k]), float(ahead[1][k])]
        low, high, soon, late = (sample.back(end) if enough else None for end in ends)
        numbers.append(FleetNumber(
            axis=sample.axis, symbol=sample.symbol, unit=sample.unit, units=int(all_.size),
            limited=int(np.sum(sample.limited)), left_out=sample.left_out, model=sample.model,
            median=back[1], quantile_05=back[0], quantile_95=back[2],
            typical=sample.back(float(at.mean[k])), typical_low=low, typical_high=high, spread=tau,
            spread_low=float(np.sqrt(limits[0][k])) if enough else None,
            spread_high=float(np.sqrt(limits[1][k])) if enough else None,
            error=s, error_share=None if tau is None or s is None else s * s / (tau * tau + s * s),
            predicted_low=soon, predicted_high=late,
        ))  # fmt: skip
    return numbers


def _clustered_error(x: Matrix, s2: Matrix, axes: int) -> Vector:
    """Compute the error of μ̂ of n units with dependent axes: √(n/(n − 1) Σ_units (Σ_axes w (x − μ̂))²) / Σ w."""
    at = effects(x, s2)
    w = np.where(np.isfinite(x), 1 / (at.spread2[:, None] + s2), 0.0)
    pulls = (w * np.where(np.isfinite(x), x - at.mean[:, None], 0.0)).reshape(x.shape[0], axes, -1).sum(axis=1)
    units = np.isfinite(x).reshape(x.shape[0], axes, -1).any(axis=1).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.sqrt(units / np.maximum(units - 1, 1) * np.sum(pulls**2, axis=1)) / np.sum(w, axis=1))
