"""The result of an error budget."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gmwm._arrays import Vector, freeze
from gmwm._text import Summarised
from gmwm.remarks import Remark

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure
    from polars import DataFrame


@dataclass(frozen=True, kw_only=True, eq=False)
class Growth:
    """One error over time, as a root mean square (1 σ).

    Attributes
    ----------
    name, title : str
        "tilt_x", and "tilt about x".
    unit : str
        "deg", "m/s" or "m".
    times : (T,) array, in s
        Time since the start, or the averaging time of an alignment.
    error : (T,) array
        The error, in `unit`.
    low, high : (T,) arrays, in `unit`
        Confidence limits from the covariance of the estimated parameters. Both are equal to `error` if the values were
        given.
    terms : mapping of label to (T,) array
        Contribution of each term of each axis, in `unit`. The root sum of squares is `error`.
    """

    name: str
    title: str
    unit: str
    times: Vector
    error: Vector
    low: Vector
    high: Vector
    terms: Mapping[str, Vector]

    def __post_init__(self) -> None:
        for array in (self.times, self.error, self.low, self.high, *self.terms.values()):
            freeze(array)

    @property
    def certain(self) -> bool:
        """Whether there is no interval, because the values of the model were given."""
        return bool(np.all(self.low == self.high))

    def to_dict(self) -> dict[str, Any]:
        """Return the values as lists, ready for JSON."""
        lists = {name: getattr(self, name).tolist() for name in ("times", "error", "low", "high")}
        terms = {label: values.tolist() for label, values in self.terms.items()}
        return {"title": self.title, "unit": self.unit, **lists, "terms": terms}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Budget(Summarised, Mapping[str, Growth]):
    """The error budget of unaided inertial navigation: a mapping of name to `Growth`.

    Attributes
    ----------
    growths : mapping of name to Growth
        "tilt_x", "tilt_y", "heading", "velocity_x" … "velocity_z", "position_x" … "position_z", as far as the axes of
        each are known. Vertical errors only up to 100 s.
    alignment : mapping of name to Growth
        "level_x", "level_y": tilt from averaged accelerometers. "north_x", "north_y": heading from an averaged
        gyroscope that points east.
    duration, rest : float
        Time of navigation, and time at rest before it (s).
    latitude : float
        Latitude (deg).
    gravity : float
        Gravity (m/s²).
    level : float
        Confidence level of the intervals.
    remarks : tuple of Remark
        Remarks on durations that the recordings do not support, missing axes and approximations.
    """

    growths: Mapping[str, Growth]
    alignment: Mapping[str, Growth]
    duration: float
    rest: float
    latitude: float
    gravity: float
    level: float
    remarks: tuple[Remark, ...] = ()

    def __getitem__(self, name: str) -> Growth:
        if name in self.alignment:
            return self.alignment[name]
        return self.growths[name]

    def __iter__(self) -> Iterator[str]:
        return iter((*self.growths, *self.alignment))

    def __len__(self) -> int:
        return len(self.growths) + len(self.alignment)

    @property
    def times(self) -> Vector:
        """Times of the curves (s), (T,); the last one is the duration."""
        return next(iter(self.values())).times

    def summary(self) -> str:
        """Describe the budget as text: the final errors with their largest terms, and their growth."""
        from gmwm.budgets.summary_text import summary

        return summary(self)

    def compare(self, other: Budget, labels: tuple[str, str] = ("this", "other")) -> str:
        """Describe this budget and another one side by side: the errors at the end of the duration, and their ratio.

        Parameters
        ----------
        other : Budget
            The budget of another calibration or of a datasheet, for the same duration.
        labels : tuple of two str
            Names of the two.

        Raises
        ------
        OptionError
            If the durations, the rests or the latitudes differ.
        """
        from gmwm.budgets.summary_text import comparison

        return comparison(self, other, labels)

    def to_dict(self) -> dict[str, Any]:
        """Return the budget as numbers, lists and strings, ready for JSON."""
        return {
            "duration": self.duration, "rest": self.rest, "latitude": self.latitude, "gravity": self.gravity,
            "level": self.level,
            "growth": {name: one.to_dict() for name, one in self.growths.items()},
            "alignment": {name: one.to_dict() for name, one in self.alignment.items()},
            "remarks": [remark.to_dict() for remark in self.remarks],
        }  # fmt: skip

    def to_frame(self) -> DataFrame:
        """Return the errors as a Polars data frame: one row for each error and time."""
        from polars import DataFrame

        rows = [
            {"error": name, "unit": one.unit, "time": t, "value": v, "low": low, "high": high}
            for name, one in self.items()
            for t, v, low, high in zip(one.times, one.error, one.low, one.high, strict=True)
        ]
        return DataFrame(rows, infer_schema_length=None)

    def plot(self, *, path: str | os.PathLike[str] | None = None) -> MatplotlibFigure:
        """Draw the growth of the largest error of each kind with its terms, and the error of the alignment.

        Parameters
        ----------
        path : path, optional
            File to write the picture to, ending in .png, .pdf or .svg.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from gmwm.plots.budget import plot_budget

        return plot_budget(self, path=path)
