"""A virtual sensor: the weighted sum of several sensors of the same motion."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm._arrays import Matrix, Vector
from gmwm._tables import headed
from gmwm._text import Summarised, duration_text
from gmwm.errors import DataError
from gmwm.joint.sensor_array import like_axes
from gmwm.remarks import Remark, texts
from gmwm.signals import Imu, Signal

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure
    from polars import DataFrame


@dataclass(frozen=True, kw_only=True, eq=False)
class VirtualAxis:
    """The weights of one axis, and the noise of the weighted sum.

    Attributes
    ----------
    axis : str
    members : tuple of str
        Names of the d signals.
    unit : str
        Their unit.
    weights : (d,) array
        Weights; their sum is 1, so that the motion is not changed.
    levels : (J,) int array
    rate : float
        Sampling rate (Hz).
    variance : (J,) array
        Predicted wavelet variance of the virtual sensor, in unit², corrected for the estimation of the weights from the
        same recording.
    average : (J,) array
        Wavelet variance of the average of all signals.
    each : (d, J) array
        Wavelet variances of the signals.
    optimism : (J,) array
        Factor by which `variance` is larger than the wavelet variance of the weighted sum in the recording itself.
    """

    axis: str
    members: tuple[str, ...]
    unit: str
    weights: Vector
    levels: NDArray[np.int64]
    rate: float
    variance: Vector
    average: Vector
    each: Matrix
    optimism: Vector

    @property
    def tau(self) -> Vector:
        """Scales τ_j = 2^j / rate (J,), in seconds."""
        return np.asarray(np.exp2(self.levels.astype(np.float64)) / self.rate)

    @property
    def deviation(self) -> Vector:
        """Predicted wavelet deviation of the virtual sensor (J,), in `unit`."""
        return np.sqrt(self.variance)

    @property
    def gain(self) -> Vector:
        """Deviation of the average over the deviation of the virtual sensor (J,)."""
        return np.asarray(np.sqrt(self.average / self.variance))

    @property
    def gain_over_best(self) -> Vector:
        """Deviation of the best single signal at each scale over the deviation of the virtual sensor (J,)."""
        return np.asarray(np.sqrt(self.each.min(axis=0) / self.variance))

    def apply(self, signals: Mapping[str, Signal]) -> Signal:
        """The weighted sum of signals of these members."""
        first = next(iter(signals.values()))
        values = self.weights @ np.array([signals[name].values for name in self.members])
        return Signal(
            values, first.rate, first.unit, self.axis, segments=first.segments, starts=first.starts,
            gaps_known=first.gaps_known,
        )  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain numbers, lists and strings."""
        return {
            "axis": self.axis,
            "unit": self.unit,
            "rate": self.rate,
            "weights": dict(zip(self.members, self.weights.tolist(), strict=True)),
            "tau": self.tau.tolist(),
            "deviation": self.deviation.tolist(),
            "average": np.sqrt(self.average).tolist(),
            "gain": self.gain.tolist(),
            "gain_over_best": self.gain_over_best.tolist(),
            "optimism": self.optimism.tolist(),
        }


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class VirtualSensor(Summarised):
    """One virtual sensor for an array of like sensors: `virtual["gyro_x"]` is one of its axes.

    Attributes
    ----------
    axes : mapping of axis to VirtualAxis
    horizon : float
        Scale (s) at which the weights give the least variance.
    """

    axes: Mapping[str, VirtualAxis]
    horizon: float

    def __getitem__(self, axis: str) -> VirtualAxis:
        """The weights and the noise of one axis."""
        if axis not in self.axes:
            raise DataError(argument="axis", expected=f"one of {', '.join(self.axes)}", got=axis)
        return self.axes[axis]

    def apply(self, x: Sequence[Imu] | Mapping[str, Imu | Signal | ArrayLike] | Imu, rate: float | None = None) -> Imu:
        """Fuse a recording of the same array, at rest or in motion.

        Parameters
        ----------
        x : sequence or mapping
            The recordings or signals of the units, as for `fuse`, with the same names or in the same order.
        rate : float, optional
            Sampling rate (Hz); only for plain arrays.

        Returns
        -------
        Imu
            One signal for each axis. Gaps stay gaps.

        Raises
        ------
        DataError
            If the signals are not those of this array, or are not synchronous.
        """
        groups = like_axes(x, rate)
        fused = {}
        for axis, one in self.axes.items():
            if tuple(groups.get(axis, ())) != one.members:
                expected = f"the signals of {axis}: {', '.join(one.members)}"
                raise DataError(argument="x", expected=expected, got=list(groups.get(axis, ())))
            first = next(iter(groups[axis].values()))
            if first.rate != one.rate:
                raise DataError(
                    f"the weights are for {one.rate:g} Hz, but the signals have {first.rate:g} Hz", argument="x"
                )
            fused[axis] = one.apply(groups[axis])
        return Imu(fused)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Weights that amplify errors of scale factor and alignment."""
        found = []
        for axis, one in self.axes.items():
            place = int(np.argmin(one.weights))
            if one.weights[place] < 0:
                found.append(
                    Remark.of(
                        "weights-negative", axis, member=one.members[place], weight=float(one.weights[place]),
                        factor=float(np.sqrt(one.weights @ one.weights * one.weights.size)),
                    )
                )  # fmt: skip
        return tuple(found)

    def plot(self, *, path: str | os.PathLike[str] | None = None) -> MatplotlibFigure:
        """Draw the deviation of each signal, of their average and of the virtual sensor over the scale.

        Parameters
        ----------
        path : path, optional
            File to write the picture to, ending in .png, .pdf or .svg.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from gmwm.plots.fusion import plot_fusion

        return plot_fusion(self, path=path)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain numbers, lists and strings."""
        return {
            "horizon": self.horizon,
            "axes": {axis: one.to_dict() for axis, one in self.axes.items()},
            "remarks": [remark.to_dict() for remark in self.remarks],
        }

    def to_frame(self) -> DataFrame:
        """The predicted deviations as a Polars data frame: one row for each axis and level."""
        from polars import DataFrame, concat

        return concat(
            DataFrame(
                {
                    "axis": [axis] * one.levels.size,
                    "level": one.levels,
                    "tau": one.tau,
                    "deviation": one.deviation,
                    "average": np.sqrt(one.average),
                    "gain": one.gain,
                    "gain_over_best": one.gain_over_best,
                }
            )
            for axis, one in self.axes.items()
        )

    def summary(self) -> str:
        """Format the weights, the gain at a few scales, and the remarks."""
        lines = []
        for axis, one in self.axes.items():
            weights = [["weight", *(name.removeprefix(axis) for name in one.members)]]
            weights.append(["", *(f"{weight:.3f}" for weight in one.weights)])
            shown = sorted({*range(0, one.tau.size, max(one.tau.size // 6, 1)), self._nearest(one)})
            gains = [["at τ", *(duration_text(one.tau[k]) for k in shown)]]
            gains.append(["gain over the average", *(f"{one.gain[k]:.2f}" for k in shown)])
            gains.append(["gain over the best one", *(f"{one.gain_over_best[k]:.2f}" for k in shown)])
            lines += [self._title(axis, one), "", *headed(weights), "", *headed(gains), ""]
        return "\n".join([*lines, *texts(self.remarks)]).rstrip()

    def _nearest(self, one: VirtualAxis) -> int:
        return int(np.argmin(np.abs(np.log(one.tau / self.horizon))))

    def _title(self, axis: str, one: VirtualAxis) -> str:
        return f"{axis}: virtual sensor of {len(one.members)}, for a scale of {duration_text(self.horizon)}"

    def __repr__(self) -> str:
        count = len(next(iter(self.axes.values())).members)
        return f"VirtualSensor({', '.join(self.axes)}: {count} units, horizon {duration_text(self.horizon)})"
