"""Wavelet variances of all axes of a recording, with plots and a summary table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

from gmwm.base.remarks import texts
from gmwm.measuring.axis_results import AxisResults
from gmwm.measuring.variance.result import WaveletVariance

if TYPE_CHECKING:
    from polars import DataFrame


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class WaveletVariances(AxisResults[WaveletVariance]):
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
    noun = "wavelet variance"

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
            curve = self.curves[axes[0]]
            unit = f"variance in ({curve.unit})²" if curve.unit else "variance"
            lines += ["", unit, f"{'level':>5} {'tau [s]':>12} " + " ".join(f"{axis:>14}" for axis in axes)]
            for k, (j, tau) in enumerate(zip(curve.levels, curve.tau, strict=True)):
                values = " ".join(f"{self.curves[axis].variance[k]:14.6e}" for axis in axes)
                lines.append(f"{j:5d} {tau:12.6g} {values}")
        remarks = texts(remark.about(axis) for axis, wv in self.curves.items() for remark in wv.remarks)
        return "\n".join([*lines, *(["", *remarks] if remarks else [])])

    def __repr__(self) -> str:
        first = next(iter(self.curves.values()))
        kind = "robust " if first.robust else ""
        return f"WaveletVariances({', '.join(self)}: {kind}{first.filter}, {len(first)} levels, {first.extent})"
