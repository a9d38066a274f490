"""Read the table of a fleet as statistical samples: each parameter of each axis over all units, as logarithms."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gmwm.applications.fleets.statistics_result import SIGNED
from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import DataError
from gmwm.calibration.tables import in_order
from gmwm.measuring.variance.allan_regression import LAWS

if TYPE_CHECKING:
    import polars

_NEEDED = ("unit", "axis", "status", "model")


@dataclass(frozen=True, eq=False)
class ParameterSample:
    """One parameter of one axis over all n units."""

    axis: str
    symbol: str
    unit: str
    model: str | None  # noise model of the compared units; None if units with different models are compared
    # x, s2 (n,): logarithms of the estimates (for R, the estimates), and their squared standard errors. NaN in `x` for
    # units that are not compared.
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
        import polars

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
