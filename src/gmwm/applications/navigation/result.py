"""Results of an error budget: navigation errors over time, and their collection."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import FrozenArrays, Vector
from gmwm.base.documents import plain, plain_fields
from gmwm.base.frames import Tabular
from gmwm.base.plotting import Plotted, register
from gmwm.base.remarks import Remark
from gmwm.base.text import Summarised

if TYPE_CHECKING:
    from polars import DataFrame


@dataclass(frozen=True, kw_only=True, eq=False)
class Growth(FrozenArrays):
    """One navigation error over time, as a root mean square (1 σ).

    Attributes
    ----------
    name, title : str
        Name and title of the error, such as "tilt_x" and "tilt about x".
    unit : str
        "deg", "m/s" or "m".
    times : (T,) array, in s
        Times since the start of navigation, or averaging times of an alignment.
    error : (T,) array, in `unit`
        Root mean square of the error.
    low, high : (T,) arrays, in `unit`
        Confidence limits of `error`, from the covariance of the estimated parameters. Both are equal to `error` if the
        values of the model were given. If they differ by more than a factor of 10, `low` is 0, and `high` is at most
        the error that the measured wavelet variance allows.
    terms : mapping of label to (T,) array, in `unit`
        Contribution of each term of each axis. The root of the sum of their squares is `error`.
    """

    name: str
    title: str
    unit: str
    times: Vector
    error: Vector
    low: Vector
    high: Vector
    terms: Mapping[str, Vector]

    @property
    def certain(self) -> bool:
        """Whether there is no interval, because the values of the model were given."""
        return bool(np.all(self.low == self.high))

    @property
    def upper_only(self) -> NDArray[np.bool_]:
        """Mask (T,) of the times at which the error has only an upper limit, `high`."""
        return np.asarray((self.low == 0) & (self.high > 0))

    @property
    def stated(self) -> Vector:
        """The error (T,) that texts and tables state: `error`, or the upper limit if there is only one."""
        return np.where(self.upper_only, self.high, self.error)

    def to_dict(self) -> dict[str, Any]:
        """Return the error as plain values for JSON."""
        return plain_fields(self, "title unit times error low high upper_only terms")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Budget(Summarised, Plotted, Tabular, Mapping[str, Growth]):
    """The error budget of unaided inertial navigation: a mapping of name to `Growth`.

    Attributes
    ----------
    growths : mapping of name to Growth
        Navigation errors with the names "tilt_x", "tilt_y", "heading", "velocity_x" … "velocity_z" and "position_x" …
        "position_z". An error is missing if none of its axes is known. Vertical errors are missing for durations above
        100 s.
    alignment : mapping of name to Growth
        Errors of a static alignment over the averaging time: "level_x" and "level_y" are the tilt from averaged
        accelerometers, "north_x" and "north_y" the heading from an averaged gyroscope that points east.
    duration, rest : float
        Time of navigation, and time at rest before navigation (s).
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
        """Times of the errors (s), as a (T,) array. The last time is the duration."""
        return next(iter(self.values())).times

    def summary(self) -> str:
        """Return the budget as text: the final errors with their largest terms, and the errors at several times."""
        from gmwm.applications.navigation.summary_text import summary

        return summary(self)

    def compare(self, other: Budget, labels: tuple[str, str] = ("this", "other")) -> str:
        """Return a table that compares this budget with an `other`: the errors at the end, and their ratios.

        `labels` are the names of the two budgets. If they have no error in common, or differ in duration, time at rest
        or latitude, an OptionError is raised.
        """
        from gmwm.applications.navigation.summary_text import comparison

        return comparison(self, other, labels)

    def to_dict(self) -> dict[str, Any]:
        """Return the budget as plain values for JSON."""
        facts = plain_fields(self, "duration rest latitude gravity level")
        return facts | {"growth": plain(self.growths), **plain_fields(self, "alignment remarks")}

    coordinates = ("error", "time")

    def to_polars(self) -> DataFrame:
        """Return the errors as a Polars data frame, with one row for each error and time."""
        from polars import DataFrame

        rows = [
            {"error": name, "unit": growth.unit, "time": t, "value": v, "low": low, "high": high, "upper_only": upper}
            for name, growth in self.items()
            for t, v, low, high, upper in zip(
                growth.times, growth.error, growth.low, growth.high, growth.upper_only.tolist(), strict=True
            )
        ]
        return DataFrame(rows, infer_schema_length=None)


register(Budget, "gmwm.applications.navigation.plot:plot_budget")
