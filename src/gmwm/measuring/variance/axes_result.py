"""Wavelet variances of all axes of a recording, with plots and a summary table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from gmwm.base.errors import DataError
from gmwm.base.plotting import Plotted
from gmwm.base.remarks import texts
from gmwm.base.text import Summarised
from gmwm.measuring.variance.result import WaveletVariance

if TYPE_CHECKING:
    from polars import DataFrame


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class WaveletVariances(Summarised, Plotted, Mapping[str, WaveletVariance]):
    """Wavelet variances of the axes of one recording, as a mapping of axis to `WaveletVariance`.

    Parameters
    ----------
    curves : mapping of axis to WaveletVariance
        The curve of each axis, at least one.

    Examples
    --------
    >>> from gmwm import simulate, wavelet_variance
    >>> curves = wavelet_variance(simulate("WN(sigma2=4e-8)", rate=100.0, samples=1000, rng=1))
    >>> curves["gyro_x"]
    WaveletVariance(gyro_x, haar, 9 levels, 1000 samples at 100 Hz)
    """

    curves: Mapping[str, WaveletVariance]

    def __post_init__(self) -> None:
        if not self.curves:
            raise DataError(argument="curves", expected="the wavelet variance of at least one axis", got=self.curves)
        object.__setattr__(self, "curves", MappingProxyType(dict(self.curves)))

    def __reduce__(self) -> tuple[Any, ...]:
        # A mapping proxy cannot be pickled, so the copy is rebuilt from a plain dict.
        return partial(WaveletVariances, curves=dict(self.curves)), ()

    def __getitem__(self, axis: str) -> WaveletVariance:
        try:
            return self.curves[axis]
        except KeyError:
            raise DataError(argument="axis", expected=f"one of {', '.join(self.curves)}", got=axis) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.curves)

    def __len__(self) -> int:
        return len(self.curves)

    def __contains__(self, axis: object) -> bool:
        return axis in self.curves

    def get(self, axis: str, default: Any = None) -> Any:
        """Return the wavelet variance of an axis, or `default` if there is none."""
        return self.curves.get(axis, default)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields of each axis as plain numbers, lists and strings, by axis."""
        return {axis: wv.to_dict() for axis, wv in self.curves.items()}

    def to_frame(self) -> DataFrame:
        """Return the curves as a Polars data frame with one row for each axis and level."""
        from polars import concat, lit

        return concat([curve.to_frame().select(lit(axis).alias("axis"), "*") for axis, curve in self.items()])

    def summary(self) -> str:
        """Format one table for each sensor, with the variance of each axis at every scale."""
        first = next(iter(self.curves.values()))
        name = first.filter.capitalize() if first.filter == "haar" else first.filter.upper()
        robust = f", robust with efficiency {first.efficiency:g}" if first.robust else ""
        lines = [f"{name} {first.transform.upper()} wavelet variance: {first.extent}{robust}"]
        for _, group in groupby(self.curves, key=lambda axis: axis.rpartition("_")[0] or axis):
            axes = list(group)
            one = self.curves[axes[0]]
            unit = f"variance in ({one.unit})²" if one.unit else "variance"
            lines += ["", unit, f"{'level':>5} {'tau [s]':>12} " + " ".join(f"{axis:>14}" for axis in axes)]
            for k, (j, tau) in enumerate(zip(one.levels, one.tau, strict=True)):
                values = " ".join(f"{self.curves[axis].variance[k]:14.6e}" for axis in axes)
                lines.append(f"{j:5d} {tau:12.6g} {values}")
        remarks = texts(remark.about(axis) for axis, wv in self.curves.items() for remark in wv.remarks)
        return "\n".join([*lines, *(["", *remarks] if remarks else [])])

    def __repr__(self) -> str:
        first = next(iter(self.curves.values()))
        kind = "robust " if first.robust else ""
        return f"WaveletVariances({', '.join(self)}: {kind}{first.filter}, {len(first)} levels, {first.extent})"
